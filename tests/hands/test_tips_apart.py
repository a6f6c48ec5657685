"""Distances of round fingertips: constraints against MuJoCo's kinematics, a small body."""

from itertools import combinations

import casadi as ca
import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.common.scalar_constraints import TIPS_APART
from nlpgrasp.hands.self_collision import colliding_tips, tip_clearance_constraints
from tests.hands.urdf import FOUR, FOUR_TIPS, Mujoco, four_finger_hand, gripper


def test_rows_are_squared_distances_of_the_tips_balls(rng):
    tree = four_finger_hand().tree
    lower, upper = tree.joint_limits
    joints = rng.uniform(lower, upper)
    values = {"palm_position": np.zeros(3), "palm_quaternion": np.array([1.0, 0.0, 0.0, 0.0]), "joints": joints}
    rows = tip_clearance_constraints(tree, {name: ca.DM(value) for name, value in values.items()})
    names = [joint.name for joint in tree.robot.free_joints]
    links = Mujoco(FOUR).link_poses(dict(zip(names, joints, strict=True)))
    centres = [links[tip][:3, 3] for tip in FOUR_TIPS]
    pairs = list(combinations(range(4), 2))
    assert [row.fingers for row in rows] == pairs
    for row, (i, j) in zip(rows, pairs, strict=True):
        assert float(row.expression) == pytest.approx(np.sum((centres[i] - centres[j]) ** 2), rel=1e-6)
        assert row.lower == pytest.approx(0.022**2)


def test_flat_pads_and_neighbours_in_a_chain_are_left_out():
    assert colliding_tips(gripper().tree) == ()
    tips = {"index_middle": 0.009, **FOUR_TIPS}
    tree = ng.URDFHand.load(FOUR, tips, approach=[1.0, 0.0, 0.0]).tree
    assert (0, 1) not in colliding_tips(tree)
    assert (0, 2) in colliding_tips(tree)


@pytest.mark.slow
def test_a_small_ball_is_held_by_tips_beside_each_other():
    """Without these rows tips of 22 mm were 17 to 19 mm apart."""
    task = ng.lift([0.0, 0.0, 0.0], 0.2) + ng.disturbance(0.3, 0.004)
    options = ng.SolveOptions(workers=1, global_bound=False)
    problem = ng.GraspProblem(ng.Sphere(0.012), ng.FrictionContact(0.6), task, hand=four_finger_hand())
    solution = ng.solve(problem, starts=2, keep=3, options=options)
    for candidate in solution.grasps:
        centres = candidate.grasp.points - 0.011 * candidate.grasp.normals
        assert min(np.linalg.norm(a - b) for a, b in combinations(centres, 2)) > 0.022 - 1e-5
    assert sum(c.kind == TIPS_APART for c in solution.constraints) == 6
    assert ng.verify(solution)
