"""Checks of a hand's stated phases, approach and lift, and of edits of them."""

from functools import cache

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.analysis.squeeze import add_squeeze
from nlpgrasp.motion.keyframes import plan_keyframes
from tests.hands.urdf import FOLDER, three_finger_hand
from tests.studies.held_box import grasped
from tests.verify import honest
from tests.verify.edits import a_little, failures, put, together
from tests.verify.stated import edited, problem_of, recomputed_file

PHASES = ("hand", "phases")
JOINT = "finger_1_proximal_flexion"


@cache
def data():
    """The sphere among three fingertips; before the grasp the fingers are a little straighter."""
    solution = ng.GraspSolution.from_dict(edited(honest.fingers(), lambda d: None), "f.json")
    hand, body = three_finger_hand(), ng.Sphere(solution.problem["body"]["radius"])
    grasp = hand.values_of(solution.hand)
    problem = problem_of(body, 3, hand=hand)
    for step in (-0.05, 0.05):
        opened = {**grasp, "joints": np.clip(grasp["joints"] + step, *hand.tree.joint_limits)}
        keyframes = plan_keyframes(problem, hand, grasp, opened)
        if keyframes["approach"]["direction"] is not None:
            break
    solution.hand.update(keyframes)
    return edited(add_squeeze(solution, hand).to_dict(), lambda d: None)


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
    checks = recomputed_file(data(), FOLDER)
    for name in ("phases", "approach", "lift", "joints"):
        assert checks[name].passed, checks[name]


@pytest.mark.usefixtures("without_link_checks")
@pytest.mark.parametrize("name", LIES)
def test_lies_about_phases(name):
    assert "phases" in failures(edited(data(), LIES[name]), FOLDER)


@pytest.mark.usefixtures("without_link_checks")
def test_a_clearance_that_is_not_there():
    lie = put((*PHASES, 1, "clearance"), lambda c: c + 0.001)
    assert failures(edited(data(), lie), FOLDER) == ["approach"]


@pytest.mark.slow
def test_an_approach_through_the_body():
    """The hand comes from the other side: all follows from the stated direction, which is not free."""

    def through(d):
        approach = d["hand"]["approach"]
        pregrasp_position, start = d["hand"]["phases"][1]["palm_pose"]["position"], d["hand"]["phases"][0]["palm_pose"]
        approach["direction"], approach["distance"] = [-x for x in approach["direction"]], 0.03
        start["position"] = [
            p - approach["distance"] * x for p, x in zip(pregrasp_position, approach["direction"], strict=True)
        ]
        d["hand"]["phases"][1]["clearance"] = -1.0

    assert failures(edited(data(), through), FOLDER) == ["links on the way in"]


NEW = put(("solver", "options"), {"link_tolerance": 1e-3})  # among the options of a solve of this version
NO_WAY = {"direction": None, "distance": None, "reason": "none of 88 directions is free for 100 mm"}


def caged(data):
    """State that no direction is free."""
    NEW(data)
    data["hand"]["approach"] = dict(NO_WAY)
    data["hand"]["phases"] = data["hand"]["phases"][1:]


def without_phases(data):
    del data["hand"]["phases"], data["hand"]["lift"]


CONCEALED = {
    "the statement": lambda d: d["hand"].pop("approach"),
    "the reason": lambda d: d["hand"]["approach"].pop("reason"),
    "the reason's words": put(("hand", "approach", "reason"), " "),
    "the statement and the phases": together(without_phases, lambda d: d["hand"].pop("approach")),
    "all but a direction": together(without_phases, put(("hand", "approach"), {"direction": [0.0, 0.0, 1.0]})),
}


@pytest.mark.usefixtures("without_link_checks")
def test_ways_in_that_are_stated_pass():
    assert recomputed_file(edited(data(), NEW), FOLDER)["way in"].passed
    check = recomputed_file(edited(data(), caged), FOLDER)["way in"]
    assert check.passed
    assert check.detail == NO_WAY["reason"]


@pytest.mark.usefixtures("without_link_checks")
@pytest.mark.parametrize("name", CONCEALED)
def test_a_blocked_way_in_that_is_left_out_fails(name):
    assert "way in" in failures(edited(data(), together(caged, CONCEALED[name])), FOLDER)


