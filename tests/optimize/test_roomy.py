"""Room between joints and their limits: joints go inside their margins, at the price stated, or are named."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.common.deadline import Deadline
from nlpgrasp.optimize import refine as roomy
from nlpgrasp.optimize.candidate import GraspCandidate
from nlpgrasp.optimize.compiled_problem import CompiledProblem
from nlpgrasp.optimize.local_search import refine
from nlpgrasp.optimize.refine import JointLimitMargins, refine_with_margins
from tests.hands.urdf import four_finger_hand, gripper, three_finger_hand
from tests.verify import honest

AT, BESIDE = 0, 4  # joints: one at its lower limit, one 0.01 from its upper one
LEFT = 0.01
OPTIONS = ng.SolveOptions(workers=1)


@cache
def posture():
    """A sphere among three fingertips, and limits that two of the joints are near."""
    stated = ng.GraspSolution.from_dict(honest.fingers(), "f.json")
    values = three_finger_hand().values_of(stated.hand)
    limits = three_finger_hand().tree.joint_limits.copy()
    limits[0, AT], limits[1, BESIDE] = values["joints"][AT], values["joints"][BESIDE] + LEFT
    return stated, values, limits


@cache
def compiled():
    """The workbench of a problem whose hand has these limits."""
    stated, _, limits = posture()
    body, task = ng.Sphere(stated.problem["body"]["radius"]), ng.TaskEllipsoid([1.0] * 3 + [0.05] * 3)
    hand = three_finger_hand().with_limits(limits)
    problem = ng.GraspProblem(body, [ng.SoftContact(0.6, 0.01)] * 3, task, hand=hand, edge_margin=0.0)
    return CompiledProblem(problem, OPTIONS)


def begun():
    stated, values, _ = posture()
    return GraspCandidate(stated.faces, stated.grasp.points, values)


def room_of(candidate):
    """What joints have, (m,), measured here."""
    limits = posture()[2]
    return np.minimum(candidate.hand["joints"] - limits[0], limits[1] - candidate.hand["joints"])


def test_joints_go_inside_their_margins():
    whole = refine(compiled(), begun(), Deadline())
    _, refined = refine_with_margins(compiled(), begun(), Deadline())
    limits = posture()[2]
    wanted = np.minimum(OPTIONS.joint_margin, 0.1 * (limits[1] - limits[0]))
    assert room_of(begun())[AT] == pytest.approx(0.0, abs=1e-12)
    assert np.all(room_of(refined.point.candidate) >= (1.0 - 1e-6) * wanted)
    assert compiled().violation(refined.point.candidate) <= 1e-5
    assert refined.point.value >= (1.0 - OPTIONS.room_price) * whole.point.value


def test_joints_whose_room_costs_too_much_have_their_whole_range():
    """Ranges of 0.1 rad around where the hand is: room in all of them takes 8 % of mu."""
    joints = posture()[1]["joints"]
    narrow = np.stack([joints - 0.05, joints + 0.05])
    there = compiled().with_joints(narrow)
    whole = refine(there, begun(), Deadline()).point.value

    def priced(price):
        there.options = replace(OPTIONS, room_price=price)
        own, refined = refine_with_margins(there, begun(), Deadline())
        return refined.point.value, int(np.sum(own.problem.hand.tree.joint_limits[0] > narrow[0]))

    (free, none), (little, some), (much, every) = map(priced, (0.0, 0.01, 0.9))
    assert none == 0 < some < every == 9
    assert free >= (1.0 - 1e-3) * whole
    assert little >= (1.0 - 0.01) * whole
    assert much <= 0.95 * whole


def test_joints_that_cannot_go_inside_leave_the_others_their_room(monkeypatch):
    whole = posture()[2][0, AT]
    own = roomy.project_onto_constraints

    def stuck(compiled, candidate):
        there, left = own(compiled, candidate)
        return there, 1.0 if compiled.problem.hand.tree.joint_limits[0, AT] > whole else left

    monkeypatch.setattr(roomy, "project_onto_constraints", stuck)
    limits = posture()[2].copy()
    limits[1, BESIDE] += 1.0
    own_bench, _ = refine_with_margins(compiled().with_joints(limits), begun(), Deadline())
    kept = own_bench.problem.hand.tree.joint_limits
    assert kept[0, AT] == whole
    assert np.all(kept[0, 1:] > limits[0, 1:])


@pytest.mark.parametrize("options", [{"joint_margin": 0.0}, {"gap": 0.1}])
def test_without_a_margin_nothing_changes(options):
    there = compiled().with_joints(posture()[2])
    there.options = replace(OPTIONS, **options)
    own, refined = refine_with_margins(there, begun(), Deadline())
    assert own is there
    assert refined.point.value == refine(there, begun(), Deadline()).point.value


def test_margins_are_a_tenth_of_the_range_at_most():
    hand = three_finger_hand().with_limits(np.array([[0.0, -0.2] + [-1.0] * 7, [0.1, 0.2] + [1.0] * 7]))
    assert JointLimitMargins.of(hand, 0.052).wanted == pytest.approx([0.01, 0.04] + [0.052] * 7)
    slides = JointLimitMargins.of(gripper(), 0.052)
    assert slides.wanted == pytest.approx(0.1 * (slides.limits[1] - slides.limits[0]))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"joint_margin": -0.1}, "joint_margin"),
        ({"joint_margin": "wide"}, "joint_margin"),
        ({"room_price": -0.1}, "room_price"),
        ({"room_price": 1.0}, "a share below 1"),
    ],
)
def test_bad_options(options, message):
    with pytest.raises(ng.InputError, match=message):
        ng.SolveOptions(**options)


@pytest.mark.slow
def test_solve_states_room_and_verify_agrees(tmp_path):
    body = ng.Ellipsoid([0.04, 0.03, 0.03])
    task = ng.TaskEllipsoid([1.0] * 3 + [0.02] * 3)
    hand = four_finger_hand()
    problem = ng.GraspProblem(body, [ng.FrictionContact(0.6)] * 4, task, hand=hand)
    off, on = (
        ng.solve(problem, 2, options=ng.SolveOptions(workers=1, joint_margin=margin, global_bound=False))
        for margin in (0.0, 0.052)
    )
    assert "room" not in off.hand
    room = on.hand["room"]
    assert on.mu.upper >= (1.0 - 0.03) * off.mu.upper
    limits = dict(zip((j.name for j in hand.robot.free_joints), hand.tree.joint_limits.T, strict=True))
    for joint, (lower, upper) in limits.items():
        left = min(on.hand["joint_positions"][joint] - lower, upper - on.hand["joint_positions"][joint])
        assert joint in room["near"] or left >= (1.0 - 1e-5) * room["margins"][joint]
    on.save(tmp_path / "on.json")
    assert ng.verify(tmp_path / "on.json")
