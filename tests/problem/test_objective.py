"""Objectives of a problem beside mu: delta by its ball task, nu by ascent of the sampled volume."""

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
    assert "the objective: delta, mu of the unit ball of wrenches (torque scale 0.04 m)" in str(solution)
    assert "objective: delta, mu of the unit ball of wrenches, torque scale 0.04 m" in str(asked)
    file = solution.save(tmp_path / "delta.json")
    assert ng.verify(file).complete
    assert ng.GraspSolution.load(file).known_problem.torque_scale == 0.04
    data = json.loads(file.read_text())
    data["problem"]["torque_scale"] = 0.05
    file.write_text(json.dumps(data))
    assert [check.name for check in ng.verify(file).checks if check.failed] == ["objective"]


def test_nu_is_no_less_than_at_the_best_mu_and_at_random_placements(tmp_path):
    asked = problem(objective="nu", torque_scale=0.04)
    solution = ng.solve(asked, 2, options=FAST)
    by_mu = ng.solve(problem(task=ng.TaskEllipsoid([1, 1, 0.04])), 1, options=FAST)
    assert solution.nu.upper >= ng.nu(by_mu.grasp, 0.04).lower
    assert solution.mu.lower > 0.0
    assert solution.best_possible == np.inf
    rng = np.random.default_rng(0)
    sides = np.array([[-1.0, 0], [1, 0], [0, -1], [0, 1]])
    for _ in range(40):
        normals = -sides[rng.integers(4, size=3)]
        points = -0.05 * normals + rng.uniform(-0.045, 0.045, (3, 1)) * normals[:, ::-1]
        grasp = ng.Grasp(points, normals, asked.contacts, [0, 0])
        if ng.is_stable(grasp):  # the volume of others does not count
            assert ng.nu(grasp, 0.04, 0.05).lower <= 1.01 * solution.nu.upper
    floor = solution.known_problem.least_mu
    assert floor == pytest.approx(0.1 * by_mu.mu.lower, rel=0.03)
    assert f"the objective: nu, the volume of the wrench set, among grasps with mu >= {floor:.4g}" in str(solution)
    file = solution.save(tmp_path / "nu.json")
    assert ng.verify(file)
    data = json.loads(file.read_text())
    data["problem"]["least_mu"] = 1.01 * solution.mu.lower
    file.write_text(json.dumps(data))
    assert [check.name for check in ng.verify(file).checks if check.failed] == ["floor of mu"]


def test_more_mu_costs_volume_and_a_floor_that_is_not_reached_is_said():
    largest = ng.solve(problem(task=ng.TaskEllipsoid([1, 1, SQUARE.size])), 2, options=FAST).mu.lower
    floors = 0.05, 0.95 * largest
    low, high = (ng.solve(problem(objective="nu", least_mu=floor), 2, options=FAST) for floor in floors)
    assert low.nu.upper > high.nu.upper
    assert low.mu.lower >= floors[0]
    assert high.mu.lower >= floors[1]
    none = ng.solve(problem(objective="nu", least_mu=0.9), 1, options=FAST)
    assert none.grasp is None
    assert "GraspProblem.least_mu is 0.9; the largest mu that the starts found is 0." in str(none)


def test_what_nu_does_not_have_is_refused():
    asked = problem(objective="nu")
    with pytest.raises(ng.InputError, match="nu with gap"):
        ng.solve(asked, 1, options=ng.SolveOptions(gap=0.1))
    with pytest.raises(ng.InputError, match="nu with keep"):
        ng.solve(asked, 1, keep=2)
    with pytest.raises(ng.InputError, match="mu or delta for a bound over all placements"):
        ng.best_possible(asked)


def test_copies_keep_the_torque_scale_and_take_another():
    asked = problem(objective="delta")
    assert asked.torque_scale == SQUARE.size
    assert replace(asked, name="copy").task == ng.TaskEllipsoid([1, 1, SQUARE.size])
    assert replace(asked, torque_scale=0.02).task == ng.TaskEllipsoid([1, 1, 0.02])


def test_a_unit_ball_given_as_the_task_states_the_torque_scale():
    asked = problem(objective="delta", task=ng.TaskEllipsoid([1, 1, 0.5]))
    assert asked.torque_scale == 0.5
    assert asked.task == ng.TaskEllipsoid([1, 1, 0.5])


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        ({"objective": "epsilon"}, "GraspProblem.objective: got epsilon, expected 'mu' or 'delta' or 'nu'"),
        ({"objective": "delta", "task": ng.TaskEllipsoid([2, 1, 1])}, 'no task: that of objective="delta"'),
        ({"objective": "delta", "torque_scale": 0.0}, "GraspProblem.torque_scale"),
        ({"task": ng.TaskEllipsoid([1, 1, 1]), "torque_scale": 0.1}, 'None, except for objective="delta" or "nu"'),
        ({"objective": "nu", "force_budget": "shared"}, 'nu with force_budget="shared", expected force_budget="l2"'),
        ({"objective": "nu", "force_budget": "hand_torques"}, "of which the volume is maximised"),
        ({"objective": "nu", "least_mu": 0.0}, "GraspProblem.least_mu"),
        ({"objective": "delta", "least_mu": 0.1}, 'got 0.1, expected None, except for objective="nu"'),
        ({}, "GraspProblem.task: got None, expected a task"),
    ],
)
def test_bad_input(parts, message):
    with pytest.raises(ng.InputError, match=message):
        problem(**parts)
