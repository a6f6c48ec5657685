"""Distinct grasps per second on two cores, and the extra cost of keeping many grasps."""

import os
import time

import numpy as np
import trimesh

import nlpgrasp as ng
from nlpgrasp.solution.file import solution_json

STARTS, KEEP, TURNS = 40, 20, 5
TASK = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.03, 0.03, 0.03])


def mug():
    """Return the mesh of a mug with a handle."""
    creation = trimesh.creation
    wall, cavity = creation.cylinder(0.04, 0.09, sections=96), creation.cylinder(0.036, 0.086, sections=96)
    cavity.apply_translation([0.0, 0.0, 0.006])
    handle = creation.torus(0.025, 0.006, major_sections=64, minor_sections=24)
    handle.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2.0, [1.0, 0.0, 0.0]))
    handle.apply_translation([0.05, 0.0, 0.0])
    handle = handle.difference(creation.cylinder(0.039, 0.09, sections=96))
    return ng.Mesh(wall.difference(cavity).union(handle))


BODIES = {
    "box": lambda: ng.Box([0.08, 0.04, 0.04]),
    "ellipsoid": lambda: ng.Ellipsoid([0.06, 0.03, 0.03]),
    "cylinder": lambda: ng.Cylinder(0.03, 0.08),
    "mug": mug,
}


def solve_timed(problem, keep):
    """Solve a problem, and return the solution and the wall seconds of the call."""
    start_time = time.perf_counter()
    solution = ng.solve(problem, starts=STARTS, keep=keep, options=ng.SolveOptions(workers=2))
    return solution, time.perf_counter() - start_time


def run(only=None):
    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:2])
    print(f"{STARTS} starts, 4 friction contacts, keep=1 and keep={KEEP} in turn, medians of {TURNS} whole calls each")
    print("body        grasps  local optima  mu best  mu last  keep=1, s  keep=20, s   more  a second  file")
    for name in BODIES if only is None else only.split(","):
        problem = ng.GraspProblem(BODIES[name](), [ng.FrictionContact(0.6)] * 4, TASK, name=name)
        solve_timed(problem, 1)  # workers, and what they import
        single, multiple = [], []
        for _ in range(TURNS):
            single.append(solve_timed(problem, 1)[1])
            solution, seconds = solve_timed(problem, KEEP)
            multiple.append(seconds)
        grasps, single_seconds, seconds = solution.grasps, np.median(single), np.median(multiple)
        optima = sum(grasp_record.start is not None for grasp_record in grasps)
        size = len(solution_json(solution.to_dict())) / 1e6
        lower = [grasp_record.mu.lower for grasp_record in grasps]
        print(
            f"{name:10}  {len(grasps):6}  {optima:12}  {max(lower):7.3f}  {min(lower):7.3f}  {single_seconds:9.1f}"
            f"  {seconds:10.1f}  {seconds / single_seconds - 1.0:5.1%}  {len(grasps) / seconds:8.2f}  {size:.2f} MB",
            flush=True,
        )
