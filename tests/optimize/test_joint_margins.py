"""Joint-limit margins: kept in refinement up to their price, else recorded."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.common.deadline import Deadline
from nlpgrasp.optimize.candidate import GraspCandidate
from nlpgrasp.optimize.compiled_problem import CompiledProblem
from nlpgrasp.optimize.joint_margins import JointLimitMargins
from nlpgrasp.optimize.polish import polish
from tests.hands.urdf import four_finger_hand, gripper, three_finger_hand
from tests.verify import honest

AT_LIMIT, NEAR_LIMIT = 0, 4  # joints: one at its lower limit, one 0.01 from its upper one
DISTANCE = 0.01
OPTIONS = ng.SolveOptions(workers=1)


@cache
def posture():
    """Return a solution of three fingertips on a sphere, the hand's values, and limits that two joints are near."""
    solution = ng.GraspSolution.from_dict(honest.fingers(), "f.json")
    values = three_finger_hand().values_of(solution.hand)
    limits = three_finger_hand().tree.joint_limits.copy()
    limits[0, AT_LIMIT], limits[1, NEAR_LIMIT] = values["joints"][AT_LIMIT], values["joints"][NEAR_LIMIT] + DISTANCE
    return solution, values, limits


@cache
def compiled():
    """Return the compiled problem of a hand with these limits."""
    solution, _, limits = posture()
    body, task = ng.Sphere(solution.problem["body"]["radius"]), ng.TaskEllipsoid([1.0] * 3 + [0.05] * 3)
    hand = three_finger_hand().with_limits(limits)
    problem = ng.GraspProblem(body, [ng.SoftContact(0.6, 0.01)] * 3, task, hand=hand, edge_margin=0.0)
    return CompiledProblem(problem, OPTIONS)


def initial_candidate():
    """Return the solution's contacts and hand as a candidate."""
    solution, values, _ = posture()
    return GraspCandidate(solution.faces, solution.grasp.points, values)


def distances_to_limits(candidate):
    """Return the distances of the joints from their limits, (m,), computed independently."""
    limits = posture()[2]
    return np.minimum(candidate.hand["joints"] - limits[0], limits[1] - candidate.hand["joints"])


def polished(problem, **options):
    problem.options = replace(OPTIONS, **options)
    return polish(problem, initial_candidate(), Deadline())


@pytest.mark.slow
def test_joints_keep_their_margins():
    without_margins, result = polished(compiled(), joint_margin=0.0), polished(compiled())
    limits = posture()[2]
    wanted = np.minimum(OPTIONS.joint_margin, 0.1 * (limits[1] - limits[0]))
    assert distances_to_limits(initial_candidate())[AT_LIMIT] == pytest.approx(0.0, abs=1e-12)
    assert np.all(distances_to_limits(result.on_body.candidate) >= (1.0 - 1e-6) * wanted)
    assert result.on_body.is_feasible
    assert result.bounds.upper >= (1.0 - OPTIONS.room_price) * without_margins.bounds.lower


@pytest.mark.slow
def test_joints_whose_margins_cost_too_much_have_their_whole_range():
    """Ranges of 0.1 rad around the hand's joints: margins in all of them cost 8 % of mu."""
    joints = posture()[1]["joints"]
    narrow_limits = np.stack([joints - 0.05, joints + 0.05])
    narrow_hand = compiled().with_joint_limits(narrow_limits)
    without_margins = polished(narrow_hand, joint_margin=0.0).optimum.value

    def polish_at_price(price):
        grasp = polished(narrow_hand, room_price=price)
        kept = np.min(np.abs(grasp.on_body.candidate.hand["joints"] - narrow_limits), axis=0) >= 0.01 * (1.0 - 1e-6)
        return grasp.optimum.value, int(np.sum(kept))

    (at_no_price, _), (at_low_price, some), (at_high_price, all_joints) = map(polish_at_price, (0.0, 0.01, 0.9))
    assert some <= all_joints == len(joints)
    assert at_no_price >= (1.0 - 1e-3) * without_margins
    assert at_low_price >= (1.0 - 0.01) * without_margins
    assert at_high_price <= 0.95 * without_margins


@pytest.mark.slow
@pytest.mark.parametrize("options", [{"joint_margin": 0.0}, {"gap": 0.1}])
def test_without_a_margin_joints_come_near_their_limits(options):
    """Ranges of 0.1 rad around the hand's joints, with margins of a tenth."""
    joints = posture()[1]["joints"]
    limits = np.stack([joints - 0.05, joints + 0.05])
    result = polished(compiled().with_joint_limits(limits), **options)
    assert np.min(np.abs(result.on_body.candidate.hand["joints"] - limits)) < 0.5 * 0.01


def test_margins_are_a_tenth_of_the_range_at_most():
    hand = three_finger_hand().with_limits(np.array([[0.0, -0.2] + [-1.0] * 7, [0.1, 0.2] + [1.0] * 7]))
    assert JointLimitMargins.of(hand, 0.052).wanted == pytest.approx([0.01, 0.04] + [0.052] * 7)
    margins = JointLimitMargins.of(gripper(), 0.052)
    assert margins.wanted == pytest.approx(0.1 * (margins.limits[1] - margins.limits[0]))


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
def test_solve_states_margins_and_verify_agrees(tmp_path):
    body = ng.Ellipsoid([0.04, 0.03, 0.03])
    task = ng.TaskEllipsoid([1.0] * 3 + [0.02] * 3)
    hand = four_finger_hand()
    problem = ng.GraspProblem(body, [ng.FrictionContact(0.6)] * 4, task, hand=hand)
    without_margins, with_margins = (
        ng.solve(problem, 1, options=ng.SolveOptions(workers=1, joint_margin=margin, global_bound=False))
        for margin in (0.0, 0.052)
    )
    assert "room" not in without_margins.hand
    room = with_margins.hand["room"]
    assert with_margins.mu.upper >= (1.0 - 0.03) * without_margins.mu.upper
    limits = dict(zip((j.name for j in hand.robot.free_joints), hand.tree.joint_limits.T, strict=True))
    for joint, (lower, upper) in limits.items():
        distance = min(
            with_margins.hand["joint_positions"][joint] - lower, upper - with_margins.hand["joint_positions"][joint]
        )
        assert joint in room["near"] or distance >= (1.0 - 1e-5) * room["margins"][joint]
    with_margins.save(tmp_path / "on.json")
    assert ng.verify(tmp_path / "on.json")
