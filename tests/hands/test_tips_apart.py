"""Fingertips beside each other on a small body."""

from itertools import combinations

import numpy as np
import pytest

import nlpgrasp as ng
from tests.hands.urdf import four_finger_hand


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
    assert ng.verify(solution)
