"""Palm path to a grasp, against link spheres computed independently on a dense path."""

import itertools
import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import nlpgrasp as ng
from nlpgrasp.motion.approach_path import CLOSER_ANGLES, CLOSER_COUNT
from tests.quick import first
from tests.studies.held_box import BODY, HALF, PALM, grasped
from tests.studies.two_fingers import DOWN, PALM_BALL, TIP, box_distance, chain, in_body


def sphere_positions(path, parts=12):
    """All balls on straight lines from waypoint to waypoint: centres (m, 9, 3) and radii."""
    t = np.linspace(0.0, 1.0, parts, endpoint=False)[:, None]
    origins, joints = (
        np.concatenate([a + t * (b - a) for a, b in itertools.pairwise(v)] + [v[-1:]])
        for v in (path.poses[:, :3, 3], path.joints)
    )
    index = {name: i for i, name in enumerate(path.joint_names)}
    centres = []
    for origin, q in zip(origins, joints, strict=True):
        fingers = [chain(f, [q[index[f"{f}{i}_joint"]] for i in range(3)]) for f in "ab"]
        centres.append(in_body(np.concatenate([np.zeros((1, 3)), *fingers]), origin))
    return np.array(centres), np.array([PALM_BALL, *[0.004, 0.004, 0.004, TIP] * 2])


def test_the_palm_comes_along_its_approach_axis(tmp_path):
    solution, problem = grasped(tmp_path)
    path = ng.palm_path(solution, problem, distance=0.1)
    assert path.success, path.reason
    np.testing.assert_allclose(path.direction, [0.0, 0.0, -1.0], atol=1e-12)
    np.testing.assert_allclose(path.poses[0, :3, 3], PALM + np.array([0.0, 0.0, 0.1]), atol=1e-12)
    np.testing.assert_allclose(path.poses[-1, :3, 3], PALM, atol=1e-12)
    turn = Rotation.from_quat(DOWN, scalar_first=True).as_matrix()
    np.testing.assert_allclose(path.poses[:, :3, :3], np.tile(turn, (len(path.poses), 1, 1)), atol=1e-12)
    for posture, row in ((solution.hand, path.joints[-1]), (solution.hand["pregrasp"], path.joints[0])):
        np.testing.assert_allclose(row, [posture["joint_positions"][name] for name in path.joint_names], atol=1e-12)
    np.testing.assert_allclose(path.openings, 0.01, atol=1e-9)
    assert list(dict.fromkeys(path.phases)) == ["approaching", "closing"]
    centres, radii = sphere_positions(path)
    outside = box_distance(centres, HALF) - radii
    assert np.min(outside[:, radii < TIP]) >= -path.tolerance
    assert np.min(outside[:, radii == TIP]) >= -0.2 * TIP - path.tolerance
    assert path.blocked == ()


def test_clearances_are_those_of_the_balls(tmp_path):
    path = ng.palm_path(*grasped(tmp_path))
    centres, radii = sphere_positions(path, 1)
    gaps = box_distance(centres, HALF) - radii
    tips = radii == TIP
    closing = np.array(path.phases) == "closing"
    gaps[np.ix_(closing, tips)] = np.inf
    sphere_gaps = np.linalg.norm(centres[:, :, None] - centres[:, None], axis=3) - radii - radii[:, None]
    allowed = np.ones((9, 9), bool)
    neighbours = [(0, 1), (0, 5), (2, 4), (6, 8), *((i, i + 1) for i in (1, 2, 3, 5, 6, 7))]
    for i, j in neighbours:
        allowed[i, j] = allowed[j, i] = False
    np.fill_diagonal(allowed, False)
    between = np.min(np.where(allowed, sphere_gaps, np.inf), axis=(1, 2))
    least = np.minimum(np.min(gaps, axis=1), between)
    np.testing.assert_allclose(path.clearances, least, atol=1e-6)


