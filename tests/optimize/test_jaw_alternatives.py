"""Alternatives of a gripper on a bracket, compared with brute force over pairs, turns and flips."""

import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.solution.obstructions import approach_obstructions

STROKE, LENGTH, THICKNESS = 0.11, 0.06, 0.012
CLEARANCE = 0.001  # above the table
TURN = np.radians(30.0)
KEPT = 20


def bracket():
    """Return an angle of 80 x 40 x 60 mm, 8 mm thick, as one mesh."""
    plates = [trimesh.creation.box([0.08, 0.04, 0.008]), trimesh.creation.box([0.008, 0.04, 0.06])]
    plates[0].apply_translation([0.04, 0.0, 0.004])
    plates[1].apply_translation([0.004, 0.0, 0.03])
    return trimesh.boolean.union(plates)


def brute_force_count(mesh, distance, draws=400):
    """Return how many poses with a free way in random pairs, twelve turns and two flips have, places a distance apart.

    A way is free where no sample of fingers and palm, on a grid of 2 mm, is inside the mesh or under the table.
    """
    points, triangles = trimesh.sample.sample_surface(mesh, draws, seed=1)
    inward = -mesh.face_normals[triangles]
    places, count = [], 0
    for p, n in zip(points, inward, strict=True):
        along = ray_hits(mesh, (p + 1e-6 * n)[None], n)[0]
        if not np.isfinite(along).any():
            continue
        i = int(np.argmin(along))
        q, back = p + (along[i] + 1e-6) * n, -mesh.face_normals[i]
        if n @ back > -0.9987 or np.linalg.norm(q - p) > STROKE:
            continue
        pair = np.array([p, q])
        if any(min(np.linalg.norm(pair - o, axis=1).max() for o in (x, x[::-1])) < distance for x in places):
            continue
        free = sum(is_free(mesh, pair, angle) for angle in np.arange(12) * TURN)
        if free:
            places.append(pair)
            count += 2 * free
    return count


def ray_hits(mesh, origins, direction):
    """Return the distances (n, m) at which rays in one direction meet the triangles; infinite where they do not."""
    corner, first, second = mesh.triangles[:, 0], *(mesh.triangles[:, i] - mesh.triangles[:, 0] for i in (1, 2))
    normal = np.cross(direction, second)
    determinant = np.sum(first * normal, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        offset = origins[:, None] - corner
        u = np.sum(offset * normal, axis=2) / determinant
        across = np.cross(offset, first)
        v, t = across @ direction / determinant, np.sum(across * second, axis=2) / determinant
        return np.where((u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (t > 0.0), t, np.inf)


def is_free(mesh, pair, angle):
    """Return whether fingers and palm are free on the straight way to a pair of contacts."""
    closing = (pair[1] - pair[0]) / np.linalg.norm(pair[1] - pair[0])
    down = np.array([0.0, 0.0, -1.0]) if abs(closing[2]) < 0.999 else np.array([1.0, 0.0, 0.0])
    first = down - (down @ closing) * closing
    first /= np.linalg.norm(first)
    approach = np.cos(angle) * first + np.sin(angle) * np.cross(closing, first)
    back = -np.arange(0.0, 0.2, 2e-3)[:, None] * approach
    across = np.arange(1e-3, THICKNESS, 2e-3)[:, None] * closing
    fingers = [pair[0] - across, pair[1] + across]
    palm = pair[0] + np.linspace(0.05, 0.95, 10)[:, None] * (pair[1] - pair[0]) - LENGTH * approach
    samples = np.concatenate([(part[:, None] + back).reshape(-1, 3) for part in (*fingers, palm)])
    inside = np.isfinite(ray_hits(mesh, samples, np.array([0.36, 0.48, 0.8]))).sum(axis=1) % 2
    return samples[:, 2].min() > CLEARANCE and not np.any(inside)


@pytest.mark.slow
def test_twenty_usable_poses_where_brute_force_finds_as_many():
    mesh = bracket()
    body = ng.Mesh(mesh)
    task = ng.lift(body.centroid, mass=1.5) + ng.disturbance(5.0, 0.05, body.centroid)
    jaws = ng.ParallelJaw(STROKE, finger_length=LENGTH, finger_thickness=THICKNESS)
    table = ng.Table.under(body, CLEARANCE)
    problem = ng.GraspProblem(body, [ng.SoftContact(0.5, 0.004)] * 2, task, hand=jaws, constraints=[table])
    solution = ng.solve(problem, 1, options=ng.SolveOptions(workers=1, global_bound=False, rounds=1), keep=KEPT)
    usable = [grasp for grasp in solution.grasps if not approach_obstructions(grasp.hand)]
    assert brute_force_count(mesh, 0.1 * body.size) >= KEPT
    assert len(usable) == KEPT
    places = {tuple(np.round(np.sort(grasp.grasp.points, axis=0).ravel(), 6)) for grasp in usable}
    assert len(places) > 3
