"""Hands in contact with the triangles of a mesh, and the clearance of their links from it."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.common.deadline import Deadline
from nlpgrasp.optimize.compiled_problem import CompiledProblem
from nlpgrasp.optimize.polish import polish
from nlpgrasp.optimize.projection import TOUCHING, project_onto_body, project_onto_constraints
from nlpgrasp.optimize.propose import propose
from tests.hands.urdf import four_finger_hand

OPTIONS = ng.SolveOptions(workers=1)
TASK = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.03, 0.03, 0.03])


@cache
def the_mesh():
    return ng.Mesh(trimesh.creation.icosphere(subdivisions=2, radius=0.03))


def off_mesh(points):
    return the_mesh().closest(points)[2]


def triangle_normals(points):
    """Return the inward normals of the triangles under points: on a convex body those whose plane is farthest out."""
    outward = the_mesh().mesh.face_normals
    planes = np.sum(outward * the_mesh().mesh.triangles[:, 0], axis=1)
    return -outward[np.argmax(points @ outward.T - planes, axis=1)]


@pytest.fixture(scope="module")
def posed():
    """Return a hand around the ball whose fingertips touch the smooth surface."""
    problem = ng.GraspProblem(the_mesh(), ng.FrictionContact(0.7), TASK, hand=four_finger_hand())
    compiled = CompiledProblem(problem, OPTIONS)
    names = compiled.problem.body.face_names * 4
    proposed = [replace(candidate, faces=names) for candidate in propose(compiled, np.random.default_rng(0))]
    projected = (project_onto_constraints(compiled, candidate) for candidate in proposed)
    return compiled, next(candidate for candidate, violation in projected if violation <= TOUCHING)


@pytest.mark.slow
def test_a_hand_touches_the_mesh(posed):
    compiled, candidate = posed
    on_faces, moved, violation = project_onto_body(compiled, candidate)
    assert violation <= 1e-6
    assert np.max(off_mesh(moved.points)) <= 1e-9
    np.testing.assert_allclose(on_faces.inward_normals(moved), triangle_normals(moved.points), atol=1e-9)
    towards = moved.points - compiled.hand_functions.tip_centres(moved.hand, moved.points)
    distance = np.linalg.norm(towards, axis=1)
    np.testing.assert_allclose(distance, compiled.hand_functions.hand.tip_radii, atol=1e-6)
    np.testing.assert_allclose(on_faces.inward_normals(moved), towards / distance[:, None], atol=1e-4)


@pytest.mark.slow
def test_links_keep_their_clearance_from_the_mesh_itself(posed):
    compiled, candidate = posed
    hand = compiled.problem.hand
    on_body = polish(compiled, candidate, Deadline()).on_body
    assert on_body.is_feasible
    poses = hand.tree.body_poses(on_body.candidate.hand)
    for link, shapes in hand.robot.shapes.items():
        for shape in shapes:
            vertices = shape.mesh.vertices @ poses[link][:3, :3].T + poses[link][:3, 3]
            least = -2e-4 if hand.has_fingertip(link) else 8e-4
            assert np.min(the_mesh().clearance(vertices)) > least


@pytest.mark.slow
def test_a_required_clearance_is_kept_and_stated():
    body = ng.Mesh(trimesh.creation.capsule(height=0.05, radius=0.02, count=[16, 16]))
    task = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.04, 0.04, 0.04])
    hand = four_finger_hand(clearance=0.002)
    problem = ng.GraspProblem(body, ng.FrictionContact(0.7), task, hand=hand)
    solution = ng.solve(problem, 1, 0, ng.SolveOptions(workers=1, global_bound=False))
    assert solution.status is ng.Status.SOLVED
    rows = {row.name: row for row in solution.constraints if row.kind == "clearance from the body"}
    stated = [link for link, shapes in hand.robot.shapes.items() if shapes and not hand.has_fingertip(link)]
    assert sorted(rows) == sorted(f"clearance from the body, {link}" for link in stated)
    assert all(row.value >= row.lower == 0.002 for row in rows.values())
    assert min(row.value for row in rows.values()) < 0.01
