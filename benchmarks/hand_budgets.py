"""Epsilon of Ferrari and Canny and mu of a 16-joint hand's grasps under the shared and the L2 budget."""

import time

import numpy as np
import trimesh

import nlpgrasp as ng
from benchmarks.outside import MESHES, MISSING, load_mesh
from nlpgrasp.quality.other_measures import ferrari_canny
from tests.hands.urdf import four_finger_hand

SEEDS = 5
EDGES = 8
POINTS = 20000  # surface samples for the mean distance from the centroid, by which torques are divided
PRIMITIVES = {  # body, its mesh, target epsilon
    "sphere 30 mm": (ng.Sphere(0.03), trimesh.creation.icosphere(4, 0.03), 0.42),
    "box 80 x 40 x 40 mm": (ng.Box([0.08, 0.04, 0.04]), trimesh.creation.box((0.08, 0.04, 0.04)), 0.30),
    "ellipsoid 60, 30, 30 mm": (
        ng.Ellipsoid([0.06, 0.03, 0.03]),
        trimesh.creation.icosphere(4).apply_scale((0.06, 0.03, 0.03)),
        0.38,
    ),
}
ABOVE = 1.1  # target ratio of mu to that of the L2 answer, both under the shared budget


def bodies():
    """Yield name, body, mean radius and target epsilon; meshes have no target."""
    for name, (body, mesh, aim) in PRIMITIVES.items():
        yield name, body, _mean_radius(mesh, body.centroid), aim
    if MESHES.is_dir():
        for path in sorted(MESHES.glob("*.stl")):
            body = load_mesh(path)
            yield path.stem, body, _mean_radius(body.mesh, body.centroid), None
    else:
        print(f"skipped meshes: {MISSING}")


def _mean_radius(mesh, centre):
    """Return the mean distance of a mesh surface from a centre, metres."""
    return float(np.mean(np.linalg.norm(mesh.sample(POINTS, seed=0) - centre, axis=1)))


def run():
    print("under the shared budget, medians of five seeds of one start; CPU seconds of a whole solve")
    hand, ratios = four_finger_hand(), []
    for name, body, radius, aim in bodies():
        task = ng.TaskEllipsoid([1, 1, 1, *[radius] * 3])
        results = {budget: _solved(body, task, hand, budget, radius) for budget in ("l2", "shared")}
        shared, l2 = (np.array(results[budget]) for budget in ("shared", "l2"))
        ratios += (shared[:, 0] / l2[:, 0]).tolist()
        aim_text = "" if aim is None else f" (aim {aim})"
        print(
            f"{name}: epsilon {np.median(shared[:, 1]):.3f}{aim_text};"
            f" mu {np.median(shared[:, 0]):.3f}, of the L2 answer"
            f" {np.median(l2[:, 0]):.3f}; {np.median(shared[:, 2]):.1f} and {np.median(l2[:, 2]):.1f} s",
            flush=True,
        )
    print(f"shared over l2: median {np.median(ratios):.3f} (aim {ABOVE}), least {min(ratios):.3f} (aim 1)")


def _solved(body, task, hand, budget, radius):
    """Solve with each seed, and return mu under the shared budget, epsilon and CPU seconds."""
    problem = ng.GraspProblem(body, ng.FrictionContact(0.7), task, hand=hand, force_budget=budget)
    results = []
    for seed in range(SEEDS):
        start_time = time.process_time()
        solution = ng.solve(problem, starts=1, seed=seed, options=ng.SolveOptions(workers=1))
        cpu_seconds = time.process_time() - start_time
        if solution.success:
            grasp = solution.grasp
            mu = ng.mu(grasp, task, 1e-3, force_budget="shared").upper
            results.append((mu, ferrari_canny(grasp, EDGES, radius), cpu_seconds))
        else:
            results.append((0.0, 0.0, cpu_seconds))
    return results
