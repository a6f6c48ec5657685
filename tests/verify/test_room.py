"""Checks of stated joint-limit margins, and of edits of them."""

from functools import cache

import pytest

import nlpgrasp as ng
from nlpgrasp.optimize.joint_margins import JointLimitMargins
from nlpgrasp.solution.analysis_records import JointMargins, format_joint_margins
from nlpgrasp.solution.records import StartRecord, Status
from nlpgrasp.verify.outcome_checks import outcome_checks
from tests.hands.urdf import FOLDER, three_finger_hand
from tests.verify import honest
from tests.verify.edits import failures, put
from tests.verify.stated import edited, recomputed_file

ROOM = ("hand", "room")
MARGIN = 0.5  # a tenth of each range, so that some joints are near their limits
JOINT = "finger_1_swing"
FIRST = ng.Bounds(0.1, 0.2)


@cache
def data():
    """A sphere among three fingertips whose solve, of an earlier version, gave 2 % of mu for room."""
    solution = ng.GraspSolution.from_dict(honest.fingers(), "f.json")
    hand = three_finger_hand()
    margins, joints = JointLimitMargins.of(hand, MARGIN), hand.values_of(solution.hand)["joints"]
    values = [
        dict(zip(margins.names, v.tolist(), strict=True)) for v in (margins.wanted, margins.distances_to_limits(joints))
    ]
    mu_without = ng.Bounds(FIRST.lower / 0.98, FIRST.upper / 0.98)
    room = JointMargins(MARGIN, *values, 0.03).to_dict()
    room |= {"cost": 0.02, "mu_without": {"lower": mu_without.lower, "upper": mu_without.upper}}

    def with_room(data):
        data["hand"]["room"], data["best_start"] = room, 0
        faces = tuple(solution.faces)
        starts = [StartRecord(i, Status.SOLVED, faces, mu) for i, mu in enumerate((FIRST, ng.Bounds(0.19, 0.2)))]
        data["solver"]["options"] = {**ng.SolveOptions().to_dict(), "joint_margin": MARGIN}
        data["solver"]["starts"] = [start.to_dict() for start in starts]

    return edited(solution.to_dict(), with_room)


def test_honest_room_passes():
    checks = recomputed_file(data(), FOLDER)
    assert checks["price of room"].passed, checks["price of room"]
    assert checks["room of joints"].passed, checks["room of joints"]


@pytest.mark.usefixtures("without_link_checks")
def test_honest_room_without_a_cost_passes():
    def later(data):
        del data["hand"]["room"]["cost"], data["hand"]["room"]["mu_without"]

    checks = recomputed_file(edited(data(), later), FOLDER)
    assert checks["price of room"].passed, checks["price of room"]
    assert checks["room of joints"].passed, checks["room of joints"]


def name_a_joint(data):
    data["hand"]["room"]["near"][JOINT] = 0.01


LIES = {
    "a wider margin": ("room of joints", put((*ROOM, "margins", JOINT), 0.3)),
    "a joint that has its margin": ("room of joints", name_a_joint),
    "the cost": ("price of room", put((*ROOM, "cost"), 0.0)),
    "more than the price": ("price of room", put((*ROOM, "mu_without"), {"lower": 0.11, "upper": 0.22})),
    "another price": ("price of room", put(("solver", "options"), {"room_price": 0.01})),
}


@pytest.mark.usefixtures("without_link_checks")
@pytest.mark.parametrize("lie", LIES)
def test_lies_about_room(lie):
    check, change = LIES[lie]
    assert check in failures(edited(data(), change), FOLDER)


@pytest.mark.usefixtures("without_link_checks")
def test_joints_near_a_limit_that_are_not_named_fail():
    joint = min(data()["hand"]["room"]["margins"])
    lower = dict(
        zip(JointLimitMargins.of(three_finger_hand(), 0.1).names, three_finger_hand().tree.joint_limits[0], strict=True)
    )
    moved = edited(data(), put(("hand", "joint_positions", joint), float(lower[joint]) + 0.01))
    assert "not named" in recomputed_file(moved, FOLDER)["room of joints"].detail


def test_winner_may_be_below_another_start_by_what_room_took():
    def with_mu(bounds):
        starts = put(("solver", "starts", 1, "mu"), {"lower": bounds.lower, "upper": bounds.upper})
        return ng.GraspSolution.from_dict(edited(data(), starts), "f.json")

    assert [c.passed for c in outcome_checks(with_mu(ng.Bounds(0.202, 0.203)))] == [True]
    assert [c.passed for c in outcome_checks(with_mu(ng.Bounds(0.205, 0.206)))] == [False]


def test_room_is_told_where_it_cost_or_lacks():
    stated = data()["hand"]["room"]
    assert format_joint_margins(stated) == ["room to the joints' limits took 2.0% of mu"]
    near = {**stated, "near": {JOINT: 0.0123}, "cost": 0.001}
    assert format_joint_margins(near) == ["joints near a limit: finger_1_swing (0.012 of 0.12)"]
