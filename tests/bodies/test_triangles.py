"""Triangles for pictures: closed, outward, near the surface."""

import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.bodies.mesh.triangles import triangles
from tests.samples import BODIES

VOLUMES = {
    "sphere": 4.0 / 3.0 * np.pi * 0.03**3,
    "ellipsoid": 8.0 / 3.0 * np.pi,
    "cylinder": 0.5 * np.pi,
    "box": 6.0,
    "prism": 0.25,
    "torus": 2.0 * np.pi**2 * 0.3**2,
}


@pytest.mark.parametrize("name", BODIES)
def test_triangles_close_around_the_body(name):
    body = BODIES[name]
    vertices, faces = triangles(body, 2000)
    shape = trimesh.Trimesh(vertices, faces, process=False)
    assert shape.is_watertight
    assert 100 < len(faces) <= 2000
    assert shape.volume > 0.0  # outward
    if name in VOLUMES:
        assert shape.volume == pytest.approx(VOLUMES[name], rel=0.03)
    distances = np.abs(body.distance_function.map(len(vertices))(vertices[:, : body.space].T).full())
    on_surface = np.abs(vertices[:, 2]) < 0.9 * np.max(np.abs(vertices[:, 2])) if body.space == 2 else slice(None)
    assert np.max(distances[0, on_surface]) < 0.03 * body.size


def test_a_mesh_is_simplified(shared_meshes):
    body = ng.Mesh.load(shared_meshes / "ycb_012_strawberry.stl")
    vertices, faces = triangles(body, 1000)
    assert len(faces) == 1000
    assert np.max(np.abs(body.signed_distance(vertices))) < 5e-4


def test_a_mesh_that_cannot_be_simplified_is_remade(shared_meshes):
    body = ng.Mesh.load(shared_meshes / "ycb_048_hammer.stl")
    vertices, faces = triangles(body, 2000)
    shape = trimesh.Trimesh(vertices, faces, process=False)
    assert shape.is_watertight
    assert shape.volume == pytest.approx(body.mesh.volume, rel=0.1)
