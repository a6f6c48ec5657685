"""Certificates alone: 1 % for generic grasps (target 0.1 s), 2 % and 1 % at an optimal one."""

import time

import numpy as np

import nlpgrasp as ng
from tests.benchmarks.starts import run_starts
from tests.samples import closed_ellipsoid_grasp

BALL = ng.TaskEllipsoid([1.0] * 6)


def timed(grasp, rtol):
    begun = time.perf_counter()
    bounds = ng.mu(grasp, BALL, rtol)
    assert bounds.gap <= rtol * 1.01
    return time.perf_counter() - begun


def run():
    rng = np.random.default_rng(0)
    for k in (3, 4, 5):
        seconds = [timed(closed_ellipsoid_grasp(rng, k), 0.01) for _ in range(20)]
        print(f"generic, {k} contacts: median {np.median(seconds):.3f} s, most {max(seconds):.3f} s")
    problem = ng.GraspProblem(ng.Ellipsoid([2, 1, 1]), [ng.FrictionContact(0.5)] * 4, BALL)
    results, _ = run_starts(problem, 2, rtol=0.5)
    for rtol in (0.02, 0.01):
        seconds = [timed(r.grasp, rtol) for r in results]
        print(f"optimal, 4 contacts, {rtol:.0%}: {', '.join(f'{s:.2f}' for s in seconds)} s")
