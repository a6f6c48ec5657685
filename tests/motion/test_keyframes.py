"""Keyframes of a grasp, against link spheres computed independently."""

import re
from dataclasses import replace

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.analysis.squeeze import add_squeeze
from nlpgrasp.motion.approach_path import missing_room, open_fingers
from nlpgrasp.motion.keyframes import NO_PREGRASP, START_DISTANCE, plan_keyframes
from nlpgrasp.motion.link_clearance import CollisionModel
from nlpgrasp.motion.penetration import PathPenetration, PenetrationModel
from nlpgrasp.solution.obstructions import LinkPenetration
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
    values, model = problem.hand.values_of(solution.hand["pregrasp"]), CollisionModel(problem, problem.hand)
    lowest = np.min(model.spheres.centres(values)[:, 2] - model.spheres.radii)
    level, sinking = np.array([-1.0, 0.0, 0.0]), np.array([-np.cos(0.3), 0.0, np.sin(0.3)])
    assert missing_room(model, values, [level], 0.2) == ""
    text = missing_room(model, values, [level, sinking], 0.2)
    assert "only the table is in the way, and takes" in text
    room = 0.2 * np.sin(0.3) - (lowest + 0.03 - 0.002)
    assert float(re.search(r"([0-9.]+) mm more room", text)[1]) == pytest.approx(1e3 * room, abs=1.1)
    post = ng.Obstacle(ng.Box([0.04, 0.04, 0.04]), position=[0.15, 0.0, 0.08], name="post")
    named = missing_room(CollisionModel(replace(problem, constraints=(post,)), problem.hand), values, [level], 0.2)
    assert re.search(r"only post is in the way, and takes at least [0-9.]+ mm more room", named)


DEEP = PathPenetration(LinkPenetration(2e-3, "a0"), 2e-3)  # of a link in the body, measured by its own shape
SHALLOW = PathPenetration(LinkPenetration(5e-4, "a0"), 5e-4)  # within the tolerance, deep enough to move the body
NOTHING = PathPenetration(LinkPenetration(), 0.0)


@pytest.mark.slow
def test_fingers_open_less_where_their_own_shapes_run_into_something(tmp_path, monkeypatch):
    full = solve_phases(tmp_path)[0].phases[1].joints

    def measured(_, waypoints, grasp):
        most = max(np.max(np.abs(values["joints"] - grasp["joints"])) for values in waypoints)
        return DEEP if most > 0.6 * largest else NOTHING

    grasp = solve_phases(tmp_path)[0].phases[2].joints
    largest = max(abs(full[joint] - grasp[joint]) for joint in full)
    monkeypatch.setattr(PenetrationModel, "on_approach", measured)
    solution, _ = solve_phases(tmp_path)
    opened = solution.phases[1].joints
    assert solution.phases[1].name == "pregrasp"
    assert max(abs(opened[joint] - grasp[joint]) for joint in opened) == pytest.approx(0.5 * largest, rel=0.02)
    assert solution.way_in.is_free
    assert not solution.touches


@pytest.mark.slow
@pytest.mark.parametrize("others", [NOTHING, SHALLOW])
def test_an_opening_that_would_move_the_body_is_passed_over_where_another_does_not(tmp_path, monkeypatch, others):
    """A link half a millimetre inside the body is within the tolerance, but the body, free to move, gives way."""
    full = solve_phases(tmp_path)[0].phases[1].joints
    grasp = solve_phases(tmp_path)[0].phases[2].joints
    largest = max(abs(full[joint] - grasp[joint]) for joint in full)

    def measured(_, waypoints, grasp):
        most = max(np.max(np.abs(values["joints"] - grasp["joints"])) for values in waypoints)
        return SHALLOW if most > 0.6 * largest else others

    monkeypatch.setattr(PenetrationModel, "on_approach", measured)
    solution, _ = solve_phases(tmp_path)
    opened = solution.phases[1].joints
    share = 0.5 if others == NOTHING else 1.0
    assert max(abs(opened[joint] - grasp[joint]) for joint in opened) == pytest.approx(share * largest, rel=0.02)
    assert solution.way_in.is_free


def test_a_direction_whose_way_is_blocked_by_the_links_own_shapes_is_passed_over(tmp_path, monkeypatch):
    before = solve_phases(tmp_path)[0].hand["approach"]["direction"]

    def measured(_, waypoints, grasp):
        first, second = [*waypoints, grasp][:2]
        moved = second["palm_position"] - first["palm_position"]
        return DEEP if moved @ before > max(0.999 * np.linalg.norm(moved), 0.01) else NOTHING

    monkeypatch.setattr(PenetrationModel, "on_approach", measured)
    solution, _ = solve_phases(tmp_path)
    assert np.dot(solution.hand["approach"]["direction"], before) < 0.999
    assert solution.way_in.is_free
    monkeypatch.setattr(PenetrationModel, "on_approach", lambda *_: DEEP)
    stuck, _ = solve_phases(tmp_path)
    assert stuck.hand["approach"]["direction"] is not None
    assert stuck.touches


def test_fingers_that_cannot_open_leave_the_grasp(tmp_path):
    walls = [
        ng.Obstacle(ng.Box([0.1, 0.002, 0.01]), position=[0.0, s * (0.03 + 2 * TIP + 0.0005), 0.005], name="wall")
        for s in (-1.0, 1.0)
    ]
    solution, _ = solve_phases(tmp_path, walls)
    assert [phase.name for phase in solution.phases] == ["grasp", "squeeze", "lift"]
    assert "the fingers cannot open: fingertip a_tip against wall" in solution.hand["approach"]["reason"]


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


def test_balls_of_links_that_overlap_in_the_grasp_may_do_so_on_the_way(tmp_path):
    """Two balls are asked to be farther apart than in the grasp, as those of links that hardly ever meet may be."""
    solution, problem = grasped(tmp_path)
    hand = problem.hand
    postures = [hand.values_of(solution.hand[key] if key else solution.hand) for key in ("", "pregrasp")]
    model = CollisionModel(problem, hand)
    large = [i for i, link in enumerate(model.spheres.links) if link in ("a0", "b0")]
    centres = model.spheres.centres(postures[0])
    is_pair = np.all(np.isin(model.spheres.pairs, large), axis=1)
    assert np.sum(is_pair) == 1
    model.spheres.pair_distances[is_pair] = np.linalg.norm(centres[large[0]] - centres[large[1]]) + 4e-3
    first = model.clearances(postures[0])[model.pair_mask()]
    assert np.min(first) < -1e-3
    opening = open_fingers(model, *postures, 1.0)
    assert opening.blocked_by == ""
    assert len(opening.postures) > 1
    for posture in opening.postures:
        assert np.all(posture.clearances[model.pair_mask()] >= np.minimum(first, 0.0) - model.tolerance)
