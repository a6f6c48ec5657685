"""Starts one after another on one core, with what they cost."""

import time

import numpy as np

import nlpgrasp as ng
from nlpgrasp.common.deadline import Deadline
from nlpgrasp.optimize.compiled_problem import CompiledProblem
from nlpgrasp.optimize.start import run_start


def run_starts(problem, count, seed=0, **options):
    """Return the results of the starts and the wall time of each; building is not counted."""
    compiled = CompiledProblem(problem, ng.SolveOptions(workers=1, **options))
    run_start(compiled, count, seed, Deadline())  # builds the programs
    results, seconds = [], []
    for index in range(count):
        begun = time.perf_counter()
        results.append(run_start(compiled, index, seed, Deadline()))
        seconds.append(time.perf_counter() - begun)
    return results, np.array(seconds)


def stage_medians(results):
    """Return the median seconds of each stage."""
    stages = results[0].record.seconds
    return {name: float(np.median([r.record.seconds[name] for r in results])) for name in stages}


def function_share(results):
    """Return the share of IPOPT's time that is function evaluation."""
    return sum(r.function_seconds for r in results) / sum(r.solver_seconds for r in results)
