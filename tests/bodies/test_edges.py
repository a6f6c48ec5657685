"""Distances from sharp edges, against points sampled on the edges."""

import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.bodies.base import exterior_angles
from nlpgrasp.bodies.polygon import polygon_inradius
from nlpgrasp.verify.surface_geometry import TriangleSurface, from_segments, sharp_segments


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
    independent = from_segments(
        sharp_segments(TriangleSurface(np.asarray(body.mesh.vertices), np.asarray(body.mesh.faces)))
    )
    np.testing.assert_allclose([independent(p) for p in points], inner[:, 1], atol=1e-9)
    assert body.room("surface") == pytest.approx(0.025, rel=0.05)


def test_a_round_mesh_has_no_sharp_edges():
    body = ng.Mesh(trimesh.creation.icosphere(subdivisions=3, radius=0.04))
    assert body.room("surface") == np.inf
    assert np.all(np.isinf(body.edge_distance("surface", np.zeros((2, 3)))))
