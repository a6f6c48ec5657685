"""Distances from sharp edges, against points sampled on the edges."""

import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.bodies.base import exterior_angles
from nlpgrasp.bodies.polygon import polygon_inradius
from nlpgrasp.verify.mesh_body import MeshSurface
from nlpgrasp.verify.surface_geometry import TriangleSurface


def along(ends, count=4001):
    t = np.linspace(0.0, 1.0, count)[:, None]
    return np.concatenate([a + (b - a) * t for a, b in ends])


def test_a_boxs_faces_against_points_of_its_edges(rng):
    box = ng.Box([0.08, 0.05, 0.03])
    half = box.half_size
    corners = half * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    pairs = [(a, b) for a in corners for b in corners if np.sum(a != b) == 1]
    edges = along(pairs)
    for name in box.face_names:
        points = box.sample(name, 20, rng)
        brute = np.min(np.linalg.norm(points[:, None] - edges[None], axis=2), axis=1)
        np.testing.assert_allclose(box.edge_distance(name, points), brute, atol=2e-6)


def test_a_cylinders_faces_against_points_of_its_rims(rng):
    body = ng.Cylinder(0.03, 0.1)
    angles = np.linspace(0.0, 2.0 * np.pi, 20001)
    rims = np.concatenate(
        [np.column_stack([0.03 * np.cos(angles), 0.03 * np.sin(angles), 0 * angles + z]) for z in (0.05, -0.05)]
    )
    for name in ("side", "top"):
        points = body.sample(name, 20, rng)
        brute = np.min(np.linalg.norm(points[:, None] - rims[None], axis=2), axis=1)
        np.testing.assert_allclose(body.edge_distance(name, points), brute, atol=2e-6)


def test_samples_keep_the_margin(rng):
    body = ng.Prism([[0, 0], [0.05, 0], [0.03, 0.04]], 0.06)
    for name in body.face_names:
        points = body.sample(name, 50, rng, 0.004)
        assert len(points) == 50
        assert np.min(body.edge_distance(name, points)) >= 0.004 - 1e-9


def test_the_inradius_of_a_triangle_is_twice_its_area_over_its_perimeter():
    v = np.array([[0, 0], [0.05, 0], [0.03, 0.04]])
    perimeter = np.sum(np.linalg.norm(np.roll(v, -1, axis=0) - v, axis=1))
    assert polygon_inradius(v) == pytest.approx(0.05 * 0.04 / perimeter, rel=1e-9)


def test_a_polygon_turns_by_a_whole_turn():
    v = np.array([[0, 0], [0.05, 0], [0.06, 0.03], [0.02, 0.05]])
    assert np.sum(exterior_angles(v)) == pytest.approx(2.0 * np.pi)


def test_a_mesh_against_code_that_shares_nothing(rng):
    mesh = trimesh.creation.box([0.08, 0.05, 0.03]).subdivide().subdivide()
    body = ng.Mesh(mesh)
    points, _ = body.surface_samples(200, rng)
    inner = np.sort(body.mesh.bounds[1] - np.abs(points), axis=1)  # zero to the side it is on, then to the edges
    np.testing.assert_allclose(body.edge_distance("surface", points), inner[:, 1], atol=1e-9)
    independent = MeshSurface(TriangleSurface(np.asarray(body.mesh.vertices), np.asarray(body.mesh.faces)))
    np.testing.assert_allclose([independent.edge_distance("surface", p) for p in points], inner[:, 1], atol=1e-9)
    assert body.room("surface") == pytest.approx(0.025, rel=0.05)


def test_a_round_mesh_has_no_sharp_edges():
    body = ng.Mesh(trimesh.creation.icosphere(subdivisions=3, radius=0.04))
    assert body.room("surface") == np.inf
    assert np.all(np.isinf(body.edge_distance("surface", np.zeros((2, 3)))))


def with_sliver(mesh, edge, normal):
    """Return a mesh with a point 0.3 micrometres beside an end of an edge, which makes two slivers."""
    start, end = mesh.edges_unique[edge]
    middle = len(mesh.vertices)
    faces = []
    for face in mesh.faces.tolist():
        if start in face and end in face:
            faces += [[middle if i == old else i for i in face] for old in (start, end)]
        else:
            faces.append(face)
    vertices = np.concatenate([mesh.vertices, [mesh.vertices[start] + 3e-7 * np.asarray(normal)]])
    return trimesh.Trimesh(vertices, faces, process=False)


@pytest.mark.parametrize("edge", [0, 100, 1000])
def test_slivers_have_no_sharp_edges(edge):
    """Sides of 0.3 micrometres, as scans have them, are no edges; those of a box with slivers remain."""
    round_mesh = trimesh.creation.icosphere(subdivisions=3, radius=0.04)
    body = ng.Mesh(with_sliver(round_mesh, edge, [0.6, 0.0, 0.8]))
    assert body.room("surface") == np.inf
    box = trimesh.creation.box([0.08, 0.05, 0.03]).subdivide().subdivide()
    points, _ = ng.Mesh(box).surface_samples(100, np.random.default_rng(0))
    expected = ng.Mesh(box).edge_distance("surface", points)
    slivers = ng.Mesh(with_sliver(box, edge % 500, [0.6, 0.0, 0.8]))
    np.testing.assert_allclose(slivers.edge_distance("surface", points), expected, atol=2e-6)
