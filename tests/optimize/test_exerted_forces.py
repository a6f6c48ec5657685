"""Least finger forces for the task as stated, compared with closed forms and a conic program in the body frame."""

import clarabel
import numpy as np
import pytest
from scipy import sparse

import nlpgrasp as ng
from nlpgrasp.optimize.exerted_forces import compute_exerted_forces
from tests.samples import closed_ellipsoid_grasp


def needed(body, points, normals, models, task, **fields):
    """Return what a grasp needs, without a solve."""
    problem = ng.GraspProblem(body, models, task, **fields)
    grasp = ng.Grasp(points, normals, models, problem.origin)
    bounds = ng.mu(grasp, task, force_budget=problem.budget)
    return compute_exerted_forces(problem, grasp, problem.budget, bounds).needed


SIDES = [[0.04, 0.0, 0.0], [-0.04, 0.0, 0.0]], [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]


@pytest.mark.parametrize(("weight", "friction"), [(1.0, 0.5), (9.81, 0.3), (40.0, 1.2)])
def test_two_opposing_contacts_hold_a_weight(weight, friction):
    """Each bears half of it by friction, and presses half of it over the coefficient."""
    task = ng.TaskPolytope([[0.0, 0.0, weight, 0.0, 0.0, 0.0]])
    forces_needed = needed(ng.Box([0.08, 0.04, 0.06]), *SIDES, [ng.FrictionContact(friction)] * 2, task)
    normal = weight / (2.0 * friction)
    size = np.hypot(normal, weight / 2.0)
    np.testing.assert_allclose(forces_needed.wrench, task.wrenches[0])
    np.testing.assert_allclose(forces_needed.normal, [normal] * 2, rtol=1e-7)
    np.testing.assert_allclose(forces_needed.size, [size] * 2, rtol=1e-7)
    np.testing.assert_allclose(forces_needed.largest, [size] * 2, rtol=1e-7)
    assert forces_needed.total == pytest.approx(2.0 * size, rel=1e-7)
    assert np.sqrt(2.0) * size in forces_needed.budget
    assert forces_needed.moments is None


@pytest.mark.parametrize(
    ("budget", "amount"),
    [("per_finger", 10.0), ("shared", 20.0), ("per_finger_size", np.hypot(10.0, 5.0))],
)
def test_the_same_weight_under_other_budgets(budget, amount):
    task = ng.TaskPolytope([[0.0, 0.0, 10.0, 0.0, 0.0, 0.0]])
    models = [ng.FrictionContact(0.5)] * 2
    forces_needed = needed(ng.Box([0.08, 0.04, 0.06]), *SIDES, models, task, force_budget=budget)
    np.testing.assert_allclose(forces_needed.normal, [10.0] * 2, rtol=1e-6)
    assert forces_needed.budget.lower <= amount * (1.0 + 1e-9)
    assert amount * (1.0 - 1e-9) <= forces_needed.budget.upper <= 1.02 * amount


