"""Solutions in a world frame, against rotations of scipy and balances written out."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import nlpgrasp as ng
from tests.motion.test_keyframes import solve_phases

FILES = Path(__file__).parent / "files"
TURN, WHERE = Rotation.from_rotvec([0.5, -1.1, 0.7]), np.array([0.6, -0.2, 0.9])
POSE = {"position": WHERE, "quaternion_xyzw": TURN.as_quat()}


@pytest.fixture(scope="module")
def box():
    return ng.GraspSolution.load(FILES / "box.json")


@pytest.fixture(scope="module")
def hand_solution(tmp_path_factory):
    return solve_phases(tmp_path_factory.mktemp("hand"))[0]


def test_contacts_are_where_the_body_stands(box):
    placed = box.in_frame(POSE)
    np.testing.assert_allclose(placed.grasp.points, box.grasp.points @ TURN.as_matrix().T + WHERE)
    np.testing.assert_allclose(placed.grasp.normals, box.grasp.normals @ TURN.as_matrix().T, atol=1e-15)
    np.testing.assert_allclose(placed.grasp.torque_origin, TURN.as_matrix() @ box.grasp.torque_origin + WHERE)
    np.testing.assert_allclose(placed.pose[:3, :3], TURN.as_matrix(), atol=1e-14)
    assert placed.faces == box.faces
    assert (placed.palm_pose is None, placed.phases) == (True, ())
    expected = box.in_frame(placed.pose)
    np.testing.assert_allclose(expected.grasp.points, placed.grasp.points)
    assert repr(placed).startswith(f"SolutionInFrame({box.name!r}, {len(box.grasp)} contacts, mu in ")


def test_quality_and_balance_hold_there(box):
    """Computed anew from the contacts and the task of the frame: mu is the same, forces add up to their wrenches."""
    placed = box.in_frame(POSE)
    bounds = ng.mu(placed.grasp, placed.task, 0.01, force_budget=box.budget)
    assert bounds.lower <= box.mu.upper * (1 + 1e-9)
    assert box.mu.lower <= bounds.upper * (1 + 1e-9)
    assert placed.mu == box.mu
    np.testing.assert_allclose(placed.task.torque_origin, placed.grasp.torque_origin)
    arms = placed.grasp.points - placed.grasp.torque_origin
    assert placed.forces
    for (wrench, forces), (original, _) in zip(placed.forces, box.forces, strict=True):
        np.testing.assert_allclose(wrench[:3], forces.sum(axis=0), atol=1e-7)
        np.testing.assert_allclose(wrench[3:], np.cross(arms, forces).sum(axis=0), atol=1e-7)
        np.testing.assert_allclose(wrench[:3], TURN.as_matrix() @ original[:3], atol=1e-12)


def test_the_palm_and_its_phases_stand_there(hand_solution):
    placed, matrix = hand_solution.in_frame(POSE), np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = TURN.as_matrix(), WHERE
    palm_pose = hand_solution.hand["palm_pose"]
    np.testing.assert_allclose(placed.palm_pose[:3, 3], TURN.apply(palm_pose["position"]) + WHERE)
    turned = TURN * Rotation.from_quat(palm_pose["quaternion_wxyz"], scalar_first=True)
    np.testing.assert_allclose(placed.palm_pose[:3, :3], turned.as_matrix(), atol=1e-12)
    assert placed.joints == hand_solution.hand["joint_positions"]
    assert [phase.name for phase in placed.phases] == ["approach", "pregrasp", "grasp", "squeeze", "lift"]
    for placed_phase, own_phase in zip(placed.phases, hand_solution.phases, strict=True):
        np.testing.assert_allclose(placed_phase.palm_frame, matrix @ own_phase.palm_frame, atol=1e-12)
        assert (placed_phase.joints, placed_phase.clearance) == (own_phase.joints, own_phase.clearance)
    np.testing.assert_allclose(placed.phases[2].palm_frame, placed.palm_pose, atol=1e-12)


def test_a_planar_grasp_takes_a_planar_pose():
    grasp = ng.Grasp([[1.0, 0.0], [-1.0, 0.0]], [[-1.0, 0.0], [1.0, 0.0]], ng.FrictionContact(0.5))
    problem = ng.GraspProblem(
        ng.Polygon([[-1, -1], [1, -1], [1, 1], [-1, 1]]), [ng.FrictionContact(0.5)] * 2, ng.TaskEllipsoid([1, 1, 1])
    )
    solution = ng.GraspSolution(ng.Status.SOLVED, "square", problem.to_dict(), grasp, ("edge1", "edge3"))
    c, s = np.cos(0.4), np.sin(0.4)
    placed = solution.in_frame([[c, -s, 2.0], [s, c, 3.0], [0, 0, 1]])
    np.testing.assert_allclose(placed.grasp.points, [[2 + c, 3 + s], [2 - c, 3 - s]])
    with pytest.raises(ng.InputError, match=r"^pose: got shape \(4, 4\), expected a \(3, 3\) matrix$"):
        solution.in_frame(np.eye(4))


def test_what_is_no_pose_and_what_is_no_solution(box):
    with pytest.raises(ng.InputError, match=r"^pose: got 7 numbers, which do not say where the scalar is"):
        box.in_frame([0.6, -0.2, 0.9, 1, 0, 0, 0])
    with pytest.raises(ng.InputError, match="no grasp"):
        ng.GraspSolution.load(FILES / "none.json").in_frame(POSE)
    for ask in (ng.verify, ng.squeeze):
        with pytest.raises(ng.InputError, match=r"^solution: got SolutionInFrame\(.*, expected the GraspSolution that"):
            ask(box.in_frame(POSE))
