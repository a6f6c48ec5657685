"""Starts with four free fingertips on the shared meshes: quality, time, and distance from the smoothed surface."""

import numpy as np

import nlpgrasp as ng
from benchmarks.outside import MESHES, MISSING, load_mesh
from benchmarks.starts import function_share, run_starts, stage_medians

STARTS = 20


def run():
    if not MESHES.is_dir():
        print(f"skipped: {MISSING}")
        return
    for path in sorted(MESHES.glob("*.stl")):
        body = load_mesh(path)
        task = ng.TaskEllipsoid([1, 1, 1, *[body.size] * 3])
        results, seconds = run_starts(ng.GraspProblem(body, [ng.FrictionContact(0.6)] * 4, task), STARTS)
        lower = np.array([r.record.mu.lower for r in results])
        stages = ", ".join(f"{n} {s:.2f}" for n, s in stage_medians(results).items())
        print(f"{path.name}: {np.mean(lower > 0):.0%} of {STARTS} starts certified above 0 (target 95 %)")
        print(f"  certified mu: median {np.median(lower):.3f}, best {lower.max():.3f}")
        print(
            f"  seconds a start: median {np.median(seconds):.2f}, most {seconds.max():.2f} (target median 3); {stages}"
        )
        print(f"  function evaluations: {function_share(results):.0%} of IPOPT's time")
        distance = np.median([r.found.surface.distances.max() for r in results]) * 1e3
        angle = np.degrees(np.median([r.found.surface.angles.max() for r in results]))
        print(f"  solver's surface to mesh: median of the largest {distance:.2f} mm, {angle:.0f} degrees")
