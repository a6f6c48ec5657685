"""Solves with every force budget and contact model: certificates, files, verification."""

from dataclasses import replace

import numpy as np
import pytest

import nlpgrasp as ng
from tests.quick import first

ONE = ng.SolveOptions(workers=1, analyses=("delta", "nu"))
ELLIPSE = ng.PlanarImplicit(lambda p: (p[0] / 2.0) ** 2 + p[1] ** 2 - 1.0, [[-2.1, -1.1], [2.1, 1.1]])
BUDGETS = {
    "per_finger": "per_finger",
    "shared": "shared",
    "per_finger_size": "per_finger_size",
    "joint_torques": ng.JointTorqueLimits([[[1.0, 0.3], [0.2, 0.8]]] * 3, 20.0),
}


def solved_and_verified(problem, path, starts=3):
    solution = ng.solve(problem, starts=starts, options=ONE)
    assert solution.status is ng.Status.SOLVED
    assert solution.mu.gap <= 0.011
    loaded = ng.GraspSolution.load(solution.save(path / "grasp.json"))
    drawn = {"drawing": loaded.to_dict()["drawing"]}  # of a body that the file does not state whole
    assert loaded.to_dict() == solution.to_dict() | drawn
    check = ng.verify(path / "grasp.json")
    assert check, str(check)
    assert "forces" in [c.name for c in check.checks]
    assert solution.delta.torque_scale == solution.nu.torque_scale > 0.0
    assert solution.nu.lower <= solution.nu.value <= solution.nu.upper
    return solution


@pytest.mark.parametrize("budget", first(1, BUDGETS))
def test_planar_problems_with_every_budget(budget, tmp_path):
    task = ng.TaskEllipsoid([1.0, 1.0, 0.5])
    problem = ng.GraspProblem(ELLIPSE, [ng.FrictionContact(0.5)] * 3, task, force_budget=BUDGETS[budget])
    solution = solved_and_verified(problem, tmp_path, starts=1)
    grasp = solution.grasp
    found = ng.mu(grasp, task, 1e-3, force_budget=BUDGETS[budget])
    assert solution.mu.lower <= found.upper
    assert found.lower <= solution.mu.upper
    used = ng.finger_forces(grasp, [w for w, _ in solution.forces], force_budget=BUDGETS[budget]).used
    assert np.max(used) <= 1.0 + 1e-6
    # better than the best of 300 random placements
    angles = np.random.default_rng(0).uniform(0.0, 2.0 * np.pi, (300, 3))
    points = np.stack([2.0 * np.cos(angles), np.sin(angles)], axis=-1)
    normals = -points / np.array([4.0, 1.0])
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    count = 30 if budget == "joint_torques" else 300
    stack = ng.GraspStack(points[:count], normals[:count], ng.FrictionContact(0.5))
    rivals = ng.mu(stack, task, 0.1, force_budget=BUDGETS[budget]).lower
    assert len(rivals) == count
    assert solution.mu.lower > np.max(rivals)


@pytest.mark.slow
def test_a_hundred_times_the_torque_is_a_hundred_times_the_measure():
    """The scale of the limits is the scale of the answer, not of the program."""
    values = []
    for limit in (0.02, 2.0):
        budget = ng.JointTorqueLimits([[[1.0, 0.3], [0.2, 0.8]]] * 3, limit)
        task = ng.TaskEllipsoid([1.0, 1.0, 0.5])
        problem = ng.GraspProblem(ELLIPSE, [ng.FrictionContact(0.5)] * 3, task, force_budget=budget)
        values.append(ng.solve(problem, starts=3, options=ONE).mu.upper / limit)
    assert values[0] == pytest.approx(values[1], rel=1e-2)


@pytest.mark.slow
def test_shared_budget_in_space(tmp_path):
    """Ferrari and Canny's epsilon itself as the objective; twice what a random start has."""
    ball = ng.TaskEllipsoid([1.0] * 6)
    problem = ng.GraspProblem(ng.Sphere(1.0), [ng.FrictionContact(0.5)] * 4, ball, force_budget="shared")
    solution = solved_and_verified(problem, tmp_path, starts=4)
    # the tetrahedral grasp, the best for a ball, has 0.3535 (docs/paper/09_support_functions.md)
    assert solution.mu.lower >= 0.34
    assert solution.mu.upper <= 0.3535 * 1.01


CONTACTS = {
    "lines": [ng.LineContact(0.3, friction=0.5, direction=[1, 2, 3])] * 2,
    "lines as boxes": [ng.LineContact(0.3, friction=0.5, direction=[1, 2, 3], model="box")] * 2,
    "discs": [ng.PlaneContact(radius=0.2, friction=0.5)] * 2,
    "discs as boxes": [ng.PlaneContact(radius=0.2, friction=0.5, model="box")] * 2,
    "rectangles": [ng.PlaneContact(extents=[0.2, 0.3], friction=0.5, direction=[1, 2, 3])] * 2,
    "rectangles as boxes": [ng.PlaneContact(extents=[0.2, 0.3], friction=0.5, direction=[1, 2, 3], model="box")] * 2,
    "smooth pad and fingers": [
        ng.PlaneContact(extents=[0.2, 0.3], direction=[1, 2, 3]),
        *[ng.FrictionContact(0.5)] * 3,
    ],
    "suction and finger": [ng.BilateralContact(ng.SoftContact(0.5, 0.1)), ng.FrictionContact(0.5)],
}


@pytest.mark.slow
@pytest.mark.parametrize("name", CONTACTS)
def test_contacts_with_moments(name, tmp_path):
    problem = ng.GraspProblem(ng.Box([1, 2, 3]), CONTACTS[name], ng.TaskEllipsoid([1, 1, 1, 0.2, 0.2, 0.2]))
    solution = solved_and_verified(problem, tmp_path, starts=1)
    assert len(solution.moments) == len(solution.forces)
    total = sum(np.abs(m).sum() for m in solution.moments)
    assert total > 0.0


@pytest.mark.slow
def test_bilateral_optimum_is_the_singular_value(tmp_path):
    problem = ng.GraspProblem(
        ng.Ellipsoid([2.0, 1.0, 1.0]), [ng.BilateralContact(ng.FrictionContact(0.5))] * 3, ng.TaskEllipsoid([1.0] * 6)
    )
    solution = ng.solve(problem, starts=1, options=replace(ONE, global_bound=False))
    assert solution.mu.upper == pytest.approx(ng.smallest_singular_value(solution.grasp), rel=1e-6)
    assert ng.verify(solution.save(tmp_path / "bilateral.json"))


def test_what_does_not_fit_is_refused():
    task = ng.TaskEllipsoid([1.0] * 3)
    with pytest.raises(ng.InputError, match=r"GraspProblem\.force_budget: got l1"):
        ng.GraspProblem(ELLIPSE, [ng.FrictionContact(0.5)] * 3, task, force_budget="l1")
    with pytest.raises(ng.InputError, match="expected 2"):
        ng.GraspProblem(ELLIPSE, [ng.FrictionContact(0.5)] * 2, task, force_budget=BUDGETS["joint_torques"])
    contact = ng.BilateralContact(ng.PointContact())
    with pytest.raises(ng.InputError, match="bilateral"):
        ng.GraspProblem(ELLIPSE, [contact] * 3, task, force_budget="shared")
    with pytest.raises(ng.InputError, match=r"contacts\[0\]\.direction"):
        ng.GraspProblem(ng.Box([1, 2, 3]), [ng.LineContact(0.1)] * 2, ng.TaskEllipsoid([1.0] * 6))
