"""Ellipsoid 2:1:1, friction 0.5, unit ball, 8 starts: certified quality and time on one core."""

import numpy as np

import nlpgrasp as ng
from benchmarks.starts import function_share, run_starts, stage_medians
from nlpgrasp.optimize.start_result import best_of

BEST_KNOWN = {4: 0.7309, 3: 0.4870}
TARGET = {4: 0.72, 3: 0.475}


def problem(k):
    """Return the problem of an ellipsoid with k contacts."""
    return ng.GraspProblem(ng.Ellipsoid([2, 1, 1]), [ng.FrictionContact(0.5)] * k, ng.TaskEllipsoid([1.0] * 6))


def run():
    for k in (4, 3):
        results, seconds = run_starts(problem(k), 8)
        best = best_of(results)
        final = ng.mu(best.on_body.grasp, problem(k).task, 0.01)
        force_closed = sum(r.record.mu.lower > 0.0 for r in results)
        print(f"{k} fingers: best certified {final} (target lower {TARGET[k]}, best known before {BEST_KNOWN[k]})")
        print(
            f"  starts force-closed: {force_closed} of 8;"
            f" upper bounds {np.round([r.record.mu.upper for r in results], 4)}"
        )
        text = f"median {np.median(seconds):.2f}, most {seconds.max():.2f}"
        print(f"  seconds a start: {text} (target 3 with a 2 % certificate)")
        print("  stages: " + ", ".join(f"{n} {s:.2f}" for n, s in stage_medians(results).items()))
        print(f"  function evaluations: {function_share(results):.0%} of IPOPT's time (target at most 33 %)")
