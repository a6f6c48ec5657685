"""Objectives of a problem beside mu: delta by its ball task."""

import json
from dataclasses import replace

import numpy as np
import pytest

import nlpgrasp as ng

SQUARE = ng.Polygon([[-0.05, -0.05], [0.05, -0.05], [0.05, 0.05], [-0.05, 0.05]])
FAST = ng.SolveOptions(workers=1, rtol=0.05, final_rtol=0.02)


def problem(**parts):
    return ng.GraspProblem(SQUARE, [ng.FrictionContact(0.5)] * 3, **parts)


def test_delta_is_solved_by_its_ball_task_and_says_so(tmp_path):
    asked = problem(objective="delta", torque_scale=0.04)
    solution = ng.solve(asked, 1, options=FAST)
    ball = ng.solve(problem(task=ng.TaskEllipsoid([1, 1, 0.04])), 1, options=FAST)
    np.testing.assert_array_equal(solution.grasp.points, ball.grasp.points)
    assert solution.objective == "delta"
    assert (solution.delta.lower, solution.delta.upper) == (ball.mu.lower, ball.mu.upper)
    measured = ng.delta(solution.grasp, 0.04)
    assert measured.lower <= solution.delta.upper
    assert solution.delta.lower <= measured.upper
    assert "the objective: delta, which is mu of the unit ball of wrenches (torque scale 0.04 m)" in str(solution)
    assert "objective: delta: mu of the unit ball of wrenches, torque scale 0.04 m" in str(asked)
    file = solution.save(tmp_path / "delta.json")
    assert ng.verify(file).complete
    assert ng.GraspSolution.load(file).known_problem.torque_scale == 0.04
    data = json.loads(file.read_text())
    data["problem"]["torque_scale"] = 0.05
    file.write_text(json.dumps(data))
    assert [check.name for check in ng.verify(file).checks if check.failed] == ["objective"]


def test_copies_keep_the_torque_scale_and_take_another():
    asked = problem(objective="delta")
    assert asked.torque_scale == SQUARE.size
    assert replace(asked, name="copy").task == ng.TaskEllipsoid([1, 1, SQUARE.size])
    assert replace(asked, torque_scale=0.02).task == ng.TaskEllipsoid([1, 1, 0.02])


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        ({"objective": "epsilon"}, "GraspProblem.objective: got epsilon, expected 'mu' or 'delta'"),
        ({"objective": "delta", "task": ng.TaskEllipsoid([2, 1, 1])}, 'no task: that of objective="delta"'),
        ({"objective": "delta", "torque_scale": 0.0}, "GraspProblem.torque_scale"),
        ({"task": ng.TaskEllipsoid([1, 1, 1]), "torque_scale": 0.1}, 'None, except for objective="delta"'),
        ({}, "GraspProblem.task: got None, expected a task"),
    ],
)
def test_bad_input(parts, message):
    with pytest.raises(ng.InputError, match=message):
        problem(**parts)
