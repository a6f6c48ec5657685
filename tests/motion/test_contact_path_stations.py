"""Paths of a contact over a surface: edges, stations, deviations from the chords."""

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.motion.contact_path import ContactPath, PathStation, SurfaceGraph


def test_edges_are_where_the_fingertip_begins_and_ends_to_roll():
    body, arm = ng.Box([2.0, 2.0, 2.0]), 0.5
    ends = (PathStation(np.array([0.5, 0.0, 1.0]), np.array([0.0, 0.0, -1.0]), "+z"), (1.0, 0.0, 0.2))
    end = PathStation(np.array(ends[1]), np.array([-1.0, 0.0, 0.0]), "+x")
    path = ContactPath(body, [ends[0], end], arm, 1e-3)
    first, last = path.edges
    assert last - first == pytest.approx(arm * np.pi / 2.0, rel=1e-3)
    for length, normal in ((first, [0.0, 0.0, -1.0]), (last, [-1.0, 0.0, 0.0])):
        point, n, _ = path.at(length)
        np.testing.assert_allclose(point[[0, 2]], 1.0, atol=1e-9)
        np.testing.assert_allclose(n, normal, atol=1e-9)
    assert len(ContactPath(ng.Sphere(1.0), SurfaceGraph(ng.Sphere(1.0)).stations(*sphere_ends()), arm, 1e-3).edges) == 0


def sphere_ends():
    a, b = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
    return PathStation(a, -a, "surface"), PathStation(b, -b, "surface")


def test_deviations_cover_the_surface_between_stations():
    body = ng.Ellipsoid([1.0, 0.6, 0.4])
    rng = np.random.default_rng(3)
    ends = [PathStation(p, -body.evaluate("surface", p[None])[2][0], "surface") for p in body.sample("surface", 2, rng)]
    path = ContactPath(body, SurfaceGraph(body).stations(*ends), 0.2, 1e-3, np.radians(2.0))
    for i, (off_point, off_normal) in enumerate(path.deviations()):
        for share in (0.2, 0.5, 0.7):
            chord = (1.0 - share) * path.points[i] + share * path.points[i + 1]
            mean = (1.0 - share) * path.normals[i] + share * path.normals[i + 1]
            point = body.snap("surface", chord[None])[0]
            normal = -body.evaluate("surface", point[None])[2][0]
            assert np.linalg.norm(point - chord) <= off_point + 1e-12
            assert np.linalg.norm(normal - mean / np.linalg.norm(mean)) <= off_normal + 1e-12


def test_faces_are_flat_and_edges_are_rolled_over_in_place():
    body = ng.Box([1.0, 1.0, 1.0])
    ends = [
        PathStation(np.array([0.1, 0.0, 0.5]), np.array([0.0, 0.0, -1.0]), "+z"),
        PathStation(np.array([0.5, 0.2, 0.1]), np.array([-1.0, 0.0, 0.0]), "+x"),
    ]
    assert np.max(ContactPath(body, ends, 0.2, 1e-3).deviations()) < 1e-12


def test_the_surface_between_stations_on_both_sides_of_a_cusp_is_unknown():
    def h(p):
        return p[1] ** 2 - 0.25 * (1.0 - p[0]) ** 3 * (1.0 + p[0])  # a cusp at (1, 0)

    body = ng.PlanarImplicit(h, [[-1.2, -1.2], [1.2, 1.2]])
    points = body.snap("surface", np.array([[0.9, 0.01], [0.9, -0.01]]))
    normals = -body.evaluate("surface", points)[2]
    a, b = (PathStation(point, normal, "surface") for point, normal in zip(points, normals, strict=True))
    path = ContactPath(body, SurfaceGraph(body).stations(a, b), 0.5, 1e-3, np.radians(2.0))
    assert np.isinf(path.deviations()).any()
