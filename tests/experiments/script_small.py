"""Experiment script for the command line's tests."""

import os
import signal

import nlpgrasp as ng
from tests.experiments.small import QUICK, base


def crash():
    os.kill(os.getpid(), signal.SIGSEGV)


def broken():
    return 1 / 0


def experiment():
    kind = os.environ.get("KIND", "fine")
    variations = {f"friction {mu}": {"friction": mu} for mu in (0.5, 0.7)}
    if kind == "troubled":
        variations |= {"crash": crash, "broken": broken, "late": lambda: {"friction": 0.9}}
    seeds = range(12) if kind == "long" else range(2)
    return ng.Experiment(base(), variations, seeds=seeds, starts=1, options=QUICK)
