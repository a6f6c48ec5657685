"""Checks of a stated squeeze and its torques, and of edits of them."""

from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.analysis.squeeze import add_squeeze
from nlpgrasp.verify.force_checks import squeeze_checks
from tests.hands.urdf import FOLDER, three_finger_hand
from tests.verify import honest
from tests.verify.edits import a_little, failures, put, together
from tests.verify.stated import edited, recomputed_file

SQUEEZE = ("hand", "squeeze")
JOINT = "finger_1_proximal_flexion"


@cache
def data():
    solution = ng.GraspSolution.from_dict(honest.fingers(), "f.json")
    return edited(add_squeeze(solution, three_finger_hand()).to_dict(), lambda d: None)


def scaled(factor):
    return lambda v: (factor * np.array(v)).tolist()


def harder(d):
    """Scale all forces, with what follows from them but the torques."""
    for finger in d["hand"]["squeeze"]["fingers"]:
        finger["force"], finger["normal"] = scaled(1.5)(finger["force"]), 1.5 * finger["normal"]


def turned(d):
    """Turn one finger's force without its normal part."""
    finger = d["hand"]["squeeze"]["fingers"][0]
    finger["force"] = (np.array(finger["force"]) + 0.01 * np.array(d["grasp"]["contacts"][0]["tangents"][0])).tolist()


FORCES = {
    "a force": put((*SQUEEZE, "fingers", 0, "force", 1), a_little),
    "a force along the surface": turned,
    "a normal force": put((*SQUEEZE, "fingers", 1, "normal"), a_little),
    "a finger's friction": put((*SQUEEZE, "fingers", 1, "friction"), a_little),
    "friction needed": put((*SQUEEZE, "friction_needed"), lambda v: 0.9 * v + 1e-4),
    "more of the share": put((*SQUEEZE, "share"), lambda v: 1.1 * v + 1e-3),
    "less of the share": put((*SQUEEZE, "share"), lambda v: 0.9 * v),
    "normal force asked for": put((*SQUEEZE, "normal_force"), 2.1),
    "a wrench": put((*SQUEEZE, "wrench", 2), 0.01),
    "residual": put((*SQUEEZE, "residual"), 0.1),
}
TORQUES = {
    "a torque": put((*SQUEEZE, "torques", JOINT), a_little),
    "all torques the other way": put((*SQUEEZE, "torques"), lambda t: {joint: -tau for joint, tau in t.items()}),
    "a Jacobian": put((*SQUEEZE, "jacobians", 0, 0, 0), a_little),
    "a command": put((*SQUEEZE, "positions", JOINT), a_little),
    "the gain": put((*SQUEEZE, "gain"), 6.0),
    "a command left out": put((*SQUEEZE, "positions"), lambda p: {j: v for j, v in p.items() if j != JOINT}),
    "the worst share": put((*SQUEEZE, "worst_share"), lambda v: 0.5 * v),
    "the worst joint": put((*SQUEEZE, "worst_joint"), "finger_2_abduction"),
    "an effort": put(("problem", "hand", "torque_limits", JOINT), lambda v: 0.01 * v),
    "forces without their torques": harder,
}


def test_an_honest_squeeze_passes():
    checks = recomputed_file(data(), FOLDER)
    assert checks["squeeze"].passed, checks["squeeze"]
    assert checks["squeeze torques"].passed, checks["squeeze torques"]


@pytest.mark.usefixtures("without_link_checks")
@pytest.mark.parametrize("name", FORCES)
def test_lies_about_forces(name):
    assert "squeeze" in failures(edited(data(), FORCES[name]), FOLDER)


@pytest.mark.usefixtures("without_link_checks")
@pytest.mark.parametrize("name", TORQUES)
def test_lies_about_torques(name):
    assert failures(edited(data(), TORQUES[name]), FOLDER)[0] == "squeeze torques"  # its phase has commands of them


@pytest.mark.usefixtures("without_link_checks")
def test_two_joints_that_change_places():
    torques = list(data()["hand"]["squeeze"]["torques"].items())
    swapped = put((*SQUEEZE, "torques"), dict([torques[1], torques[0], *torques[2:]]))
    assert failures(edited(data(), swapped), FOLDER)[0] == "squeeze torques"


def test_without_the_urdf_torques_are_not_made():
    checks = recomputed_file(data())
    assert checks["squeeze"].passed
    assert not checks["squeeze torques"].made
    assert "three_finger_hand.urdf is not beside the file" in checks["squeeze torques"].detail


def wedge(half_angle):
    """Two contacts of friction 0.5 on a wedge: a hand squeezes it up to 26.57 degrees."""
    c, s = np.cos(np.radians(half_angle)), np.sin(np.radians(half_angle))
    points, normals = [[0.03, 0.0, 0.0], [-0.03, 0.0, 0.0]], [[-c, s, 0.0], [c, s, 0.0]]
    return ng.Grasp(points, normals, ng.SoftContact(0.5, 0.01))


@pytest.mark.parametrize(("half_angle", "holds"), [(0.0, False), (25.0, False), (27.0, True), (60.0, True)])
def test_that_there_is_no_squeeze_is_refuted_by_forces(half_angle, holds):
    stated = SimpleNamespace(hand={"no_squeeze": {"reason": "contacts 0, 1 cannot press"}})
    (check,) = squeeze_checks(stated, wedge(half_angle), None)
    assert check.passed is holds
    assert check.detail.startswith("none: no forces" if holds else "states that there is none, but forces")


@pytest.mark.usefixtures("without_link_checks")
def test_a_squeeze_and_none_contradict_each_other():
    file_data = edited(data(), put(("hand", "no_squeeze"), {"reason": "contacts 0, 1, 2 cannot press"}))
    assert failures(file_data, FOLDER)[0] == "squeeze"


@pytest.mark.usefixtures("without_link_checks")
def test_a_squeeze_without_torques_is_checked_for_its_forces():
    def forces_alone(d):
        for key in ("torques", "jacobians", "gain", "positions", "worst_joint", "worst_share"):
            d["hand"]["squeeze"].pop(key, None)

    assert recomputed_file(edited(data(), forces_alone), FOLDER)["squeeze"].passed
    file_data = edited(data(), together(forces_alone, FORCES["a force"]))
    assert failures(file_data, FOLDER)[0] == "squeeze"
