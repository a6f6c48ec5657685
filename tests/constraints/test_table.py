"""Tables under bodies: exclusion of contacts on the underside."""

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.constraints import constraint_from_dict
from nlpgrasp.constraints.table import THIN_FINGER

QUICK = ng.SolveOptions(workers=1, global_bound=False)
SQUARE = ng.Polygon([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])


def carried(constraints, body=SQUARE, center=(0.0, 0.5, 0.0), axes=(1.0, 1.0, 1.0), fingers=2, starts=2):
    """Return what carries a weight, the task of Example 3-10 by default."""
    task = ng.TaskEllipsoid(list(axes), center=list(center))
    problem = ng.GraspProblem(body, [ng.FrictionContact(0.5)] * fingers, task, constraints=constraints)
    return ng.solve(problem, starts, options=QUICK)


@pytest.mark.slow
def test_the_side_of_a_square_that_lies_in_the_table_is_not_touched():
    free, stands = carried([]), carried([ng.Table(-1.0)])
    assert "edge0" in free.faces  # from below is best where nothing is in the way (Example 3-10)
    assert "edge0" not in stands.faces
    assert np.min(stands.grasp.points[:, 1]) >= -1.0 + THIN_FINGER - 1e-6
    assert 0.0 < stands.mu.lower < free.mu.lower


@pytest.mark.slow
def test_the_bottom_of_a_box_that_stands_on_the_table_is_not_touched():
    body = ng.Box([0.08, 0.04, 0.04])
    weight, axes = (0.0, 0.0, 2.0, 0.0, 0.0, 0.0), (1.0, 1.0, 1.0, 0.01, 0.01, 0.01)
    solution = carried([ng.Table(-0.02)], body, weight, axes, fingers=3)
    assert solution.status is ng.Status.SOLVED
    assert "-z" not in solution.faces
    assert np.min(solution.grasp.points[:, 2]) >= -0.02 + THIN_FINGER - 1e-8


@pytest.mark.slow
def test_faces_that_all_lie_in_the_table_leave_no_grasp_and_the_answer_says_why():
    contacts = [ng.FrictionContact(0.5, faces="edge0"), ng.FrictionContact(0.5, faces="edge2")]
    task = ng.TaskEllipsoid([1.0, 1.0, 1.0], center=[0.0, 0.5, 0.0])
    solution = ng.solve(ng.GraspProblem(SQUARE, contacts, task, constraints=[ng.Table(-1.0)]), 1, options=QUICK)
    assert solution.status is ng.Status.LOCALLY_INFEASIBLE
    assert any("table, finger 0" in conflict.row for conflict in solution.why_not.conflicts)


def test_without_clearance_a_point_finger_may_be_under_the_body_as_in_the_paper():
    assert "edge0" in carried([ng.Table(-1.0, clearance=0.0)]).faces


def test_clearance_by_default_is_a_thin_finger_also_from_files():
    assert ng.Table(0.1).clearance == pytest.approx(5e-4)
    assert constraint_from_dict({"type": "table", "height": 0.1}) == ng.Table(0.1)
    old = {"type": "table", "height": 0.1, "clearance": 0.0}  # as files state that were written with another default
    assert constraint_from_dict(old).clearance == 0.0
