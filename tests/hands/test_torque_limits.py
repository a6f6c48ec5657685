"""Joint-torque limits in a grasp against MuJoCo's Jacobians and a linear program."""

import mujoco
import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.hands.inspection import inspect
from tests.hands.test_grasps import solve_grasp
from tests.hands.urdf import FOUR, FOUR_TIPS, Mujoco, body_frame, four_finger_hand

LINKS = list(FOUR_TIPS)


@pytest.fixture(scope="module")
def solution():
    return solve_grasp(ng.Box([0.08, 0.04, 0.04]), four_finger_hand())


@pytest.fixture(scope="module")
def drawn():
    """A random posture, as files state it, and points 10 mm beside the fingertips' centres."""
    hand, rng = four_finger_hand(), np.random.default_rng(3)
    values, tips = hand.draw(1, np.zeros((1, 3)), rng)
    return hand.describe({name: value[0] for name, value in values.items()}), tips[0] + [0.0, 0.01, 0.0]


def mujoco_jacobians(posture, points):
    """Return velocity per joint rate of each contact, body frame, by joint name."""
    simulator = Mujoco(FOUR)
    simulator.link_poses(posture["joint_positions"])
    mujoco.mj_comPos(simulator.model, simulator.data)
    base = body_frame(posture["palm_pose"])
    names = [mujoco.mj_id2name(simulator.model, mujoco.mjtObj.mjOBJ_JOINT, j) for j in range(simulator.model.njnt)]
    result = []
    for link, point in zip(LINKS, points, strict=True):
        local = base[:3, :3].T @ (point - base[:3, 3])
        jacobian = np.zeros((3, simulator.model.nv))
        body = mujoco.mj_name2id(simulator.model, mujoco.mjtObj.mjOBJ_BODY, link)
        mujoco.mj_jac(simulator.model, simulator.data, jacobian, None, local, body)
        result.append(base[:3, :3] @ jacobian)
    return names, result


def test_jacobians_are_mujocos(drawn):
    hand = four_finger_hand()
    budget = ng.hand_torque_limits(hand, *drawn)
    names, expected = mujoco_jacobians(*drawn)
    columns = [names.index(joint) for joint in hand.loaded_joints]
    for i in range(len(LINKS)):
        np.testing.assert_allclose(budget.jacobians[i][:3], expected[i][:, columns], atol=1e-9)
    np.testing.assert_allclose(budget.limits, 0.7)


@pytest.mark.slow
def test_quality_under_torque_limits_scales_with_them(solution):
    task = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.03, 0.03, 0.03])
    weak, strong = (
        ng.mu(
            solution.grasp,
            task,
            0.02,
            force_budget=ng.hand_torque_limits(four_finger_hand(torque_limits=t), solution.hand, solution.grasp.points),
        )
        for t in (0.2, 0.4)
    )
    assert weak.lower > 0.0
    assert strong.lower <= 2.0 * weak.upper * (1 + 1e-9)
    assert 2.0 * weak.lower <= strong.upper * (1 + 1e-9)


def test_joints_without_limits_are_refused(drawn):
    posture, points = drawn
    missing = ng.URDFHand.load(FOUR, FOUR_TIPS, {"index_abduction": 0.7})
    with pytest.raises(ng.InputError, match=r"none for .*index_proximal_flexion"):
        ng.hand_torque_limits(missing, posture, points)
    with pytest.raises(ng.InputError, match="posture"):
        ng.hand_torque_limits(four_finger_hand(), {}, points)


def test_a_joint_that_moves_two_contacts_feels_both(drawn):
    posture, points = drawn
    hand = ng.URDFHand.load(FOUR, {"index_tip": 0.011, "index_middle": 0.009})
    budget = ng.hand_torque_limits(hand, posture, points[:2])
    moved = [np.any(J != 0.0, axis=0) for J in budget.jacobians]
    joints = ("index_abduction", "index_proximal_flexion", "index_middle_flexion", "index_distal_flexion")
    assert hand.loaded_joints == joints
    assert moved[0].tolist() == [True] * 4
    assert moved[1].tolist() == [True, True, True, False]  # the distal joint is beyond the inner contact


def write_efforts(folder, efforts, kind="revolute"):
    """Write a gripper of two box fingers with the given efforts."""
    text = '<link name="palm"><collision><geometry><box size="0.1 0.04 0.02"/></geometry></collision></link>'
    for i, effort in enumerate(efforts):
        text += (
            f'<link name="f{i}"><collision><origin xyz="0 0 0.03"/><geometry><box size="0.01 0.01 0.06"/></geometry>'
            f'</collision></link><joint name="j{i}" type="{kind}"><parent link="palm"/><child link="f{i}"/>'
            f'<origin xyz="{0.08 * i - 0.04} 0 0.01"/><axis xyz="0 1 0"/>'
            f'<limit lower="-0.6" upper="0.6" effort="{effort}" velocity="1"/></joint>'
        )
    path = folder / "efforts.urdf"
    path.write_text(f'<robot name="efforts">{text}</robot>')
    return path


@pytest.mark.parametrize(
    ("efforts", "kind", "text"),
    [
        ((100, 100), "revolute", "An effort of 100 N m or more at all 2 joints looks like a placeholder"),
        ((100, 0.5), "revolute", "An effort of 100 N m or more at joint j0 looks like a placeholder"),
        ((9999, 9999), "revolute", "An effort of 100 N m or more at all 2 joints looks like a placeholder"),
        ((1000, 1000), "prismatic", "An effort of 1000 N or more at all 2 joints looks like a placeholder"),
        ((10, 10), "revolute", "All 2 joints state one effort, 10, which may be a placeholder"),
        ((1, 1), "revolute", "All 2 joints state one effort, 1, which may be a placeholder"),
        ((100, 100), "prismatic", "All 2 joints state one effort, 100, which may be a placeholder"),
        ((0, 0), "revolute", "No joint has an effort limit"),
        ((0.95, 0.95), "revolute", ""),
        ((1, 10), "revolute", ""),
        ((70, 70), "prismatic", ""),
    ],
)
def test_efforts_that_look_like_placeholders_are_said(efforts, kind, text, tmp_path):
    path = write_efforts(tmp_path, efforts, kind)
    texts = [finding.text for finding in inspect(ng.URDFHand.load(path, ["f0", "f1"])).findings]
    found = [line for line in texts if "placeholder" in line or "effort limit" in line]
    assert len(found) == (text != "")
    assert all(line.startswith(text) for line in found)
    stated = inspect(ng.URDFHand.load(path, ["f0", "f1"], torque_limits=3.0)).findings
    assert not any("placeholder" in finding.text for finding in stated)
