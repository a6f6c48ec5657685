"""Display triangulations: closed, outward, on the surface."""

import numpy as np
import pytest
import trimesh
from scipy.special import beta

import nlpgrasp as ng
from nlpgrasp.bodies.mesh.display_triangles import simplify, triangles
from nlpgrasp.bodies.triangulation import clip_ears, superellipse_quarter
from tests.samples import BODIES

COMB = [[0, 0], [5, 0], [5, 3], [4, 3], [4, 1], [3, 1], [3, 3], [2, 3], [2, 1], [1, 1], [1, 3], [0, 3]]  # area 11


def barr(e1, e2):
    """Volume of a superquadric of unit semi-axes (Barr 1981)."""
    return 2.0 * e1 * e2 * beta(e1 / 2.0 + 1.0, e1) * beta(e2 / 2.0, e2 / 2.0)


# exact volumes, and by how much those of the triangles, which are inscribed, may be less
VOLUMES = {
    "box": (6.0, 1e-12),
    "prism": (0.25, 1e-12),
    "sphere": (4.0 / 3.0 * np.pi * 0.03**3, 0.01),
    "ellipsoid": (8.0 / 3.0 * np.pi, 0.01),
    "cylinder": (0.5 * np.pi, 0.001),
    "torus": (2.0 * np.pi**2 * 0.3**2, 0.02),
    "superquadric": (0.125 * barr(0.4, 0.8), 0.01),
    "polygon": (None, 1e-12),
}


def closed(body, most=2000):
    vertices, faces = triangles(body, most)
    shape = trimesh.Trimesh(vertices, faces, process=False)
    assert shape.is_watertight
    assert shape.is_winding_consistent
    assert shape.volume > 0.0  # outward
    assert len(faces) <= most
    return shape


@pytest.mark.parametrize("name", BODIES)
def test_triangles_close_around_the_body(name):
    body = BODIES[name]
    shape = closed(body)
    assert len(shape.faces) >= 12
    corners = shape.triangles[:, :, : body.space]
    samples = np.concatenate([corners.reshape(-1, body.space), corners.mean(axis=1)])
    heights = np.concatenate([shape.triangles[:, :, 2].ravel(), shape.triangles_center[:, 2]])
    plate = body.space == 2
    rim = np.abs(heights) < 0.4 * np.max(np.abs(heights)) if plate else np.ones(len(samples), dtype=bool)
    distances = body.distance_function.map(int(np.sum(rim)))(samples[rim].T).full()[0]
    assert np.max(np.abs(distances)) < (1e-9 if name in {"box", "prism", "polygon"} else 0.03) * body.size


@pytest.mark.parametrize("name", VOLUMES)
def test_volumes_are_those_of_closed_forms(name):
    body = BODIES[name]
    exact, deficit = VOLUMES[name]
    if exact is None:
        x, y = body.corners.T
        area = 0.5 * abs(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))
        exact = area * 0.08 * body.size
    assert (1.0 - deficit) * exact <= closed(body).volume <= (1.0 + 1e-12) * exact


@pytest.mark.parametrize("name", VOLUMES)
def test_the_box_around_the_triangles_is_the_bodys(name):
    body = BODIES[name]
    np.testing.assert_allclose(closed(body).bounds[:, : body.space], body.bounds, atol=1e-12)


def test_a_box_has_no_more_triangles_than_it_takes():
    assert len(triangles(ng.Box([1, 2, 3]))[1]) == 16  # two a side, four an end
    assert set(np.abs(np.round(closed(ng.Box([1, 2, 3])).face_normals, 12)).sum(axis=1)) == {1.0}


@pytest.mark.parametrize("exponents", [(0.2, 0.2), (0.2, 1.0), (1.0, 1.0), (1.9, 0.3), (1.9, 1.9)])
def test_superquadrics_of_all_shapes(exponents):
    body = ng.Superquadric([0.05, 0.03, 0.1], exponents)
    shape = closed(body)
    assert shape.volume == pytest.approx(0.05 * 0.03 * 0.1 * barr(*exponents), rel=0.012)
    h = body.evaluate("surface", np.asarray(shape.vertices))[0]
    assert np.max(np.abs(h)) < 1e-6 * body.size


