"""Distinct grasps a second on two cores, body by body, and what keeping many costs over keeping one."""

import os
import time

import numpy as np
import trimesh

import nlpgrasp as ng
from nlpgrasp.solution.file import text_of

STARTS, KEEP = 40, 20
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


def run(only=None):
    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:2])
    print(f"{STARTS} starts, keep={KEEP}, 4 friction contacts")
    print("body        grasps  local optima  mu best  mu last  seconds  of it for the others  a second  file")
    for name in BODIES if only is None else [only]:
        problem = ng.GraspProblem(BODIES[name](), [ng.FrictionContact(0.6)] * 4, TASK, name=name)
        begun = time.perf_counter()
        solution = ng.solve(problem, starts=STARTS, keep=KEEP, options=ng.SolveOptions(workers=2))
        seconds, grasps = time.perf_counter() - begun, solution.grasps
        extra = solution.solver["seconds"]["other grasps"]
        ends = sum(found.start is not None for found in grasps)
        size = len(text_of(solution.to_dict())) / 1e6
        lower = [found.mu.lower for found in grasps]
        print(
            f"{name:10}  {len(grasps):6}  {ends:12}  {max(lower):7.3f}  {min(lower):7.3f}  {seconds:7.1f}"
            f"  {extra:7.2f} ({extra / (seconds - extra):5.1%})      {len(grasps) / seconds:8.2f}  {size:.2f} MB",
            flush=True,
        )
