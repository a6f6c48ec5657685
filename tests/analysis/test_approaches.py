"""Poses of a gripper at the contacts of a grasp, and grasps kept with their turns and flips."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import nlpgrasp as ng
from nlpgrasp.motion.jaw_clearance import JawClearance
from nlpgrasp.solution.kept_grasps import DISTINCT_ANGLE, angle_between_poses
from nlpgrasp.solution.obstructions import approach_obstructions
from tests.verify.edits import failed
from tests.verify.stated import edited

OPTIONS = ng.SolveOptions(workers=1, rounds=0, global_bound=False, final_rtol=0.05)
BOX = ng.Box([0.08, 0.04, 0.06])
TASK = ng.TaskEllipsoid([4.0, 4.0, 4.0, 0.08, 0.08, 0.08])
JAWS = ng.ParallelJaw(0.06, finger_length=0.06, finger_thickness=0.01)


def solve(keep=1, hand=JAWS, **fields):
    problem = ng.GraspProblem(BOX, ng.SoftContact(0.6, 0.005), TASK, hand=hand, **fields)
    return ng.solve(problem, 1, options=OPTIONS, keep=keep)


def verified(data):
    return ng.verify(ng.GraspSolution.from_dict(data))


@pytest.fixture(scope="module")
def standing():
    """A box on a table, with a few kept grasps."""
    return solve(keep=4, constraints=[ng.Table.under(BOX, 0.001)])


def test_poses_turn_about_the_closing_line_and_flip(standing):
    poses = ng.approaches(standing, turns=8)
    assert len(poses) == 16
    p, q = standing.grasp.points
    closing = (q - p) / np.linalg.norm(q - p)
    for pose in poses:
        np.testing.assert_allclose(pose.matrix[:3] @ [0.0, 0.0, 0.06, 1.0], 0.5 * (p + q), atol=1e-9)
        np.testing.assert_allclose(pose.rotation[:, 2], pose.direction, atol=1e-9)
        np.testing.assert_allclose(pose.rotation[:, 0], -closing if pose.flip else closing, atol=1e-9)
    assert [pose.is_free for pose in poses] == sorted((pose.is_free for pose in poses), reverse=True)
    assert {pose.is_free for pose in poses} == {True, False}  # from below the table is in the way
    assert all("the table" in pose.blocked_by for pose in poses if pose.direction[2] > 0.5)


@pytest.mark.slow
def test_cones_leave_their_directions_alone():
    coned = solve(constraints=[ng.Approach([0, 0, -1], 0.35)])
    assert all(pose.direction[2] <= -np.cos(0.36) for pose in ng.approaches(coned))


@pytest.mark.slow
def test_slides_move_the_pads_over_small_contacts(standing):
    padded = ng.ParallelJaw(0.06, pad=(0.02, 0.01), finger=(0.06, 0.01, 0.01))
    solution = solve(hand=padded)
    slides = {pose.slide for pose in ng.approaches(solution, turns=4)}
    assert slides == {0.0, 0.005, -0.005}
    with pytest.raises(ng.InputError, match="half a pad's length"):
        ng.approaches(solution, slides=[0.02])
    with pytest.raises(ng.InputError, match="half a pad's length, 0 m"):
        ng.approaches(standing, slides=[0.001])


@pytest.mark.slow
def test_twenty_kept_grasps_are_free_and_distinct_by_place_turn_or_flip():
    grasps, least = solve(keep=20, constraints=[ng.Table.under(BOX, 0.001)]).grasps, 0.1 * BOX.size
    assert len(grasps) == 20
    for i, a in enumerate(grasps):
        assert not approach_obstructions(a.hand)
        for b in grasps[:i]:
            distance = min(
                np.linalg.norm(a.grasp.points - q, axis=1).max() for q in (b.grasp.points, b.grasp.points[::-1])
            )
            assert distance > least or angle_between_poses(a.hand, b.hand) >= DISTINCT_ANGLE
    assert all(grasp.grip_force is not None for grasp in grasps)


@pytest.mark.slow
def test_files_with_turns_and_flips_are_verified():
    """A narrow cone leaves one turn: two poses of each place, the second flipped."""
    coned = solve(keep=24, constraints=[ng.Table.under(BOX, 0.001), ng.Approach([0, 0, -1], 0.2)])
    flips = [i for i, grasp in enumerate(coned.grasps) if grasp.hand["approach"].get("flip")]
    assert flips
    assert ng.verify(coned).passed, ng.verify(coned)
    lie = edited(coned.to_dict(), lambda d: d["grasps"][flips[0]]["hand"]["approach"].pop("flip"))
    assert f"grasps[{flips[0]}]" in failed(verified(lie))
    pose = coned.grasps[flips[0]].hand["palm_pose"]
    turn = Rotation.from_quat(pose["quaternion_wxyz"], scalar_first=True)
    p, q = coned.grasps[flips[0]].grasp.points
    np.testing.assert_allclose(turn.apply([1.0, 0.0, 0.0]), (p - q) / np.linalg.norm(p - q), atol=1e-9)


def test_alternatives_in_another_order_fail(standing):
    assert len({grasp.mu.lower for grasp in standing.others}) > 1

    def swap(data):
        data["grasps"][1], data["grasps"][-1] = data["grasps"][-1], data["grasps"][1]

    check = {c.name: c for c in verified(edited(standing.to_dict(), swap)).checks}["grasps kept"]
    assert check.failed
    assert "which is of higher quality" in check.detail


def test_a_blocked_alternative_before_a_free_one_fails(standing):
    def block_first(data):
        data["grasps"][1]["hand"]["approach"] |= {"depth": 0.005}

    check = {c.name: c for c in verified(edited(standing.to_dict(), block_first)).checks}["grasps kept"]
    assert "grasps[1] ranks before grasps[2], which is with a free way in" in check.detail


def test_the_same_pose_twice_is_found(standing):
    data = edited(standing.to_dict(), lambda d: d["grasps"].__setitem__(1, {**d["grasps"][0], "start": None}))
    assert "grasps kept" in failed(verified(data))


@pytest.mark.slow
def test_free_grasps_come_before_blocked_ones_and_the_answer_is_free():
    """Walls beside the best pair of sides leave no room for fingers there."""
    walls = [ng.Obstacle(ng.Box([0.2, 0.02, 0.3]), position=[0.0, side * 0.035, 0.0]) for side in (1, -1)]
    walled = solve(keep=4, hand=ng.ParallelJaw(0.1, finger_length=0.06, finger_thickness=0.01), constraints=walls)
    free = [not approach_obstructions(grasp.hand) for grasp in walled.grasps]
    assert free[0]
    assert free == sorted(free, reverse=True)
    assert ng.verify(walled).passed, ng.verify(walled)


def pads_of(grasp):
    """Return the direction of the pads of a grasp, the same for both."""
    first, second = (model.direction for model in grasp.grasp.contacts)
    assert first == second
    return np.array(first)


@pytest.mark.slow
def test_pads_turn_about_the_closing_line_where_free_grasps_are_missing():
    """A bar has few distinct places for pads: the others are turns at the same contacts, certified for turned pads."""
    gripper = ng.ParallelJaw(0.06, pad=(0.02, 0.012), finger=(0.06, 0.012, 0.016), max_force=120.0)
    bar = ng.Box([0.04, 0.15, 0.03])
    problem = ng.GraspProblem(bar, task=TASK, hand=gripper, force_budget="shared")
    options = ng.SolveOptions(workers=1, rounds=0, global_bound=False, final_rtol=0.05)
    solution = ng.solve(problem, 1, options=options, keep=12, distinct=0.4)
    turned = [i for i, grasp in enumerate(solution.grasps) if abs(pads_of(grasp)[2]) < 0.99]
    assert len(solution.grasps) == 12
    assert len(turned) >= 4
    assert not any(approach_obstructions(grasp.hand) for grasp in solution.grasps)
    np.testing.assert_array_equal(pads_of(solution.grasps[0]), problem.models[0].direction)
    for grasp in solution.grasps:
        along = abs(pads_of(grasp) @ grasp.hand["approach"]["direction"])
        np.testing.assert_allclose(along, 1.0, atol=1e-4)
        quality = ng.mu(grasp.grasp, TASK, 0.01, force_budget="shared")
        assert grasp.mu.lower <= quality.upper
        assert quality.lower <= grasp.mu.upper
    assert ng.verify(solution).passed, ng.verify(solution)

    def turn_back(data):
        for contact in data["grasps"][turned[0]]["grasp"]["contacts"]:
            contact["direction"] = [0.0, 0.0, -1.0]

    def widen(data):
        for contact in data["grasps"][turned[0]]["grasp"]["contacts"]:
            contact["extents"] = [0.03, 0.012]

    for lie in (turn_back, widen):
        assert f"grasps[{turned[0]}]" in failed(verified(edited(solution.to_dict(), lie)))


def test_pads_turn_by_multiples_of_30_degrees_within_the_cones():
    gripper = ng.ParallelJaw(0.06, pad=(0.02, 0.012), finger=(0.06, 0.012, 0.016))
    pads = [ng.PlaneContact(extents=(0.02, 0.012), friction=0.5, direction=(0.0, 0.0, -1.0))] * 2
    points = np.array([[0.0, -0.02, 0.0], [0.0, 0.02, 0.0]])
    turned = JawClearance(gripper, BOX, (), pads).turned_approaches(points, pads)
    angles = np.degrees(np.arctan2(turned[:, 0], -turned[:, 2])) % 360.0
    np.testing.assert_allclose(np.sort(angles), [30, 60, 90, 120, 150, 210, 240, 270, 300, 330], atol=1e-9)
    coned = JawClearance(gripper, BOX, [ng.Approach([0.0, 0.0, -1.0], np.radians(40.0))], pads)
    np.testing.assert_allclose(coned.turned_approaches(points, pads) @ [0.0, 0.0, -1.0], np.cos(np.radians(30.0)))
    assert not len(coned.turned_approaches(points, [ng.SoftContact(0.5, 0.004)] * 2))


def test_other_hands_and_lost_bodies_are_refused(standing):
    solution = ng.solve(ng.GraspProblem(BOX, [ng.FrictionContact(0.5)] * 3, TASK), 1, options=OPTIONS)
    with pytest.raises(ng.InputError, match=r"ng\.ParallelJaw"):
        ng.approaches(solution)
    data = edited(standing.to_dict(), lambda d: d["problem"].update(body={"type": "mesh", "source": None}))
    with pytest.raises(ng.InputError, match="problem: got None"):
        ng.approaches(ng.GraspSolution.from_dict(data))
    loaded = ng.GraspSolution.from_dict(standing.to_dict())
    assert ng.approaches(loaded, turns=4)[0].matrix == pytest.approx(ng.approaches(standing, turns=4)[0].matrix)
