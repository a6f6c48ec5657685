"""Trajectory of a hand through the phases of a grasp."""

import csv
import io
import json

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.interop.registry import format_named
from nlpgrasp.solution.phase_record import read_phases
from tests.motion.test_keyframes import solve_phases
from tests.studies.held_box import grasped


@pytest.fixture(scope="module")
def solution(tmp_path_factory):
    return solve_phases(tmp_path_factory.mktemp("hand"))[0]


def test_every_keyframe_is_a_sample_and_speeds_are_kept(solution):
    path = ng.trajectory(solution, rate=100.0, speed=0.2, joint_speed=0.4)
    steps = np.diff(path.times)
    assert np.all(steps > 0.0)
    assert np.max(steps) <= 0.01 + 1e-12
    assert np.max(np.linalg.norm(np.diff(path.palm_positions, axis=0), axis=1) / steps) == pytest.approx(0.2)
    assert np.max(np.abs(np.diff(path.joints, axis=0)) / steps[:, None]) == pytest.approx(0.4)
    for phase in solution.phases:
        last = [i for i, name in enumerate(path.phases) if name == phase.name][-1]
        np.testing.assert_allclose(path.palm_positions[last], phase.palm_position, atol=1e-12)
        np.testing.assert_allclose(path.joints[last], [phase.joints[name] for name in path.joint_names], atol=1e-12)


def test_a_joint_of_its_own_speed_slows_the_leg(solution):
    names = ng.trajectory(solution).joint_names
    slow = dict.fromkeys(names, 0.5) | {names[1]: 0.05}
    path = ng.trajectory(solution, joint_speed=slow)
    rates = np.abs(np.diff(path.joints, axis=0)) / np.diff(path.times)[:, None]
    assert np.max(rates[:, 1]) == pytest.approx(0.05)
    with pytest.raises(ng.InputError, match="joint_speed"):
        ng.trajectory(solution, joint_speed={names[0]: 0.5})


def test_exports_hold_the_same_numbers(solution):
    path = ng.trajectory(solution)
    rows = list(csv.reader(io.StringIO(format_named("trajectory").export(solution).decode())))
    assert rows[0][:5] == ["time", "phase", "palm_x", "palm_y", "palm_z"]
    assert tuple(rows[0][9:]) == path.joint_names
    assert [row[1] for row in rows[1:]] == list(path.phases)
    np.testing.assert_array_equal(np.array([row[9:] for row in rows[1:]], dtype=float), path.joints)
    data = json.loads(format_named("trajectory_json").export(solution))
    np.testing.assert_array_equal(data["palm_positions"], path.palm_positions)
    assert data["palm_quaternion_wxyz"] == path.palm_quaternion.tolist()
    np.testing.assert_array_equal(ng.Trajectory.from_dict(data).joints, path.joints)


def test_phases_go_through_a_file(solution, tmp_path):
    read = ng.GraspSolution.load(solution.save(tmp_path / "f.json"))
    assert [phase.to_dict() for phase in read.phases] == [phase.to_dict() for phase in solution.phases]
    assert isinstance(read.phases[0], ng.Phase)
    np.testing.assert_allclose(read.phases[0].palm_frame[:3, :3], np.diag([1.0, -1.0, -1.0]), atol=1e-12)


def test_older_files_have_none(tmp_path):
    solution, _ = grasped(tmp_path)
    assert solution.phases == ()
    with pytest.raises(ng.InputError, match="no phases of a hand"):
        ng.trajectory(solution)


def test_keyframes_out_of_order_are_refused(solution):
    data = [phase.to_dict() for phase in solution.phases]
    with pytest.raises(ng.InputError, match="in the order approach, pregrasp"):
        read_phases(data[::-1], "hand.phases")
    fewer = {**data[1], "joint_positions": dict(list(data[1]["joint_positions"].items())[1:])}
    with pytest.raises(ng.InputError, match=r"hand\.phases\[1\]\.joint_positions"):
        read_phases([data[0], fewer], "hand.phases")