def test_soft_fingers_turn_a_sphere_about_their_line():
    """Each turns with half of the moment, which its torsional friction takes a normal force for."""
    moment, torsion = 0.3, 0.01
    task = ng.TaskEllipsoid([0.0, 0.0, 0.0, moment, 0.0, 0.0])
    forces_needed = needed(ng.Sphere(0.04), *SIDES, [ng.SoftContact(0.6, torsion)] * 2, task)
    normal = moment / (2.0 * torsion)
    np.testing.assert_allclose(np.abs(forces_needed.wrench), [0.0, 0.0, 0.0, moment, 0.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(forces_needed.normal, [normal] * 2, rtol=1e-6)
    np.testing.assert_allclose(forces_needed.size, forces_needed.normal, rtol=1e-6)
    np.testing.assert_allclose(np.abs(forces_needed.moments), [[moment / 2.0, 0.0, 0.0]] * 2, atol=1e-6)
    assert np.sqrt(2.0) * np.hypot(normal, moment / 2.0) in forces_needed.budget


def least_by_a_conic_program(grasp, wrench, friction):
    """Return least forces (k, 3): unknowns in the body frame, cones by Clarabel."""
    k = len(grasp)
    size = 3 * k + 1
    arms = grasp.points - grasp.torque_origin
    cross = [np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]) for x, y, z in arms]
    rows = [np.hstack([*[np.vstack([np.eye(3), c]) for c in cross], np.zeros((6, 1))])]
    cones = [clarabel.ZeroConeT(6), clarabel.SecondOrderConeT(size)]
    rows.append(-np.roll(np.eye(size), 1, axis=0))
    for i, n in enumerate(grasp.normals):
        block = np.zeros((4, size))
        block[0, 3 * i : 3 * i + 3] = -friction * n
        block[1:, 3 * i : 3 * i + 3] = -(np.eye(3) - np.outer(n, n))
        rows.append(block)
        cones.append(clarabel.SecondOrderConeT(4))
    A = sparse.csc_matrix(np.vstack(rows))
    b = np.concatenate([wrench, np.zeros(A.shape[0] - 6)])
    cost = np.zeros(size)
    cost[-1] = 1.0
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-11
    solved = clarabel.DefaultSolver(sparse.csc_matrix((size, size)), cost, A, b, cones, settings).solve()
    return np.array(solved.x)[:-1].reshape(k, 3)


def test_forces_are_those_of_a_conic_program(rng):
    task = 7.0 * ng.TaskEllipsoid([1.0] * 6)
    for _ in range(3):
        grasp = closed_ellipsoid_grasp(rng, 4, 0.5)
        problem = ng.GraspProblem(ng.Ellipsoid([2.0, 1.0, 1.0]), grasp.contacts, task)
        bounds = ng.mu(grasp, task)
        forces_needed = compute_exerted_forces(problem, grasp, problem.budget, bounds).needed
        expected = least_by_a_conic_program(grasp, forces_needed.wrench, 0.5)
        scale = np.linalg.norm(expected)
        np.testing.assert_allclose(forces_needed.forces, expected, atol=1e-4 * scale)
        assert forces_needed.budget.lower * 0.99 <= scale <= forces_needed.budget.upper * (1.0 + 1e-6)
        every = [np.linalg.norm(least_by_a_conic_program(grasp, w, 0.5), axis=1) for w in task.ends()]
        largest = np.max([np.linalg.norm(expected, axis=1), *every], axis=0)
        np.testing.assert_allclose(forces_needed.largest, largest, atol=1e-4 * scale)
        np.testing.assert_allclose(forces_needed.size, np.linalg.norm(expected, axis=1), atol=1e-4 * scale)
        np.testing.assert_allclose(forces_needed.normal, np.sum(expected * grasp.normals, axis=1), atol=1e-4 * scale)


def test_no_wrench_of_the_task_takes_more_than_is_certified(rng):
    """The bound is on every wrench of the task, at its full size."""
    grasp, task = closed_ellipsoid_grasp(rng), 30.0 * ng.TaskEllipsoid([1.0] * 6)
    problem = ng.GraspProblem(ng.Ellipsoid([2.0, 1.0, 1.0]), grasp.contacts, task)
    forces_needed = compute_exerted_forces(problem, grasp, problem.budget, ng.mu(grasp, task)).needed
    directions = rng.standard_normal((2000, 6))
    used = ng.finger_forces(grasp, task.support(directions)[1]).used
    assert np.max(used) <= forces_needed.budget.upper
    assert np.linalg.norm(forces_needed.forces) >= np.max(used) * 0.99


def test_a_grasp_that_does_not_hold_states_nothing():
    task = ng.TaskEllipsoid([1.0] * 6)
    assert needed(ng.Box([0.08, 0.04, 0.06]), *SIDES, [ng.FrictionContact(0.5)] * 2, task) is None
