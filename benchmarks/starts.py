"""Timing of sequential starts on one core."""

import time

import numpy as np

import nlpgrasp as ng
from nlpgrasp.common.deadline import Deadline
from nlpgrasp.optimize.compiled_problem import CompiledProblem
from nlpgrasp.optimize.start import run_start


def run_starts(problem, count, seed=0, **options):
    """Run starts, and return their results and wall times without compilation of the problem."""
    compiled = CompiledProblem(problem, ng.SolveOptions(workers=1, **options))
    run_start(compiled, count, seed, Deadline())  # builds the programs
    results, seconds = [], []
    for index in range(count):
        start_time = time.perf_counter()
        results.append(run_start(compiled, index, seed, Deadline()))
        seconds.append(time.perf_counter() - start_time)
    return results, np.array(seconds)


def stage_medians(results):
    """Return the median seconds of each stage over starts."""
    stages = results[0].record.seconds
    return {name: float(np.median([r.record.seconds[name] for r in results])) for name in stages}


def function_share(results):
    """Return the fraction of IPOPT's time spent on function evaluation, or 0 without a call."""
    solver_seconds = sum(r.effort.solver_seconds for r in results)
    return sum(r.effort.function_seconds for r in results) / solver_seconds if solver_seconds else 0.0
