"""Checks of a joint-torque budget against the hand's Jacobians and limits."""

from functools import cache

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.verify.numeric_urdf_hand import urdf
from nlpgrasp.verify.sources import SourceFolders
from tests.hands.urdf import FOLDER, THREE, THREE_TIPS, four_finger_hand, gripper, three_finger_hand
from tests.verify import honest
from tests.verify.edits import failures, put, together
from tests.verify.stated import edited, recomputed_file

BUDGET = ("problem", "force_budget")


@pytest.mark.parametrize("make", [four_finger_hand, three_finger_hand, gripper])
def test_jacobians_are_those_of_the_program(make, rng):
    hand = make()
    values = {name: v[0] for name, v in hand.draw(1, np.zeros((1, 3)), rng)[0].items()}
    points = rng.standard_normal((hand.count, 3))
    twin = urdf(hand.to_dict(), hand.describe(values), {}, SourceFolders((FOLDER,)))
    jacobians = twin.contact_jacobians(points)
    assert tuple(jacobians) == hand.loaded_joints
    expected = hand.contact_jacobians(values, points)
    np.testing.assert_allclose(np.stack(list(jacobians.values()), axis=2), expected, atol=1e-12)


@cache
def torques():
    """Fingertips of a hand with torque limits, and the file's budget."""
    data = honest.fingers()
    hand = ng.URDFHand.load(THREE, THREE_TIPS, torque_limits=0.5)
    points = [c["position"] for c in data["grasp"]["contacts"]]

    def change(d):
        d["problem"]["hand"]["torque_limits"] = dict(hand.torque_limits)
        d["problem"]["force_budget"] = ng.hand_torque_limits(hand, d["hand"], points, 50.0).to_dict()

    return edited(data, change)


def doubled(values):
    return (2.0 * np.array(values)).tolist()


LIES = {
    "Jacobians": put((*BUDGET, "jacobians"), doubled),
    "limits": put((*BUDGET, "limits"), doubled),
    "Jacobians and limits": together(put((*BUDGET, "jacobians"), doubled), put((*BUDGET, "limits"), doubled)),
    "a limit of the hand": put(("problem", "hand", "torque_limits", "finger_1_proximal_flexion"), 0.6),
    "one Jacobian": put((*BUDGET, "jacobians", 0, 0, 0), lambda v: v + 1e-4),
    "a joint left out": together(
        put((*BUDGET, "jacobians"), lambda J: np.array(J)[:, :, 1:].tolist()), put((*BUDGET, "limits"), lambda v: v[1:])
    ),
    "no limit on forces": put((*BUDGET, "force_limit"), None),
    "joints of each contact's own": put(
        BUDGET, lambda b: {"type": "joint_torques", "jacobians": b["jacobians"], "limits": [b["limits"]] * 3}
    ),
}


@pytest.mark.usefixtures("without_link_checks")
@pytest.mark.parametrize("name", LIES)
def test_lies_about_torques(name):
    assert failures(edited(torques(), LIES[name]), FOLDER) == ["joint torques"]


@pytest.mark.usefixtures("without_link_checks")
def test_limits_that_are_not_the_urdfs_are_the_problems_own():
    checks = recomputed_file(torques(), FOLDER)
    assert checks["joint torques"].passed
    assert not checks["torque limits"].made
    hand = three_finger_hand()

    def efforts(d):
        d["problem"]["hand"]["torque_limits"] = dict(hand.torque_limits)
        d["problem"]["force_budget"]["limits"] = [hand.torque_limits[joint] for joint in hand.loaded_joints]

    assert recomputed_file(edited(torques(), efforts), FOLDER)["torque limits"].passed


def test_without_the_urdf_torques_are_not_made():
    check = recomputed_file(torques())["joint torques"]
    assert not check.made
    assert "three_finger_hand.urdf is not beside the file" in check.detail


def test_torques_of_contacts_without_a_hand_are_the_problems_own():
    data = edited(
        honest.jaws(),
        put(BUDGET, {"type": "joint_torques", "jacobians": [np.eye(6).tolist()] * 2, "limits": [1.0] * 2}),
    )
    assert not recomputed_file(data)["joint torques"].made
