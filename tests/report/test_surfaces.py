"""Shaded surfaces of the viewer: shape, smooth normals, creases."""

import base64

import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.bodies.mesh.display_triangles import triangles
from nlpgrasp.common.drawing import Triangles
from nlpgrasp.report.scene_parts import subdivide, surface
from tests.samples import BODIES


def of(body):
    return Triangles(*triangles(body))


@pytest.mark.parametrize("name", BODIES)
def test_the_shape_stays(name):
    shape = of(BODIES[name])
    shaded = surface(shape)
    before = trimesh.Trimesh(shape.vertices, shape.faces, process=False)
    welded = trimesh.Trimesh(shaded.positions, shaded.faces, process=False)
    assert welded.volume == pytest.approx(before.volume, rel=1e-6)
    np.testing.assert_allclose(np.linalg.norm(shaded.normals, axis=1), 1.0, atol=1e-9)
    outward = np.sum(shaded.normals[shaded.faces] * welded.face_normals[:, None], axis=2)
    assert np.min(outward) > np.cos(np.radians(30.0))


def test_a_ball_is_smooth():
    shaded = surface(of(ng.Sphere(0.05)))
    radial = shaded.positions / np.linalg.norm(shaded.positions, axis=1, keepdims=True)
    assert np.min(np.sum(shaded.normals * radial, axis=1)) > np.cos(np.radians(1.0))
    assert len(shaded.positions) == len(of(ng.Sphere(0.05)).vertices)  # none stands twice
    assert len(shaded.edges) == 0


def test_a_box_is_sharp():
    shaded = surface(of(ng.Box([0.1, 0.2, 0.3])))
    assert set(np.abs(np.round(shaded.normals, 9)).sum(axis=1)) == {1.0}  # along the axes, all of them
    lengths = np.linalg.norm(shaded.edges[:, 1] - shaded.edges[:, 0], axis=1)
    assert sorted(np.round(lengths, 9)) == [0.1] * 4 + [0.2] * 4 + [0.3] * 4


def test_a_cylinder_is_both():
    shaded = surface(of(ng.Cylinder(0.03, 0.1)))
    on_end = np.abs(shaded.normals[:, 2]) > 0.5
    assert set(np.round(np.abs(shaded.normals[on_end, 2]), 9)) == {1.0}
    np.testing.assert_allclose(shaded.normals[~on_end, 2], 0.0, atol=1e-12)
    np.testing.assert_allclose(np.abs(shaded.edges[:, :, 2]), 0.05)  # around both ends, and no line along the side


def test_the_roughness_of_a_scan_is_not_drawn_as_edges(rng):
    ball = trimesh.creation.icosphere(3, 0.05)
    rough = ball.vertices * (1.0 + 0.06 * rng.standard_normal((len(ball.vertices), 1)) * (rng.random((642, 1)) < 0.06))
    assert len(surface(Triangles(rough, np.asarray(ball.faces))).edges) == 0


def test_vertices_that_stand_twice_are_one():
    """As in an STL file: every triangle with corners of its own."""
    shape = of(ng.Sphere(0.05))
    loose = Triangles(shape.vertices[shape.faces].reshape(-1, 3), np.arange(3 * len(shape.faces)).reshape(-1, 3))
    assert len(surface(loose).positions) == len(shape.vertices)


def test_packed_arrays_read_back():
    shaded = surface(of(ng.Box([0.1, 0.2, 0.3])))
    data = shaded.to_dict()
    positions = np.frombuffer(base64.b64decode(data["positions"]), "<f4").reshape(-1, 3)
    np.testing.assert_allclose(positions, shaded.positions, atol=1e-7)
    assert np.array_equal(np.frombuffer(base64.b64decode(data["faces"]), "<u2").reshape(-1, 3), shaded.faces)
    normals = np.frombuffer(base64.b64decode(data["normals"]), "<i2").reshape(-1, 3) / 32767
    np.testing.assert_allclose(normals, shaded.normals, atol=1e-4)


def test_cut_triangles_cover_the_same():
    shape = of(ng.Box([1.0, 2.0, 3.0]))
    corners = subdivide(shape, 500)
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2.0
    assert len(corners) == 16 * 4**3
    assert np.sum(areas) == pytest.approx(22.0)
