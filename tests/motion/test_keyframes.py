"""Keyframes of a grasp, against link spheres computed independently."""

import re
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.analysis.squeeze import add_squeeze
from nlpgrasp.motion.approach_path import missing_room, open_fingers
from nlpgrasp.motion.clearance import HandClearance
from nlpgrasp.motion.keyframes import NO_PREGRASP, START_DISTANCE, plan_keyframes
from tests.studies.held_box import HALF, PALM, grasped
from tests.studies.two_fingers import DOWN, PALM_BALL, TIP, box_distance, chain, in_body

UP = np.eye(3)[2]
RADII = np.array([PALM_BALL, *[0.004, 0.004, 0.004, TIP] * 2])


def solve_phases(folder, constraints=(), opening=0.01):
    """The solution with its phases, up to the grasp and whole."""
    solution, problem = grasped(folder, constraints, opening)
    hand = problem.hand
    postures = [hand.values_of(solution.hand[key] if key else solution.hand) for key in ("", "pregrasp")]
    solution.hand.update(plan_keyframes(problem, hand, *postures))
    return add_squeeze(solution, hand), problem


def balls(phase):
    """Centres of all balls, (9, 3), in the body's frame."""
    fingers = [chain(f, [phase.joints[f"{f}{i}_joint"] for i in range(3)]) for f in "ab"]
    return in_body(np.concatenate([np.zeros((1, 3)), *fingers]), phase.palm_position)


def test_the_phases_of_a_grasp_from_above(tmp_path):
    solution, _ = solve_phases(tmp_path)
    phases = {phase.name: phase for phase in solution.phases}
    assert list(phases) == ["approach", "pregrasp", "grasp", "squeeze", "lift"]
    for phase in phases.values():
        np.testing.assert_allclose(phase.palm_quaternion, DOWN, atol=1e-12)
    for name in ("pregrasp", "grasp", "squeeze"):
        np.testing.assert_allclose(phases[name].palm_position, PALM, atol=1e-12)
    assert phases["pregrasp"].joints == pytest.approx(solution.hand["pregrasp"]["joint_positions"], abs=1e-9)
    assert phases["approach"].joints == phases["pregrasp"].joints
    assert phases["grasp"].joints == solution.hand["joint_positions"]
    assert phases["squeeze"].joints == pytest.approx(solution.squeeze.positions())
    np.testing.assert_allclose(phases["lift"].palm_position, PALM + 0.2 * UP, atol=1e-12)
    assert phases["lift"].joints == phases["squeeze"].joints
    assert [phase.clearance is None for phase in solution.phases] == [True, False, True, True, True]


def test_the_approach_begins_well_before_the_body(tmp_path):
    solution, _ = solve_phases(tmp_path)
    afar, opened = solution.phases[:2]
    approach = solution.hand["approach"]
    np.testing.assert_allclose(approach["direction"], [0.0, 0.0, -1.0], atol=1e-12)
    np.testing.assert_allclose(afar.palm_position, opened.palm_position + approach["distance"] * UP, atol=1e-12)
    lowest = np.min(balls(afar)[:, 2] - RADII)
    assert lowest == pytest.approx(HALF[2] + START_DISTANCE, abs=1e-9)


def test_the_clearance_is_the_least_of_a_dense_path(tmp_path):
    solution, _ = solve_phases(tmp_path, [ng.Table(-0.03, clearance=0.004)])
    afar, opened = solution.phases[:2]
    shifts = np.linspace(0.0, 1.0, 2000)[:, None, None] * (afar.palm_position - opened.palm_position)
    centres = balls(opened) + shifts
    room = np.minimum(box_distance(centres, HALF) - RADII, centres[..., 2] - RADII + 0.03 - 0.004)
    assert np.min(room) - 1e-3 <= opened.clearance <= np.min(room) + 1e-4


def test_a_lid_turns_the_approach_and_ends_the_lift(tmp_path):
    """A plate 40 mm above the palm: the hand comes from the side, and is raised until it is there."""
    plate = ng.Obstacle(ng.Box([0.3, 0.3, 1e-6]), position=[0.0, 0.0, 0.14], name="plate")
    solution, _ = solve_phases(tmp_path, [plate])
    approach, lift = solution.hand["approach"], solution.hand["lift"]
    assert approach["direction"][2] > -0.9
    afar, opened = solution.phases[:2]
    centres = balls(opened) + np.linspace(0.0, 1.0, 2000)[:, None, None] * (afar.palm_position - opened.palm_position)
    assert np.min(box_distance(centres - [0.0, 0.0, 0.14], [0.15, 0.15, 5e-7]) - RADII) >= -2e-4
    assert lift["distance"] == pytest.approx(0.14 - PALM[2] - PALM_BALL, abs=3e-3)
    assert lift["reason"] == "plate is in the way of a lift by 200 mm"
    np.testing.assert_allclose(solution.phases[-1].palm_position, PALM + lift["distance"] * UP, atol=1e-12)


@pytest.mark.slow
def test_without_a_free_direction_the_solution_says_so(tmp_path):
    walls = [
        ng.Obstacle(ng.Box([0.4 if i != axis else 0.002 for i in range(3)]), position=side * 0.12 * np.eye(3)[axis])
        for axis in range(3)
        for side in (-1.0, 1.0)
    ]
    solution, _ = solve_phases(tmp_path, walls)
    assert [phase.name for phase in solution.phases] == ["pregrasp", "grasp", "squeeze", "lift"]
    assert solution.hand["approach"]["direction"] is None
    assert re.match(r"none of 88 directions is free for \d+ mm; the longest", solution.hand["approach"]["reason"])
    assert "no free straight way of the palm to the grasp: none of 88" in str(solution)