def test_a_thin_plate_in_the_way_is_found_and_gone_around(tmp_path):
    """A plate of 1 um above the hand: as thin as no step is short."""
    plate = ng.Obstacle(ng.Box([0.3, 0.3, 1e-6]), position=[0.0, 0.0, 0.12], name="plate")
    solution, problem = grasped(tmp_path, [plate])
    straight = ng.palm_path(solution, problem, [0.0, 0.0, -3.0])
    assert not straight.success
    assert "against plate" in straight.reason
    assert straight.poses.shape == (0, 4, 4)
    free_length = straight.blocked[0].free
    assert 0.12 - PALM_BALL - PALM[2] - 1e-3 <= free_length <= 0.12 - PALM_BALL - PALM[2] + 1e-3
    path = ng.palm_path(solution, problem)
    assert path.success
    assert "against plate" in path.blocked[0].reason
    angles = [np.arccos(b.direction @ [0.0, 0.0, -1.0]) for b in path.blocked]
    assert np.all(np.diff(angles) >= -1e-9)
    assert np.arccos(path.direction @ [0.0, 0.0, -1.0]) >= angles[-1] - 1e-9
    centres, radii = sphere_positions(path)
    gap = box_distance(centres - [0.0, 0.0, 0.12], [0.15, 0.15, 5e-7]) - radii
    assert np.min(gap) >= -path.tolerance


@pytest.mark.slow
def test_where_no_direction_is_free_it_says_so(tmp_path):
    walls = [
        ng.Obstacle(ng.Box([0.4 if i != axis else 0.002 for i in range(3)]), position=side * 0.2 * np.eye(3)[axis])
        for axis in range(3)
        for side in (-1.0, 1.0)
    ]
    path = ng.palm_path(*grasped(tmp_path, walls), distance=0.5, directions=10)
    assert not path.success
    count = sum(b.times == 1.0 for b in path.blocked)
    assert count > 10 + len(CLOSER_ANGLES) * CLOSER_COUNT
    assert f"none of {count} directions is free for 500 mm" in path.reason
    assert [b.times for b in path.blocked] == [1.0] * count + [2.0] * count + [4.0] * count
    assert all(b.free < 0.4 for b in path.blocked)
    assert path.reason in str(path)
    listed, closer = (
        path.blocked[: count - len(CLOSER_ANGLES) * CLOSER_COUNT],
        path.blocked[count - len(CLOSER_ANGLES) * CLOSER_COUNT : count],
    )
    assert max(b.free for b in closer) > max(b.free for b in listed)


def shaft(direction, centres, radii, room):
    """Four walls along a direction around balls (m, 3), as far from them as ``room``: frame and bounds across."""
    turn = np.column_stack([*np.linalg.svd(direction[None])[2][1:], direction])
    if np.linalg.det(turn) < 0.0:
        turn[:, 0] *= -1.0
    across = centres @ turn[:, :2]
    bounds = np.array([np.min(across - radii[:, None], axis=0) - room, np.max(across + radii[:, None], axis=0) + room])
    walls = []
    for axis, side in itertools.product((0, 1), (0, 1)):
        extents, place = np.array([0.6, 0.6, 0.6]), np.zeros(3)
        extents[axis], place[axis] = 0.002, bounds[side, axis] + (0.001 if side else -0.001)
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = turn, turn @ place
        walls.append(ng.Obstacle(ng.Box(extents.tolist()), pose=pose, name=f"wall {len(walls)}"))
    return walls, turn, bounds


@pytest.mark.slow
@pytest.mark.parametrize("tilt", first(1, [(0.35, 0.25), (-0.5, 0.1), (0.2, -0.6), (-0.15, -0.4)]))
def test_the_way_out_of_a_narrow_shaft_is_found_between_the_directions_of_the_list(tmp_path, tilt):
    """A hand in a shaft with 4 mm of room leaves it along the shaft, to within two degrees, and in no other way."""
    axis = np.array([*tilt, 1.0]) / np.linalg.norm([*tilt, 1.0])
    unobstructed = ng.palm_path(*grasped(tmp_path))
    centres, radii = sphere_positions(unobstructed, 1)
    opened = np.array(unobstructed.phases) == "approaching"
    path_centres = np.concatenate([c - (c[0] - PALM) for c in centres[opened]] + list(centres[~opened]))
    walls, turn, bounds = shaft(axis, path_centres, np.tile(radii, len(centres)), 0.004)
    path = ng.palm_path(*grasped(tmp_path, [*walls, ng.Table(-0.02)]), distance=0.1)
    assert path.success, path.reason
    assert np.degrees(np.arccos(-path.direction @ axis)) < 2.5
    tried = [b for b in path.blocked if b.times == 1.0]
    assert len(tried) > 100  # all of the list, and then some
    centres, radii = sphere_positions(path)
    across = centres @ turn[:, :2]
    assert np.min(across - radii[:, None] - bounds[0]) >= -path.tolerance
    assert np.min(bounds[1] - across - radii[:, None]) >= -path.tolerance


