"""Distinct grasps a second on two cores, body by body, and what keeping many costs over keeping one."""

import os
import time

import numpy as np
import trimesh

import nlpgrasp as ng
from nlpgrasp.solution.file import solution_json

STARTS, KEEP, TURNS = 40, 20, 5
TASK = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.03, 0.03, 0.03])


def mug():
    """A mug with a handle, as a mesh."""
    make = trimesh.creation
    wall, inside = make.cylinder(0.04, 0.09, sections=96), make.cylinder(0.036, 0.086, sections=96)
    inside.apply_translation([0.0, 0.0, 0.006])
    handle = make.torus(0.025, 0.006, major_sections=64, minor_sections=24)
    handle.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2.0, [1.0, 0.0, 0.0]))
    handle.apply_translation([0.05, 0.0, 0.0])
    handle = handle.difference(make.cylinder(0.039, 0.09, sections=96))
    return ng.Mesh(wall.difference(inside).union(handle))


BODIES = {
    "box": lambda: ng.Box([0.08, 0.04, 0.04]),
    "ellipsoid": lambda: ng.Ellipsoid([0.06, 0.03, 0.03]),
    "cylinder": lambda: ng.Cylinder(0.03, 0.08),
    "mug": mug,
}


def solved(problem, keep):
    """A solution, and the seconds its whole call took."""
    begun = time.perf_counter()
    solution = ng.solve(problem, starts=STARTS, keep=keep, options=ng.SolveOptions(workers=2))
    return solution, time.perf_counter() - begun


def run(only=None):
    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:2])
    print(f"{STARTS} starts, 4 friction contacts, keep=1 and keep={KEEP} in turn, medians of {TURNS} whole calls each")
    print("body        grasps  local optima  mu best  mu last  keep=1, s  keep=20, s   more  a second  file")
    for name in BODIES if only is None else only.split(","):
        problem = ng.GraspProblem(BODIES[name](), [ng.FrictionContact(0.6)] * 4, TASK, name=name)
        solved(problem, 1)  # workers, and what they import
        one, many = [], []
        for _ in range(TURNS):
            one.append(solved(problem, 1)[1])
            solution, seconds = solved(problem, KEEP)
            many.append(seconds)
        grasps, alone, seconds = solution.grasps, np.median(one), np.median(many)
        ends = sum(found.start is not None for found in grasps)
        size = len(solution_json(solution.to_dict())) / 1e6
        lower = [found.mu.lower for found in grasps]
        print(
            f"{name:10}  {len(grasps):6}  {ends:12}  {max(lower):7.3f}  {min(lower):7.3f}  {alone:9.1f}"
            f"  {seconds:10.1f}  {seconds / alone - 1.0:5.1%}  {len(grasps) / seconds:8.2f}  {size:.2f} MB",
            flush=True,
        )
