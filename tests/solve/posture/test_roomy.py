"""Room between joints and their limits: joints go inside their margins, at the price stated, or are named."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.common.stopping.stop import Stop
from nlpgrasp.solve.posture import roomy
from nlpgrasp.solve.posture.effort import worst_share
from nlpgrasp.solve.posture.margins import Margins
from nlpgrasp.solve.posture.roomy import with_room
from nlpgrasp.solve.squeeze import with_squeeze
from nlpgrasp.solve.start.given import Given, run_given
from nlpgrasp.solve.workbench.placed import Placed
from nlpgrasp.solve.workbench.workbench import Workbench
from tests.hands.urdf import four_finger_hand, gripper, three_finger_hand
from tests.verify import honest

AT, BESIDE = 0, 4  # joints: one at its lower limit, one 0.01 from its upper one
LEFT = 0.01
OPTIONS = ng.SolveOptions(workers=1, exchange=False)


@cache
def posture():
    """A sphere among three fingertips, and limits that two of the joints are near."""
    stated = ng.GraspSolution.from_dict(honest.fingers(), "f.json")
    values = three_finger_hand().values_of(stated.hand)
    limits = three_finger_hand().tree.joint_limits.copy()
    limits[0, AT], limits[1, BESIDE] = values["joints"][AT], values["joints"][BESIDE] + LEFT
    return stated, values, limits


@cache
def found():
    """The workbench of a problem whose hand has these limits, and the grasp there."""
    stated, values, limits = posture()
    body, task = ng.Sphere(stated.problem["body"]["radius"]), ng.TaskEllipsoid([1.0] * 3 + [0.05] * 3)
    hand = three_finger_hand().with_limits(limits)
    problem = ng.GraspProblem(body, [ng.SoftContact(0.6, 0.01)] * 3, task, hand=hand, edge_margin=0.0)
    bench = Workbench(problem, OPTIONS)
    given = Given(Placed(stated.faces, stated.grasp.points, values), stated.grasp.normals)
    return bench, run_given(bench, given, 0, Stop(), improve=False)[0]


def room_of(start):
    """What a start's joints have, (m,), measured here."""
    limits = posture()[2]
    joints = start.found.placed.hand["joints"]
    return np.minimum(joints - limits[0], limits[1] - joints)


def test_joints_go_inside_their_margins():
    bench, start = found()
    roomier = with_room(bench, start, Stop())
    limits = posture()[2]
    wanted = np.minimum(OPTIONS.joint_margin, 0.1 * (limits[1] - limits[0]))
    assert room_of(start)[AT] == pytest.approx(0.0, abs=1e-12)
    assert np.all(room_of(roomier) >= (1.0 - 1e-6) * wanted)
    assert roomier.room.near == {}
    assert roomier.found.allowed
    assert roomier.record.mu.lower >= (1.0 - OPTIONS.room_price) * start.record.mu.lower
    assert roomier.room.cost == pytest.approx(1.0 - roomier.record.mu.upper / start.record.mu.upper)
    assert roomier.record.index == start.record.index
    assert "room" in roomier.record.message


def test_grasp_stays_and_names_its_joints_where_room_costs_too_much():
    bench, start = found()
    dear = replace(start, record=replace(start.record, mu=ng.Bounds(0.9, 0.91)))
    kept = with_room(bench, dear, Stop())
    assert kept.found is start.found
    names = bench.problem.hand.loaded_joints
    assert kept.room.near == pytest.approx({names[AT]: 0.0, names[BESIDE]: LEFT}, abs=1e-12)
    assert kept.room.cost == 0.0


def test_joints_that_cannot_go_inside_leave_the_others_their_room(monkeypatch):
    bench, start = found()
    whole = posture()[2][0, AT]
    own = roomy.touching

    def stuck(bench, placed):
        there, left = own(bench, placed)
        return there, 1.0 if bench.problem.hand.tree.joint_limits[0, AT] > whole else left

    monkeypatch.setattr(roomy, "touching", stuck)
    partly = with_room(bench, start, Stop())
    assert set(partly.room.near) <= {bench.problem.hand.loaded_joints[AT]}
    assert room_of(partly)[BESIDE] >= (1.0 - 1e-6) * 0.052


def test_without_a_margin_nothing_changes():
    bench, start = found()
    bench = bench.with_joints(posture()[2])
    bench.options = replace(OPTIONS, joint_margin=0.0)
    assert with_room(bench, start, Stop()) is start


def test_margins_are_a_tenth_of_the_range_at_most():
    hand = three_finger_hand().with_limits(np.array([[0.0, -0.2] + [-1.0] * 7, [0.1, 0.2] + [1.0] * 7]))
    assert Margins.of(hand, 0.052).wanted == pytest.approx([0.01, 0.04] + [0.052] * 7)
    slides = Margins.of(gripper(), 0.052)
    assert slides.wanted == pytest.approx(0.1 * (slides.limits[1] - slides.limits[0]))


def test_effort_is_that_of_the_squeeze():
    stated = ng.GraspSolution.from_dict(honest.fingers(), "f.json")
    squeezed = with_squeeze(stated, three_finger_hand())
    there = replace(found()[1].found, grasp=stated.grasp)
    assert worst_share(three_finger_hand(), there) == pytest.approx(squeezed.squeeze.joints.worst[1], rel=1e-6)


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
    assert 0.99 * off.mu.upper <= room["mu_without"]["upper"] <= (1.0 + 1e-6) * off.mu.upper  # before its last step
    assert on.mu.upper >= (1.0 - 0.03) * off.mu.upper
    limits = dict(zip((j.name for j in hand.robot.free_joints), hand.tree.joint_limits.T, strict=True))
    for joint, (lower, upper) in limits.items():
        left = min(on.hand["joint_positions"][joint] - lower, upper - on.hand["joint_positions"][joint])
        assert joint in room["near"] or left >= (1.0 - 1e-5) * room["margins"][joint]
    on.save(tmp_path / "on.json")
    assert ng.verify(tmp_path / "on.json")
