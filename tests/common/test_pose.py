"""Poses as matrices, or as position and quaternion, against scipy's rotations."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import nlpgrasp as ng
from nlpgrasp.common.spatial import pose_matrix, rigid_transform, rotation_matrices

WHERE = [0.4, -0.1, 0.2]


@pytest.fixture
def turn(rng):
    return Rotation.from_quat(rng.standard_normal(4))


def matrix(turn):
    result = np.eye(4)
    result[:3, :3], result[:3, 3] = turn.as_matrix(), WHERE
    return result


def spellings(turn):
    return (
        matrix(turn),
        matrix(turn).tolist(),
        {"position": WHERE, "quaternion_wxyz": turn.as_quat(scalar_first=True)},
        {"position": WHERE, "quaternion_xyzw": turn.as_quat().tolist()},
    )


def test_all_spellings_are_one_pose(turn):
    for pose in spellings(turn):
        A, b = rigid_transform("pose", pose, 3)
        np.testing.assert_allclose(A, turn.as_matrix(), atol=1e-14)
        np.testing.assert_allclose(b, WHERE)
        np.testing.assert_allclose(pose_matrix("pose", pose), matrix(turn), atol=1e-14)


@pytest.mark.parametrize(
    ("pose", "given"),
    [
        ([0.4, 0.0, 0.2, 1.0, 0.0, 0.0, 0.0], "7 numbers, which do not say where the scalar is"),
        ([1.0, 0.0, 0.0, 0.0], "4 numbers, which do not say where the scalar is"),
        ({"position": WHERE, "quaternion": [1, 0, 0, 0]}, "a mapping with position, quaternion"),
        ({"position": WHERE}, "a mapping with position"),
        ({"position": WHERE, "quaternion_wxyz": [1, 0, 0, 0], "quaternion_xyzw": [0, 0, 0, 1]}, "a mapping with"),
        (np.eye(3), r"shape \(3, 3\)"),
        ("here", "here"),
    ],
)
def test_ambiguous_poses_are_refused_with_the_spellings_there_are(pose, given):
    expected = rf'^pose: got {given}.*, expected a \(4, 4\) matrix, or {{"position": .*"quaternion_wxyz" or "quatern'
    with pytest.raises(ng.InputError, match=expected):
        rigid_transform("pose", pose, 3)


def test_no_rotations_are_refused(turn):
    with pytest.raises(
        ng.InputError, match=r"^pose\.quaternion_wxyz: got length 2, expected unit quat.* \(w, x, y, z\)"
    ):
        rigid_transform("pose", {"position": WHERE, "quaternion_wxyz": [2, 0, 0, 0]}, 3)
    with pytest.raises(ng.InputError, match="a rotation and a translation in the last column"):
        rigid_transform("pose", matrix(turn).T, 3)
    with pytest.raises(ng.InputError, match=r"expected a \(3, 3\) matrix$"):
        rigid_transform("pose", {"position": [0, 0], "quaternion_wxyz": [1, 0, 0, 0]}, 2)
    with pytest.raises(ng.InputError, match=r"^quaternions\[1\]: .* a rotation matrix"):
        rotation_matrices("quaternions", [np.eye(3), 2.0 * np.eye(3)])


def test_an_obstacle_is_placed_by_a_pose(turn):
    box = ng.Box([0.1, 0.2, 0.3])
    expected = ng.Obstacle(box, position=WHERE, quaternion=turn.as_quat(scalar_first=True))
    for pose in spellings(turn):
        obstacle = ng.Obstacle(box, pose=pose)
        np.testing.assert_allclose(obstacle.rotation, expected.rotation, atol=1e-14)
        assert obstacle.position == expected.position
        assert ng.Obstacle.from_dict(obstacle.to_dict()) == obstacle == dataclasses.replace(obstacle)
    with pytest.raises(ng.InputError, match=r"^Obstacle\.pose: got a pose beside position or quaternion"):
        ng.Obstacle(box, position=WHERE, pose=matrix(turn))
    flat = np.array([[1.0, 0.0, 0.1], [0.0, 1.0, 0.2], [0.0, 0.0, 1.0]])
    assert ng.Obstacle(ng.Polygon([[0, 0], [1, 0], [0, 1]]), pose=flat).position == (0.1, 0.2)
    flat[:2, :2] = [[0.0, -1.0], [1.0, 0.0]]
    with pytest.raises(ng.InputError, match="a planar body that is turned"):
        ng.Obstacle(ng.Polygon([[0, 0], [1, 0], [0, 1]]), pose=flat)


@pytest.mark.parametrize("tip", [ng.FlatTip([0.02, 0.01], pose=np.eye(4)), ng.EllipsoidTip([0.01, 0.02, 0.01])])
def test_fingertips_are_placed_by_a_pose(tip, turn):
    kind, size = type(tip), tip.extents if isinstance(tip, ng.FlatTip) else tip.semi_axes
    upright = Rotation.from_euler("xyz", [0.3, np.pi / 2.0, -0.2])  # where roll and yaw are a choice
    for rotation in (turn, upright):
        for pose in spellings(rotation):
            shape = kind(size, pose=pose)
            np.testing.assert_allclose(
                Rotation.from_euler("xyz", shape.rpy).as_matrix(), rotation.as_matrix(), atol=1e-7
            )
            assert shape.offset == tuple(WHERE)
    with pytest.raises(ng.InputError, match=r"Tip\.pose: got a pose beside offset or rpy"):
        kind(size, rpy=[0, 0, 1], pose=matrix(turn))
    with pytest.raises(ng.InputError, match=r"Tip\.rpy: .*, expected radians: 90 degrees are 1\.571"):
        kind(size, rpy=[0, 0, 90])


def test_a_motion_takes_matrices_and_mappings(rng):
    times, p = np.arange(5.0), rng.standard_normal((5, 3))
    turns = Rotation.from_quat(rng.standard_normal((5, 4)))
    expected = ng.RigidMotion(times, p, turns.as_quat(scalar_first=True)).twists([0.5, 2.2])
    np.testing.assert_allclose(ng.RigidMotion(times, p, turns.as_matrix()).twists([0.5, 2.2]), expected, atol=1e-9)
    mapped = [{"position": x, "quaternion_xyzw": q} for x, q in zip(p, turns.as_quat(), strict=True)]
    np.testing.assert_allclose(ng.RigidMotion.of_poses(times, mapped).twists([0.5, 2.2]), expected, atol=1e-9)
    with pytest.raises(ng.InputError, match=r"^poses\[0\]: got 4 numbers"):
        ng.RigidMotion.of_poses(times, turns.as_quat())
    with pytest.raises(ng.InputError, match=r"^quaternions: got 4 rows, expected 5, one a time"):
        ng.RigidMotion(times, p, turns.as_quat()[:4])


def test_grasps_and_tasks_take_both_spellings(turn):
    grasp = ng.Grasp([[0.04, 0, 0], [-0.04, 0, 0]], [[-1, 0, 0], [1, 0, 0]], ng.FrictionContact(0.5))
    task = ng.TaskEllipsoid([1, 2, 3, 0.1, 0.2, 0.3]).given_about([0.1, 0.0, 0.0])
    plain, *others = spellings(turn)
    for pose in others:
        np.testing.assert_allclose(grasp.in_frame(pose).G, grasp.in_frame(plain).G, atol=1e-14)
        np.testing.assert_allclose(task.in_frame(pose).axes, task.in_frame(plain).axes, atol=1e-14)
        np.testing.assert_allclose(task.in_frame(pose).torque_origin, task.in_frame(plain).torque_origin, atol=1e-14)
