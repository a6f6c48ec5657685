"""Angles between normals and a mesh's normal cones, against a search and the verifier's."""

import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.verify.mesh_body import angle_off_cone

HALF = np.array([0.03, 0.02, 0.05])  # of the box, metres
DIAGONAL = np.ones(3) / np.sqrt(3.0)


@pytest.fixture(scope="module")
def box():
    return ng.Mesh(trimesh.creation.box(2.0 * HALF).subdivide(), smoothing=0.0, resolution=8)


def unit(*values):
    return np.array(values, dtype=float) / np.linalg.norm(values)


@pytest.mark.parametrize(
    ("point", "normal", "on_edges", "angle"),
    [
        ([0.0301, 0.001, 0.002], [1.0, 0.0, 0.0], True, 180.0),  # not on the mesh
        ([0.03, 0.001, 0.002], [1.0, 0.0, 0.0], True, 0.0),
        ([0.03, 0.001, 0.002], unit(np.cos(0.1), np.sin(0.1), 0.0), True, np.degrees(0.1)),
        ([0.03, 0.001, 0.002], [-1.0, 0.0, 0.0], True, 180.0),
        ([0.03, 0.02, 0.002], unit(1.0, 1.0, 0.0), True, 0.0),
        ([0.03, 0.02, 0.002], unit(1.0, 1.0, 0.0), False, 45.0),
        ([0.03, 0.02, 0.002], unit(1.0, 2.0, 0.1), True, np.degrees(np.arctan2(0.1, np.sqrt(5.0)))),
        ([0.03, 0.02, 0.002], unit(1.0, -0.1, 0.0), True, np.degrees(np.arctan2(0.1, 1.0))),
        (HALF, DIAGONAL, True, 0.0),
        (HALF, unit(1.0, 1.0, -0.2), True, np.degrees(np.arctan2(0.2, np.sqrt(2.0)))),
    ],
)
def test_angles_on_a_box(box, point, normal, on_edges, angle):
    (result,) = box.angles_off_normals(np.array([point]), np.array([normal]), on_edges)
    assert np.degrees(result) == pytest.approx(angle, abs=1e-5)


def test_cones_are_those_of_a_search_and_of_the_solver(rng):
    """The nearest of many random conic combinations is hardly farther than the angle, and none is nearer."""
    ball = ng.Mesh(trimesh.creation.icosphere(2, 0.03), smoothing=0.0, resolution=8)
    vertices, faces = np.asarray(ball.mesh.vertices), np.asarray(ball.mesh.faces)
    for i in range(0, len(vertices), 23):
        normals = np.asarray(ball.mesh.face_normals)[np.any(faces == i, axis=1)]
        mixed = rng.exponential(1.0, (20000, len(normals))) ** 3 @ normals
        mixed /= np.linalg.norm(mixed, axis=1)[:, None]
        for spread in (0.02, 0.3, 2.0):
            direction = unit(*(unit(*vertices[i]) + spread * rng.normal(size=3)))
            angle = angle_off_cone(direction, normals)
            searched = np.arccos(np.clip(np.max(mixed @ direction), -1.0, 1.0))
            assert angle - 1e-7 <= searched <= angle + 0.02
            (solvers,) = ball.angles_off_normals(vertices[i : i + 1], direction[None])
            if angle < np.pi / 2.0 - 1e-3:
                assert solvers == pytest.approx(angle, abs=1e-6)


def test_samples_have_their_triangles_normals(box, rng):
    points, normals = box.surface_samples(50, rng)
    for on_edges in (True, False):
        np.testing.assert_allclose(box.angles_off_normals(points, normals, on_edges), 0.0, atol=1e-7)
