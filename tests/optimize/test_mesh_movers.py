"""A hand that touches a mesh on its triangles, and keeps its links away from it."""

from dataclasses import replace
from functools import cache

import casadi as ca
import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.common.deadline import Deadline
from nlpgrasp.optimize.compiled_problem import CompiledProblem
from nlpgrasp.optimize.constraint_values import HandPoints
from nlpgrasp.optimize.projection import TOUCHING, project_onto_constraints, touching_on_body
from nlpgrasp.optimize.propose import propose
from nlpgrasp.optimize.refine import refine_on_triangles
from tests.hands.urdf import four_finger_hand

OPTIONS = ng.SolveOptions(workers=1)
TASK = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.03, 0.03, 0.03])


@cache
def the_mesh():
    return ng.Mesh(trimesh.creation.icosphere(subdivisions=2, radius=0.03))


def off_mesh(points):
    return the_mesh().closest(points)[2]


def own_normals(points):
    """Inward normals of the triangles that points are on: of a convex body those whose plane is farthest out."""
    outward = the_mesh().mesh.face_normals
    planes = np.sum(outward * the_mesh().mesh.triangles[:, 0], axis=1)
    return -outward[np.argmax(points @ outward.T - planes, axis=1)]


@pytest.fixture(scope="module")
def posed():
    """A hand around the ball, fingertips and clearances as the smooth surface wants them."""
    problem = ng.GraspProblem(the_mesh(), ng.FrictionContact(0.7), TASK, hand=four_finger_hand())
    compiled = CompiledProblem(problem, OPTIONS)
    names = compiled.problem.body.face_names * 4
    drawn = [replace(one, faces=names) for one in propose(compiled, np.random.default_rng(0))]
    found = (project_onto_constraints(compiled, candidate) for candidate in drawn)
    return compiled, next(candidate for candidate, violation in found if violation <= TOUCHING)


def test_a_hand_touches_the_mesh(posed):
    compiled, candidate = posed
    own, found, left = touching_on_body(compiled, candidate)
    assert left <= 1e-6
    assert np.max(off_mesh(found.points)) <= 1e-9
    np.testing.assert_allclose(own.inward_normals(found), own_normals(found.points), atol=1e-9)
    towards = found.points - compiled.hand_points.tip_centres(found.hand, found.points)
    distance = np.linalg.norm(towards, axis=1)
    np.testing.assert_allclose(distance, compiled.hand_points.hand.tip_radii, atol=1e-6)
    np.testing.assert_allclose(own.inward_normals(found), towards / distance[:, None], atol=1e-4)


def test_links_keep_their_clearance_from_the_mesh_itself(posed):
    compiled, candidate = posed
    found, _ = refine_on_triangles(compiled, candidate, Deadline())
    assert found.is_feasible
    clearances = compiled.hand_points.mesh_clearances(the_mesh(), found.candidate.hand)
    lower = [compiled.rows.named[i].lower for i in compiled.rows.clearances]
    assert np.all(clearances >= np.array(lower) - 1e-5)


def test_links_hardly_inside_a_mesh_are_inside(posed, rng):
    """The sign is that of the mesh itself: the spline through its distances is some tenths of a millimetre off."""
    half, palm = np.array([0.03, 0.025, 0.004]), posed[1].hand
    brick = ng.Mesh(trimesh.creation.box(2.0 * half))
    problem = ng.GraspProblem(brick, ng.FrictionContact(0.7), TASK, hand=four_finger_hand())
    symbols = problem.hand.symbols(brick.bounds)
    centres = ca.horzcat(*(sphere.centre for sphere in problem.hand.spheres(symbols)))
    links, points, near = ca.Function("links", list(symbols.values()), [centres]), HandPoints(problem), 0
    for shift in rng.uniform(-0.03, 0.03, (1000, 3)):
        values = {**palm, "palm_position": palm["palm_position"] + shift}
        beyond = np.abs(links(*values.values()).full().T) - half
        exact = np.linalg.norm(np.maximum(beyond, 0.0), axis=1) + np.minimum(np.max(beyond, axis=1), 0.0)
        np.testing.assert_allclose(points.mesh_clearances(brick, values), exact, atol=1e-12)
        near += np.count_nonzero(np.abs(exact) < 2e-4)
    assert near > 20
