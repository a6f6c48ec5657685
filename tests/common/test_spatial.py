"""Wrench transforms and contact frames, (2.3-4) to (2.5-8)."""

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.common.spatial import cross_matrix, move_torque_origin, rotate_body_frame, tangents
from tests.samples import ellipsoid_grasp, random_rotation


def test_cross_matrix_is_the_cross_product(rng):
    v, f = rng.standard_normal((2, 3))
    np.testing.assert_allclose(cross_matrix(v) @ f, np.cross(v, f))


@pytest.mark.parametrize("space", [2, 3])
def test_tangents_complete_a_right_handed_frame(rng, space):
    n = rng.standard_normal((20, space))
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    frames = np.concatenate([n[:, None], tangents(n)], axis=1)
    np.testing.assert_allclose(frames @ frames.transpose(0, 2, 1), np.tile(np.eye(space), (20, 1, 1)), atol=1e-14)
    np.testing.assert_allclose(np.linalg.det(frames), 1.0)


def test_change_of_body_frame_is_2_5_6(rng):
    grasp = ellipsoid_grasp(rng)
    A = random_rotation(rng)
    turned = ng.Grasp(grasp.points @ A.T, grasp.normals @ A.T, grasp.contacts, tangents=grasp.tangents @ A.T)
    np.testing.assert_allclose(turned.G, rotate_body_frame(A) @ grasp.G, atol=1e-12)


def test_change_of_torque_origin_is_2_5_8(rng):
    grasp = ellipsoid_grasp(rng)
    b = rng.standard_normal(3)
    moved = ng.Grasp(grasp.points, grasp.normals, grasp.contacts, torque_origin=b)
    np.testing.assert_allclose(moved.G, move_torque_origin(b) @ grasp.G, atol=1e-12)


def test_planar_change_of_torque_origin(rng):
    points, b = rng.standard_normal((3, 2)), rng.standard_normal(2)
    normals = -points / np.linalg.norm(points, axis=1, keepdims=True)
    grasp = ng.Grasp(points, normals, ng.FrictionContact(0.5))
    moved = ng.Grasp(points, normals, ng.FrictionContact(0.5), torque_origin=b)
    np.testing.assert_allclose(moved.G, move_torque_origin(b) @ grasp.G, atol=1e-12)


def test_a_reflection_is_not_a_change_of_frame():
    with pytest.raises(ng.InputError, match="rotation matrix"):
        rotate_body_frame(np.diag([1.0, 1.0, -1.0]))
