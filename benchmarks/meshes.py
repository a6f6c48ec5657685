"""Meshes: time to load buried triangles, and quality and time of starts on shared meshes."""

from time import perf_counter

import numpy as np
import trimesh

import nlpgrasp as ng
from benchmarks.outside import MESHES, MISSING, load_mesh
from benchmarks.starts import function_share, run_starts, stage_medians
from nlpgrasp.common.meshes.mesh_file import repaired_mesh

STARTS = 20


def assembly(parts, divisions):
    """Return one mesh with the triangles of a box and of balls through the box's surface."""
    rng = np.random.default_rng(0)
    balls = [trimesh.creation.icosphere(divisions, 0.006) for _ in range(parts)]
    for ball in balls:
        ball.apply_translation(rng.uniform(-0.02, 0.02, 3))
    return trimesh.util.concatenate([trimesh.creation.box([0.04, 0.04, 0.04]), *balls])


def load_buried():
    """Print the time to load meshes with buried triangles: the union alone, and the whole body."""
    for parts, divisions in ((40, 3), (10, 4)):
        mesh = assembly(parts, divisions)
        start = perf_counter()
        _, notes = repaired_mesh(mesh)
        middle = perf_counter()
        ng.Mesh(mesh)
        seconds = f"{middle - start:.1f} s to unite, {perf_counter() - middle:.1f} s for the body"
        print(f"{len(mesh.faces)} triangles in {parts + 1} parts: {seconds} (target 5 s); {notes[0]}")


def run():
    load_buried()
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
        distance = np.median([r.on_body.surface.distances.max() for r in results]) * 1e3
        angle = np.degrees(np.median([r.on_body.surface.angles.max() for r in results]))
        print(f"  solver's surface to mesh: median of the largest {distance:.2f} mm, {angle:.0f} degrees")
