"""Phases that a file states are checked against each other and by other kinematics; edits of them fail."""

from functools import cache

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.solve.phases.keyframes import keyframes
from nlpgrasp.solve.squeeze import with_squeeze
from tests.hands.urdf import FOLDER, three_finger_hand
from tests.verify import honest
from tests.verify.edits import a_little, failures, put
from tests.verify.stated import edited, problem_of, recomputed_file

PHASES = ("hand", "phases")
JOINT = "finger_1_proximal_flexion"


@cache
def data():
    """The sphere among three fingertips; before the grasp the fingers are a little straighter."""
    solution = ng.GraspSolution.from_dict(honest.fingers(), "f.json")
    hand, body = three_finger_hand(), ng.Sphere(solution.problem["body"]["radius"])
    grasp = hand.values_of(solution.hand)
    problem = problem_of(body, 3, hand=hand)
    for step in (-0.05, 0.05):
        opened = {**grasp, "joints": np.clip(grasp["joints"] + step, *hand.tree.joint_limits)}
        found = keyframes(problem, hand, grasp, opened)
        if found["approach"]["direction"] is not None:
            break
    solution.hand.update(found)
    return edited(with_squeeze(solution, hand).to_dict(), lambda d: None)


LIES = {
    "where the palm is in the grasp": put((*PHASES, 2, "palm_pose", "position", 0), a_little),
    "a joint of the grasp": put((*PHASES, 2, "joint_positions", JOINT), a_little),
    "a palm that turns": put((*PHASES, 0, "palm_pose", "quaternion_wxyz"), [1.0, 0.0, 0.0, 0.0]),
    "where the approach begins": put((*PHASES, 0, "palm_pose", "position", 1), a_little),
    "other joints in the approach": put((*PHASES, 0, "joint_positions", JOINT), a_little),
    "the distance": put(("hand", "approach", "distance"), a_little),
    "a commanded joint": put((*PHASES, 3, "joint_positions", JOINT), a_little),
    "a palm that moves in the squeeze": put((*PHASES, 3, "palm_pose", "position", 1), a_little),
    "the lift's distance": put(("hand", "lift", "distance"), 0.3),
    "a joint of the lift": put((*PHASES, 4, "joint_positions", JOINT), a_little),
    "no grasp": put(PHASES, lambda p: [phase for phase in p if phase["name"] != "grasp"]),
}


def test_honest_phases_pass():
    assert [phase["name"] for phase in data()["hand"]["phases"]] == ["approach", "pregrasp", "grasp", "squeeze", "lift"]
    found = recomputed_file(data(), FOLDER)
    for name in ("phases", "approach", "joints"):
        assert found[name].passed, found[name]


@pytest.mark.parametrize("name", LIES)
def test_lies_about_phases(name):
    assert "phases" in failures(edited(data(), LIES[name]), FOLDER)


def test_a_clearance_that_is_not_there():
    lie = put((*PHASES, 1, "clearance"), lambda c: c + 0.001)
    assert failures(edited(data(), lie), FOLDER) == ["approach"]


def test_an_approach_through_the_body():
    """The hand comes from the other side: all follows from the stated direction, which is not free."""

    def through(d):
        way = d["hand"]["approach"]
        before, afar = d["hand"]["phases"][1]["palm_pose"]["position"], d["hand"]["phases"][0]["palm_pose"]
        way["direction"] = [-x for x in way["direction"]]
        afar["position"] = [p - way["distance"] * x for p, x in zip(before, way["direction"], strict=True)]
        d["hand"]["phases"][1]["clearance"] = -1.0

    assert failures(edited(data(), through), FOLDER) == ["links on the way in", "approach"]


def test_joints_past_their_limits():
    lie = put((*PHASES, 1, "joint_positions", JOINT), 9.0)
    assert "joints" in failures(edited(data(), lie), FOLDER)


def test_without_the_urdf_the_approach_is_not_looked_at():
    found = recomputed_file(data())
    assert found["phases"].passed
    assert not found["approach"].made
