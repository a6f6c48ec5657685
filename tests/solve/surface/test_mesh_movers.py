"""From the smooth surface onto the mesh: contacts that slide, and a hand that moves until it touches."""

from functools import cache

import casadi as ca
import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.common.stopping.stop import Stop
from nlpgrasp.solve.ascent.weakest import weakest_at
from nlpgrasp.solve.start.screen import draw_start
from nlpgrasp.solve.start.touch import TOUCHING, touching
from nlpgrasp.solve.surface.move_hand import TOUCHED, hand_onto_mesh, touch_mesh
from nlpgrasp.solve.surface.slide import slide_onto_mesh
from nlpgrasp.solve.workbench.hand_points import HandPoints
from nlpgrasp.solve.workbench.placed import Placed
from nlpgrasp.solve.workbench.workbench import Workbench
from tests.hands.urdf import four_finger_hand

OPTIONS = ng.SolveOptions(workers=1)
TASK = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.03, 0.03, 0.03])
AXES = np.array([[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]]) / np.sqrt(3.0)


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
def sliding():
    problem = ng.GraspProblem(the_mesh(), [ng.FrictionContact(0.5)] * 4, TASK, constraints=[ng.Table(-0.02, 0.0)])
    return Workbench(problem, OPTIONS)


@pytest.mark.parametrize("seed", range(3))
def test_contacts_slide_to_better_points_of_the_mesh(sliding, seed):
    rng = np.random.default_rng(seed)
    turned = AXES @ np.linalg.qr(rng.standard_normal((3, 3)))[0]
    start = sliding.snapped(Placed(the_mesh().face_names * 4, 0.03 * (turned + 0.3 * rng.standard_normal((4, 3)))))
    begun = the_mesh().closest(start.points)[0]
    grasp = slide_onto_mesh(sliding, start, rng, Stop())
    assert np.max(off_mesh(grasp.points)) <= 1e-9
    np.testing.assert_allclose(grasp.normals, own_normals(grasp.points), atol=1e-6)
    nearest = ng.Grasp(begun, own_normals(begun), grasp.contacts, grasp.torque_origin)
    assert ng.mu(grasp, TASK).upper >= ng.mu(nearest, TASK).lower


@pytest.fixture(scope="module")
def posed():
    """A hand around the ball, fingertips and clearances as the smooth surface wants them."""
    problem = ng.GraspProblem(the_mesh(), ng.FrictionContact(0.7), TASK, hand=four_finger_hand())
    bench = Workbench(problem, OPTIONS)
    found = (touching(bench, candidate) for candidate in draw_start(bench, np.random.default_rng(0)))
    return bench, next(placed for placed, violation in found if violation <= TOUCHING)


def test_a_hand_touches_the_mesh(posed):
    bench, placed = posed
    found = touch_mesh(bench, placed)
    assert found.gap <= 1e-6
    assert np.max(off_mesh(found.grasp.points)) <= 1e-9
    centres = bench.hand_points.tip_centres(found.placed.hand, found.grasp.points)
    towards = found.grasp.points - centres
    distance = np.linalg.norm(towards, axis=1)
    np.testing.assert_allclose(distance, bench.hand_points.hand.tip_radii, atol=1e-6)
    np.testing.assert_allclose(found.grasp.normals, towards / distance[:, None], atol=1e-9)
    clearances = bench.hand_points.mesh_clearances(the_mesh(), found.placed.hand)
    lower = [bench.rows.named[i].lower for i in bench.rows.clearances]
    assert np.all(clearances >= np.array(lower) - 1e-6)


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


def test_a_hand_goes_to_the_contacts_it_is_told_first(posed):
    """Aimed at contacts turned by three degrees, it ends nearer to them than without."""
    bench, placed = posed
    a = np.radians(3.0)
    turn = np.array([[np.cos(a), -np.sin(a), 0.0], [np.sin(a), np.cos(a), 0.0], [0.0, 0.0, 1.0]])
    aim = the_mesh().closest(placed.points @ turn.T)[0]
    aimed = touch_mesh(bench, Placed(placed.faces, aim, placed.hand), own_normals(aim))
    plain = touch_mesh(bench, placed)
    assert aimed.gap <= TOUCHED
    off = [np.linalg.norm(found.grasp.points - aim, axis=1).max() for found in (aimed, plain)]
    assert off[0] < 0.5 * off[1]


def test_no_quality_is_lost_beside_the_first_touch(posed):
    bench, placed = posed
    wanted = weakest_at(bench, placed, np.random.default_rng(0)).value
    first, found = touch_mesh(bench, placed), hand_onto_mesh(bench, placed, wanted, Stop())
    assert ng.mu(found.grasp, TASK).upper >= ng.mu(first.grasp, TASK).lower
    assert found.gap <= TOUCHED
