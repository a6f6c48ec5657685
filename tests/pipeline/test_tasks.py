"""Solves with every kind of task; statements of the paper on the ready problems."""

import numpy as np
import pytest

import nlpgrasp as ng
from problems import pencil, tea_cup

FAST = ng.SolveOptions(workers=1, rtol=0.05, final_rtol=0.02)
WRENCHES = np.array([[0, 0, 5, 0, 0, 0], [0, 2, 1, 0.05, 0, 0], [1, 0, 0, 0, 0, 0.1], [-3, 0, 0, 0, 0, -0.1]])
BALL = ng.TaskEllipsoid([1, 1, 1, 0.05, 0.05, 0.05])
KINDS = {
    "polytope": ng.TaskPolytope(WRENCHES),
    "one wrench": ng.TaskPolytope(WRENCHES[:1]),
    "sum": BALL + ng.TaskPolytope(WRENCHES),
    "motion": ng.motion_task(
        np.arange(6.0) / 10,
        np.stack([np.sin(np.arange(6)), np.zeros(6), np.arange(6) / 50], axis=1),
        np.tile([1.0, 0, 0, 0], (6, 1)),
        ng.MassProperties(0.2),
    ),
}


def problem(task):
    return ng.GraspProblem(ng.Box([0.08, 0.05, 0.04]), [ng.FrictionContact(0.6)] * 4, task, torque_origin=[0, 0, 0])


@pytest.mark.slow
@pytest.mark.parametrize("name", KINDS)
def test_every_kind_of_task_is_solved_and_verified_from_its_file(name, tmp_path):
    options = ng.SolveOptions(workers=1, rtol=0.05, final_rtol=0.02)
    solution = ng.solve(problem(KINDS[name]), 1, options=options)
    assert solution.mu.lower > 0.0
    assert ng.verify(solution.save(tmp_path / "task.json"), rtol=0.05).passed
    for wrench, forces in solution.forces:
        np.testing.assert_allclose(forces.sum(axis=0), wrench[:3], atol=1e-6 * np.linalg.norm(wrench))


@pytest.mark.slow
def test_a_polytope_and_its_ellipsoid_agree():
    """The ends of an ellipsoid's axes are a smaller task than it, and 1 / sqrt(6) of it a smaller one yet."""
    ends = ng.TaskPolytope(np.concatenate([BALL.axes, -BALL.axes]))
    inner = ng.solve(problem(ends), 2, options=FAST).mu
    outer = ng.solve(problem(BALL), 2, options=FAST)
    assert inner.upper >= outer.mu.lower
    assert ng.mu(outer.grasp, ends).upper >= outer.mu.lower
    assert ng.mu(outer.grasp, (6**-0.5) * BALL).lower >= ng.mu(outer.grasp, ends).lower * 0.98


def test_a_task_without_a_json_form_is_refused_before_anything_is_solved():
    with pytest.raises(ng.InputError, match="a task with a JSON form"):
        ng.solve(problem(ng.TaskSet(BALL.support)), 1)


@pytest.mark.slow
def test_pencil_writing_is_best_near_the_lead():
    """Example 3-5: torque about the axes across the pencil at its lead asks for fingers near it."""
    near = ng.solve(pencil.problem(), 2, options=FAST)
    distance = near.grasp.points[:, 2] + 0.5 * pencil.LENGTH
    assert np.max(distance) <= 0.055
    middle = ng.solve(pencil.power(), 2, options=FAST)
    assert near.mu.lower > 1.05 * middle.mu.upper


@pytest.mark.slow
def test_tea_cup_is_held_at_its_handle():
    """Section 3.3: with fingertips on the handle, above every grasp found around the side."""
    options = ng.SolveOptions(rtol=0.05, final_rtol=0.02, rank="mu")
    best = ng.solve(tea_cup.problem(), 6, options=options)
    assert np.sum(best.grasp.points[:, 0] > tea_cup.ENVELOPING) >= 2
    around = ng.solve(tea_cup.enveloping(), 6, options=options)
    assert best.mu.lower > 1.1 * around.mu.upper