@pytest.mark.parametrize("exponent", [0.2, 1.0, 1.9])
def test_a_curve_turns_by_little_from_piece_to_piece(exponent):
    steps = np.diff(superellipse_quarter(exponent, 12), axis=0)
    steps /= np.linalg.norm(steps, axis=1, keepdims=True)
    assert np.min(np.sum(steps[1:] * steps[:-1], axis=1)) > np.cos(np.radians(30.0))  # seen as smooth


def test_ears_of_a_polygon_that_is_not_convex():
    corners = np.array(COMB, dtype=float)
    triangles = clip_ears(corners)
    a, b, c = corners[triangles].transpose(1, 0, 2)
    areas = 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])
    assert len(triangles) == len(corners) - 2
    assert np.all(areas > 0.0)
    assert np.sum(areas) == pytest.approx(11.0)
    assert closed(ng.Polygon(COMB)).volume == pytest.approx(11.0 * 0.08 * ng.Polygon(COMB).size)


def test_ears_of_polygons_with_straight_corners():
    corners = np.array([[0, 0], [1, 0], [2, 0], [3, 0], [3, 1], [1.5, 0.2], [0, 1]], dtype=float)
    a, b, c = corners[clip_ears(corners)].transpose(1, 0, 2)
    areas = 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])
    assert np.all(areas >= 0.0)
    assert np.sum(areas) == pytest.approx(1.8)
    closed(ng.Polygon(corners))


def test_a_mesh_is_simplified(outside_meshes):
    body = ng.Mesh.load(outside_meshes / "ycb_012_strawberry.stl")
    vertices, faces = triangles(body, 1000)
    assert 500 < len(faces) <= 1000
    assert np.max(np.abs(body.signed_distance(vertices))) < 5e-4
    assert trimesh.Trimesh(vertices, faces).volume == pytest.approx(body.mesh.volume, rel=0.02)


def walls_that_cross(rng):
    """Triangles of no closed surface: three at many an edge, open ones, and others that cross them."""
    ball = trimesh.creation.icosphere(5, 0.05)
    tops = ball.vertices[ball.faces].mean(axis=1) + rng.normal(0.0, 0.01, (len(ball.faces), 3))
    fins = np.c_[ball.faces[:, :2], len(ball.vertices) + np.arange(len(ball.faces))]
    return np.concatenate([ball.vertices, tops]), np.concatenate([ball.faces[::2], fins])


def test_a_drawing_is_small_whatever_the_surface(rng):
    """Open surfaces and those on which three triangles meet once made files of 14 MB, and took 12 GB."""
    grid = np.stack(np.meshgrid(*2 * [np.linspace(0.0, 0.1, 120)]), axis=-1).reshape(-1, 2)
    sheet = trimesh.Trimesh(*open_sheet(grid), process=False)
    soup = rng.random((30_000, 3)), np.arange(30_000).reshape(-1, 3)
    cases = (sheet.vertices, sheet.faces), walls_that_cross(rng), soup
    for vertices, faces in cases:
        for most in (200, 320, 2000):
            points, kept = simplify(np.asarray(vertices), np.asarray(faces), most)
            assert (100 if vertices is soup[0] else most / 8) < len(kept) <= most
            assert np.all(points > vertices.min(axis=0) - 0.1 * np.ptp(vertices, axis=0).max())
            assert np.all(points < vertices.max(axis=0) + 0.1 * np.ptp(vertices, axis=0).max())
    assert not len(simplify(np.full((9, 3), 0.1), rng.integers(0, 9, (3000, 3)), 320)[1])  # all in one point
    flat = simplify(np.asarray(sheet.vertices), np.asarray(sheet.faces), 320)
    assert np.ptp(flat[0][:, 2]) < 1e-12
    assert trimesh.Trimesh(*flat).area == pytest.approx(sheet.area, rel=0.3)


def open_sheet(grid):
    """Return a square grid of points in the plane z = 0 as vertices and triangles."""
    n = round(len(grid) ** 0.5)
    i = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    faces = np.concatenate([np.c_[i, i + 1, i + n], np.c_[i + 1, i + n + 1, i + n]])
    return np.c_[grid, np.zeros(len(grid))], faces