def test_fingers_open_as_far_as_there_is_room(tmp_path):
    """A wall beside the first finger's tip leaves it 4 of its 10 mm; the other one opens."""
    wall = ng.Obstacle(ng.Box([0.1, 0.002, 0.01]), position=[0.0, -0.03 - 2 * TIP - 0.005, 0.005], name="wall")
    path = ng.palm_path(*grasped(tmp_path, [wall]))
    assert path.success, path.reason
    assert 0.003 < path.openings[0] <= 0.00401
    assert path.openings[1] == pytest.approx(0.01, abs=1e-6)
    tight = ng.Obstacle(ng.Box([0.1, 0.002, 0.01]), position=[0.0, -0.03 - 2 * TIP - 0.0005, 0.005], name="wall")
    second_wall = ng.Obstacle(ng.Box([0.1, 0.002, 0.01]), position=[0.0, 0.03 + 2 * TIP + 0.0005, 0.005], name="wall")
    shut = ng.palm_path(*grasped(tmp_path, [tight, second_wall]))
    assert re.search("the fingers cannot open: fingertip [ab]_tip against wall", shut.reason)


def test_an_enclosing_hand_opens_wider(tmp_path):
    """Rims above the fingertips, which pass them when their centres are 12 mm farther out; the pregrasp has 4."""
    lids = [
        ng.Obstacle(ng.Box([0.06, 0.01, 0.004]), position=[0.0, side * 0.037, 0.03], name="rim") for side in (-1.0, 1.0)
    ]
    path = ng.palm_path(*grasped(tmp_path, lids, opening=0.004), direction=[0.0, 0.0, -1.0])
    assert path.success, path.reason
    assert [b.times for b in path.blocked] == [1.0, 2.0]
    assert np.all(path.openings > 0.012)
    centres, radii = sphere_positions(path)
    for lid in lids:
        gap = box_distance(centres - np.array(lid.position), [0.03, 0.005, 0.002]) - radii
        assert np.min(gap) >= -path.tolerance


def test_joints_beyond_their_limits_are_no_way(tmp_path):
    solution, problem = grasped(tmp_path)
    solution.hand["joint_positions"]["a1_joint"] = -1.7
    assert "joint a1_joint is beyond its limits" in ng.palm_path(solution, problem).reason


def test_the_record_is_plain_data(tmp_path):
    import json

    path = ng.palm_path(*grasped(tmp_path))
    data = json.loads(json.dumps(path.to_dict()))
    assert np.array(data["poses"]).shape == (len(path.phases), 4, 4)
    assert data["direction"] == path.direction.tolist()
    assert str(path).startswith("100 mm along [ 0.  0. -1.], then closing")


def test_bad_input_is_refused_in_a_sentence(tmp_path):
    solution, problem = grasped(tmp_path)
    with pytest.raises(ng.InputError, match="direction"):
        ng.palm_path(solution, problem, [0.0, 0.0, 0.0])
    with pytest.raises(ng.InputError, match="distance"):
        ng.palm_path(solution, problem, distance=0.0)
    with pytest.raises(ng.InputError, match="the problem of the solution"):
        ng.palm_path(solution, grasped(tmp_path, [ng.Table(-1.0)])[1])
    other_problem = ng.GraspProblem(BODY, [ng.FrictionContact(0.5)] * 2, ng.TaskEllipsoid([1.0] * 6))
    with pytest.raises(ng.InputError, match="a URDFHand"):
        ng.palm_path(solution, other_problem)
    with pytest.raises(ng.InputError, match="a GraspSolution"):
        ng.palm_path("grasp.json", problem)
    del solution.hand["pregrasp"]
    with pytest.raises(ng.InputError, match="pregrasp"):
        ng.palm_path(solution, problem)