@pytest.mark.usefixtures("without_link_checks")
def test_files_of_earlier_versions_may_leave_the_way_in_out():
    old = together(caged, lambda d: d["solver"].pop("options"), lambda d: d["hand"].pop("approach"))
    assert "way in" not in recomputed_file(edited(data(), old), FOLDER)


LID = ng.Obstacle(ng.Box([0.3, 0.3, 0.004]), position=[0.0, 0.0, 0.14], name="lid")
BESIDE = ng.Obstacle(ng.Box([0.3, 0.3, 0.004]), position=[0.0, 0.0, -0.14], name="below")


def held(folder, *constraints):
    """A box that two fingers hold from above, with its phases."""
    solution, problem = grasped(folder, constraints)
    postures = [problem.hand.values_of(solution.hand[key] if key else solution.hand) for key in ("", "pregrasp")]
    solution.hand.update(plan_keyframes(problem, problem.hand, *postures))
    return edited(solution.to_dict(), lambda d: None)


@pytest.mark.usefixtures("without_link_checks")
@pytest.mark.parametrize("constraint", [LID, BESIDE, ng.Table(-0.015, clearance=0.004)])
def test_an_honest_lift_and_an_honest_way_in_pass(constraint, tmp_path):
    data = held(tmp_path, constraint)
    checks = recomputed_file(data, tmp_path)
    assert checks["lift"].passed, checks["lift"]
    assert checks["approach"].passed, checks["approach"]
    assert (data["hand"]["lift"]["distance"] < 0.2) == (constraint is LID)


@pytest.mark.usefixtures("without_link_checks")
def test_a_lift_through_a_lid_fails(tmp_path):
    data = held(tmp_path, LID)
    free = data["hand"]["lift"]["distance"]
    check = recomputed_file(edited(data, put(("hand", "lift", "distance"), free + 0.006)), tmp_path)["lift"]
    assert check.failed
    assert "lid is in the way" in check.detail
    down = put(("hand", "lift"), {"direction": [0.0, 0.0, -1.0], "distance": 0.2})
    assert "lift" in failures(edited(held(tmp_path, ng.Table(-0.016)), down), tmp_path)


@pytest.mark.usefixtures("without_link_checks")
def test_a_body_that_is_lifted_through_a_lid_fails(tmp_path):
    """The lid reaches over the body alone, which goes through it."""
    lid = ng.Obstacle(ng.Box([0.01, 0.01, 0.004]), position=[0.025, 0.0, 0.03], name="lid")
    data = held(tmp_path, lid)
    assert data["hand"]["lift"]["distance"] == pytest.approx(0.03 - 0.002 - 0.015, abs=2e-3)
    assert recomputed_file(data, tmp_path)["lift"].passed
    assert "lift" in failures(edited(data, put(("hand", "lift", "distance"), 0.2)), tmp_path)


@pytest.mark.usefixtures("without_link_checks")
def test_an_approach_through_an_obstacle_fails(tmp_path):
    """The way from above that was free is stated though a lid has been put there."""
    data = held(tmp_path)
    lid = {**LID.to_dict(), "position": [0.0, 0.0, 0.12]}
    checks = recomputed_file(edited(data, lambda d: d["problem"]["constraints"].append(lid)), tmp_path)
    assert "deep in lid on the way" in checks["approach"].detail


def test_fingers_that_cannot_open_state_no_way_in(tmp_path):
    solution, problem = grasped(tmp_path)
    solution.hand.update(plan_keyframes(problem, problem.hand, problem.hand.values_of(solution.hand), None))
    checks = recomputed_file(edited(solution.to_dict(), NEW), tmp_path)
    assert checks["links on the way in"].passed, checks["links on the way in"]
    assert checks["way in"].passed, checks["way in"]


@pytest.mark.usefixtures("without_link_checks")
def test_joints_past_their_limits():
    lie = put((*PHASES, 1, "joint_positions", JOINT), 9.0)
    assert "joints" in failures(edited(data(), lie), FOLDER)


def test_without_the_urdf_the_approach_is_not_looked_at():
    checks = recomputed_file(data())
    assert checks["phases"].passed
    assert not checks["approach"].made