def test_what_alone_blocks_a_direction_is_named_with_the_room_that_it_takes(tmp_path):
    """A hand that sinks as it leaves the body ends in the table; level it is free, and nothing is named."""
    solution, problem = grasped(tmp_path, [ng.Table(-0.03, clearance=0.002)])
    values, model = problem.hand.values_of(solution.hand["pregrasp"]), HandClearance(problem, problem.hand)
    lowest = -model.parts.extent(values, -UP)
    level, sinking = np.array([-1.0, 0.0, 0.0]), np.array([-np.cos(0.3), 0.0, np.sin(0.3)])
    assert missing_room(model, values, [level], 0.2) == ""
    text = missing_room(model, values, [level, sinking], 0.2)
    assert "only the table is in the way, and takes" in text
    room = 0.2 * np.sin(0.3) - (lowest + 0.03 - 0.002)
    assert float(re.search(r"([0-9.]+) mm more room", text)[1]) == pytest.approx(1e3 * room, abs=1.1)
    post = ng.Obstacle(ng.Box([0.04, 0.04, 0.04]), position=[0.15, 0.0, 0.08], name="post")
    named = missing_room(HandClearance(replace(problem, constraints=(post,)), problem.hand), values, [level], 0.2)
    assert re.search(r"only post is in the way, and takes at least [0-9.]+ mm more room", named)


@pytest.mark.slow
def test_ways_are_free_by_the_links_own_shapes(tmp_path):
    """Between keyframes no ball is deeper in the body than in the grasp, by 0.3 mm at most."""
    solution, _ = solve_phases(tmp_path)
    keyframes = [phase for phase in solution.phases if phase.name in ("approach", "pregrasp", "grasp")]
    depths = []
    for start, end in pairwise(keyframes):
        for share in np.linspace(0.0, 1.0, 500):
            joints = {name: (1.0 - share) * q + share * end.joints[name] for name, q in start.joints.items()}
            position = (1.0 - share) * start.palm_position + share * end.palm_position
            centres = balls(replace(start, joints=joints, palm_position=position))
            depths.append(np.max(RADII - box_distance(centres, HALF)))
    assert max(depths) <= max(depths[-1], 0.0) + 3e-4
    assert solution.way_in.is_free
    assert solution.way_in.depth <= max(depths) + 1e-4


def test_fingers_that_cannot_open_leave_the_grasp(tmp_path):
    walls = [
        ng.Obstacle(ng.Box([0.1, 0.002, 0.01]), position=[0.0, s * (0.03 + 2 * TIP + 0.0005), 0.005], name="wall")
        for s in (-1.0, 1.0)
    ]
    solution, _ = solve_phases(tmp_path, walls)
    assert [phase.name for phase in solution.phases] == ["grasp", "squeeze", "lift"]
    assert re.search("the fingers cannot open: fingertip [ab]_tip against wall", solution.hand["approach"]["reason"])


def test_fingers_that_open_one_by_one_stop_where_the_straight_way_ends(tmp_path):
    wall = ng.Obstacle(ng.Box([0.1, 0.002, 0.01]), position=[0.0, -0.03 - 2 * TIP - 0.005, 0.005], name="wall")
    solution, _ = solve_phases(tmp_path, [wall])
    _, opened, grasp = solution.phases[:3]
    centres = balls(opened) + np.linspace(0.0, 1.0, 500)[:, None, None] * (balls(grasp) - balls(opened))
    gap = box_distance(centres - np.array(wall.position), [0.05, 0.001, 0.005]) - RADII
    assert np.min(gap) >= -1e-3
    assert np.linalg.norm(balls(opened)[4] - balls(grasp)[4]) > 2e-3


def test_without_a_pregrasp_there_is_no_approach(tmp_path):
    solution, problem = grasped(tmp_path)
    keyframes = plan_keyframes(problem, problem.hand, problem.hand.values_of(solution.hand), None)
    assert keyframes["approach"] == {"direction": None, "distance": None, "reason": NO_PREGRASP}
    assert [phase["name"] for phase in keyframes["phases"]] == ["grasp"]


def test_what_penetrates_the_body_in_the_grasp_may_do_so_on_the_way_and_no_deeper(tmp_path):
    """A hand that is 3 mm to one side of its grasp; what is too near to an obstacle does not move."""
    solution, problem = grasped(tmp_path)
    hand = problem.hand
    postures = [hand.values_of(solution.hand[key] if key else solution.hand) for key in ("", "pregrasp")]
    for posture in postures:
        posture["palm_position"] = posture["palm_position"] + [0.0, 3e-3, 0.0]
    model = HandClearance(problem, hand)
    first = model.clearances(postures[0])
    assert np.min(first) == pytest.approx(-3e-3, abs=1e-6)
    opening = open_fingers(model, *postures, 1.0)
    assert opening.blocked_by == ""
    assert len(opening.postures) > 1
    for posture in opening.postures:
        assert np.all(posture.clearances >= np.minimum(first, 0.0) - model.tolerance)
    plate = ng.Obstacle(ng.Box([0.3, 0.3, 0.01]), 4e-3, [0.0, 0.0, model.parts.extent(postures[0], UP) + 6e-3])
    under_plate = HandClearance(replace(problem, constraints=(plate,)), hand)
    assert open_fingers(under_plate, *postures, 1.0).blocked_by == "link palm against obstacle"
