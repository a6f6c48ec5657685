"""Paths of contacts over triangles: on the mesh, straight on each triangle, and with its normal."""

import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.budgets.registry import force_budget
from nlpgrasp.motion.contact_path import ContactPath, PathStation, SurfaceGraph
from nlpgrasp.motion.triangle_path import TrianglePaths
from nlpgrasp.quality import mu
from nlpgrasp.quality.sliding_contact import SurfacePath, least_mu_along

pytestmark = pytest.mark.filterwarnings(
    "ignore:the mesh. the smooth surface:UserWarning", "ignore:the mesh is 2 pieces"
)
EXTENTS = [0.08, 0.04, 0.04]
TASK = ng.TaskEllipsoid([0.1, 0.1, 0.1, 0.003, 0.003, 0.003], center=[0, 0, 1, 0, 0, 0])
L2 = force_budget("l2")


def smooth_path(body, start, end):
    """Return the path between two contacts (point, inward normal), over a mesh's smooth surface."""
    ends = [PathStation(np.array(point), np.array(normal), body.face_names[0]) for point, normal in (start, end)]
    stations = SurfaceGraph(body).stations(*ends)
    return ContactPath(body, stations, 0.2 * body.size, 1e-3 * body.size, np.radians(2.0))


def triangle_path(body, start, end):
    path = smooth_path(body, start, end)
    return TrianglePaths(body).over(path.points, path.normals)


def rough_ball():
    """Return a ball of 320 triangles whose corners are moved by up to 3 % of its radius."""
    ball = trimesh.creation.icosphere(2, 0.03)
    factors = 1.0 + 0.03 * np.random.default_rng(1).uniform(-1.0, 1.0, (len(ball.vertices), 1))
    return ng.Mesh(trimesh.Trimesh(ball.vertices * factors, ball.faces))


def contacts_of(body, rng, count):
    """Return random points of a mesh and their inward normals."""
    points, normals = body.surface_samples(count, rng)
    return list(zip(points[:count], -normals[:count], strict=True))


def grasp_with(others, point, normal):
    contacts = [*others.contacts, ng.PointContact()]
    return ng.Grasp([*others.points, point], [*others.normals, normal], contacts, others.torque_origin)


@pytest.mark.parametrize("seed", range(4))
def test_pieces_are_on_triangles_and_have_their_normals(seed):
    body = rough_ball()
    start, end = contacts_of(body, np.random.default_rng(seed), 2)
    path = triangle_path(body, start, end)
    np.testing.assert_allclose(path.points[[0, -1]], [start[0], end[0]], atol=1e-12)
    np.testing.assert_allclose(path.normals[[0, -1]], [start[1], end[1]], atol=1e-12)
    assert np.all(path.deviations == 0.0)
    steps = np.linalg.norm(np.diff(path.points, axis=0), axis=1)
    pieces = np.flatnonzero(steps > 1e-6)
    for share in (0.01, 0.5, 0.99):
        inside = (1.0 - share) * path.points[pieces] + share * path.points[pieces + 1]
        _, outward, distances = body.closest(inside)
        np.testing.assert_allclose(distances, 0.0, atol=1e-9)
        np.testing.assert_allclose(path.normals[pieces], -outward, atol=1e-9)
        np.testing.assert_allclose(path.normals[pieces + 1], -outward, atol=1e-9)


def test_a_slide_over_the_edge_of_a_box_mesh_is_held_as_that_over_the_box():
    mesh = trimesh.creation.box(EXTENTS).subdivide().subdivide()
    start, end = ([0.01, 0.003, -0.02], [0.0, 0.0, 1.0]), ([0.04, 0.003, -0.005], [-1.0, 0.0, 0.0])
    others = ng.Grasp(
        [[0.0, 0.02, 0.0], [0.0, -0.02, 0.0]],
        [[0, -1, 0], [0, 1, 0]],
        [ng.SoftContact(0.5, 0.003)] * 2,
        [0.0, 0.0, 0.0],
    )
    corner = [0.04, 0.003, -0.02]
    exact = SurfacePath(
        np.array([start[0], corner, corner, end[0]]), np.array([start[1], start[1], end[1], end[1]]), np.zeros((3, 2))
    )
    stations = np.array([start[0], corner, end[0]]), np.array([start[1], [-(0.5**0.5), 0.0, 0.5**0.5], end[1]])
    path = TrianglePaths(ng.Mesh(mesh)).over(*stations)
    held, expected = (least_mu_along(p, others, TASK, L2).bounds for p in (path, exact))
    assert expected.lower > 0.0
    assert held.lower == pytest.approx(expected.lower, rel=0.02)
    assert held.upper == pytest.approx(expected.upper, rel=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(8))
def test_no_place_on_the_triangles_is_below_the_lower_end(seed):
    body, rng = rough_ball(), np.random.default_rng(100 + seed)
    while True:
        *stay, start, end = contacts_of(body, rng, 5)
        contacts = [ng.FrictionContact(0.6)] * 3
        others = ng.Grasp([p for p, _ in stay], [n for _, n in stay], contacts, body.centroid)
        floor = mu(others, TASK, 0.01).lower
        ends = [mu(grasp_with(others, *contact), TASK, 0.05).lower for contact in (start, end)]
        if min(ends) > 1.05 * floor + 1e-3:
            break
    path = triangle_path(body, start, end)
    slid = least_mu_along(path, others, TASK, L2, floor)
    for _ in range(60):
        i, share = rng.integers(len(path.points) - 1), rng.random()
        point, normal = ((1.0 - share) * a[i] + share * a[i + 1] for a in (path.points, path.normals))
        least = mu(grasp_with(others, point, normal / np.linalg.norm(normal)), TASK, 0.02).upper
        assert slid.bounds.lower <= least * (1.0 + 1e-9)
    assert slid.bounds.gap <= 0.04 or slid.bounds.upper < 1e-3


def test_between_two_parts_of_a_mesh_the_surface_is_unknown():
    balls = [trimesh.creation.icosphere(2, 0.02).apply_translation([x, 0.0, 0.0]) for x in (-0.03, 0.03)]
    stations = np.array([[-0.03, 0.0, 0.02], [0.03, 0.0, 0.02]])
    path = TrianglePaths(ng.Mesh(trimesh.util.concatenate(balls))).over(stations, np.array([[0.0, 0.0, -1.0]] * 2))
    assert np.isinf(path.deviations).any()
