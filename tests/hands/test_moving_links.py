"""Links of many postures: against the kinematics of the program, and derivatives by differences."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from nlpgrasp.hands.moving_links import HandState, MovingLinks
from tests.hands.urdf import four_finger_hand, gripper, three_finger_hand

hands = pytest.mark.parametrize("make", [four_finger_hand, three_finger_hand, gripper])


def states(hand, count=4):
    rng = np.random.default_rng(0)
    joints = hand.tree.random_joints(count, rng)
    return HandState(Rotation.random(count, rng=rng).as_matrix(), rng.uniform(-0.1, 0.1, (count, 3)), joints)


@hands
def test_poses_are_those_of_the_program(make):
    """Mimic joints included: the fingers of the gripper move together."""
    hand = make()
    links, state = MovingLinks(hand.robot), states(hand)
    frames = links.frames(state)
    for b in range(len(state)):
        quaternion = Rotation.from_matrix(state.rotation[b]).as_quat(scalar_first=True)
        values = {"palm_position": state.position[b], "palm_quaternion": quaternion, "joints": state.joints[b]}
        for link, pose in hand.tree.body_poses(values).items():
            group = links.group[link]
            local = links.pose[link]
            assert frames.R[b, group] @ local[:3, :3] == pytest.approx(pose[:3, :3], abs=1e-12)
            moved = frames.R[b, group] @ local[:3, 3] + frames.t[b, group]
            assert moved == pytest.approx(pose[:3, 3], abs=1e-12)


@hands
def test_rows_are_derivatives_by_the_twist(make):
    hand = make()
    links, state, rng = MovingLinks(hand.robot), states(hand), np.random.default_rng(1)
    groups = rng.integers(0, len(links.parent) + 1, 6)
    at, n, v = (rng.standard_normal((6, 3)) for _ in range(3))
    pivot, wide = rng.uniform(-0.1, 0.1, (len(state), 3)), np.array([[-10.0], [10.0]])
    which = np.full(6, 2)
    frames = links.frames(state)
    rows = frames.rows(frames.points(at, groups)[2], groups, n, pivot, which)
    turning = frames.turning_rows(np.cross(frames.directions(v, groups)[2], n), groups, which)
    for j in range(links.size):
        twist = np.zeros((len(state), links.size))
        twist[:, j] = 1e-6
        ends = [links.frames(state.moved(sign * twist, pivot, wide)) for sign in (1.0, -1.0)]
        moved = [np.sum(f.points(at, groups)[2] * n, axis=1) for f in ends]
        assert rows[:, j] == pytest.approx((moved[0] - moved[1]) / 2e-6, abs=1e-7)
        turned = [np.sum(f.directions(v, groups)[2] * n, axis=1) for f in ends]
        assert turning[:, j] == pytest.approx((turned[0] - turned[1]) / 2e-6, abs=1e-7)
