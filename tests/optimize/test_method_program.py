"""Answers of the paper's program alone, beside those of the default steps."""

from functools import cache

import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from tests.hands.urdf import four_finger_hand

TASK = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.03, 0.03, 0.03])
PLANAR = ng.TaskEllipsoid([1.0, 1.5, 0.03], center=[0.0, 0.5, 0.0])
POLYGON = ng.Polygon([[-0.05, -0.03], [0.05, -0.04], [0.04, 0.03], [-0.03, 0.045]])
FRICTION = ng.FrictionContact(0.5)
PROBLEMS = {
    "box": ng.GraspProblem(ng.Box([0.08, 0.05, 0.04]), [FRICTION] * 3, TASK),
    "polygon": ng.GraspProblem(POLYGON, [FRICTION] * 2, PLANAR),
    "mesh": ng.GraspProblem(ng.Mesh(trimesh.creation.icosphere(3, 0.03)), [FRICTION] * 4, TASK),
    "shared budget": ng.GraspProblem(ng.Box([0.08, 0.05, 0.04]), [FRICTION] * 3, TASK, force_budget="shared"),
}


@cache
def answer(name, method):
    options = ng.SolveOptions(workers=1, global_bound=False, rank="mu", method=method)
    return ng.solve(PROBLEMS[name], starts=1, options=options)


@pytest.mark.parametrize("name", ["box", "polygon"])
def test_the_program_ends_where_the_steps_do(name):
    by_program = answer(name, "program")
    assert by_program.success
    assert by_program.mu.upper >= 0.99 * answer(name, "steps").mu.lower
    assert ng.verify(by_program).complete


@pytest.mark.slow
@pytest.mark.parametrize("name", ["mesh", "shared budget"])
def test_on_meshes_and_under_other_budgets(name):
    by_program = answer(name, "program")
    assert by_program.success
    assert by_program.mu.upper >= 0.95 * answer(name, "steps").mu.lower
    assert ng.verify(by_program).passed


def test_a_constraint_is_kept():
    wide = ng.Constraint("width", lambda p, n: p[0][1] - p[1][1], 0.01, 0.01)
    problem = ng.GraspProblem(PROBLEMS["box"].body, [FRICTION] * 3, TASK, constraints=[wide])
    options = ng.SolveOptions(workers=1, global_bound=False, method="program")
    solution = ng.solve(problem, starts=1, options=options)
    assert np.diff(solution.grasp.points[[1, 0], 1]) == pytest.approx(0.01, abs=1e-6)


def test_bad_input():
    with pytest.raises(ng.InputError, match=r"^SolveOptions\.method: got ipopt, expected 'steps' or 'program'"):
        ng.SolveOptions(method="ipopt")
    problem = ng.GraspProblem(ng.Sphere(0.03), FRICTION, TASK, hand=four_finger_hand())
    with pytest.raises(ng.InputError, match=r"^SolveOptions\.method: got 'program' for a hand that has a pose"):
        ng.solve(problem, options=ng.SolveOptions(method="program"))


@pytest.mark.slow
@pytest.mark.parametrize("method", ["steps", "program"])
def test_what_is_called_a_local_optimum_is_one_at_kinks_too(method):
    """Under budgets whose supports have kinks; ``verify`` moves each free contact and looks whether mu gains."""
    rng, solved = np.random.default_rng(5), 0
    for i in range(9):
        angles = np.arange(4) * np.pi / 2.0 + rng.uniform(-0.5, 0.5, 4)
        body = ng.Polygon(0.045 * np.column_stack([np.cos(angles), np.sin(angles)]))
        axes = rng.uniform([0.2, 0.2, 0.003], [1.0, 1.0, 0.03])
        task = ng.TaskEllipsoid(axes, center=0.4 * axes * rng.standard_normal(3))
        contacts = [ng.FrictionContact(friction) for friction in rng.uniform(0.3, 0.8, 2 + i % 2)]
        problem = ng.GraspProblem(body, contacts, task, force_budget=("shared", "per_finger")[i % 2])
        options = ng.SolveOptions(workers=1, global_bound=False, method=method)
        solution = ng.solve(problem, starts=2, seed=i, options=options)
        if solution.success:
            assert ng.verify(solution), str(ng.verify(solution))
            solved += 1
    assert solved > 5
