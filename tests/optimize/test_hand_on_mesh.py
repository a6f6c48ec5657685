"""Hands in contact with the triangles of a mesh, and the clearance of their links from it."""

from dataclasses import replace
from functools import cache

import casadi as ca
import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.common.deadline import Deadline
from nlpgrasp.optimize.compiled_problem import CompiledProblem
from nlpgrasp.optimize.constraint_values import HandFunctions
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
    on_body = polish(compiled, candidate, Deadline()).on_body
    assert on_body.is_feasible
    clearances = compiled.hand_functions.mesh_clearances(the_mesh(), on_body.candidate.hand)
    lower = [compiled.rows.named[i].lower for i in compiled.rows.clearances]
    assert np.all(clearances >= np.array(lower) - 1e-5)


@pytest.mark.slow
def test_links_hardly_inside_a_mesh_are_inside(posed, rng):
    """The sign is that of the mesh itself: the spline through its distances errs by some tenths of a millimetre."""
    half, palm = np.array([0.03, 0.025, 0.004]), posed[1].hand
    brick = ng.Mesh(trimesh.creation.box(2.0 * half))
    problem = ng.GraspProblem(brick, ng.FrictionContact(0.7), TASK, hand=four_finger_hand())
    symbols = problem.hand.symbols(brick.bounds)
    centres = ca.horzcat(*(sphere.centre for sphere in problem.hand.spheres(symbols)))
    links, points, near = ca.Function("links", list(symbols.values()), [centres]), HandFunctions(problem), 0
    for shift in rng.uniform(-0.03, 0.03, (1000, 3)):
        values = {**palm, "palm_position": palm["palm_position"] + shift}
        beyond = np.abs(links(*values.values()).full().T) - half
        exact = np.linalg.norm(np.maximum(beyond, 0.0), axis=1) + np.minimum(np.max(beyond, axis=1), 0.0)
        np.testing.assert_allclose(points.mesh_clearances(brick, values), exact, atol=1e-12)
        near += np.count_nonzero(np.abs(exact) < 2e-4)
    assert near > 20
