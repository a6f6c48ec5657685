"""Tests of the energy to drop: against descents of the support ratio, springs in closed form, and units."""

import numpy as np
import pytest
from scipy.optimize import minimize

import nlpgrasp as ng
from nlpgrasp.budgets import force_budget
from nlpgrasp.quality.energy_to_drop import energy_to_drop

ARMS = np.array([[0.03, 0.0, 0.0], [-0.03, 0.0, 0.0], [0.0, 0.03, 0.0], [0.0, -0.03, 0.01]])
AROUND = ng.Grasp(ARMS, -np.sign(ARMS) * (np.abs(ARMS) > 0.02), ng.SoftContact(0.6, 0.01))


@pytest.mark.parametrize("budget", ["l2", "shared", "per_finger"])
def test_it_is_the_least_energy_on_the_boundary_of_the_wrench_set(budget):
    rng, forces = np.random.default_rng(0), force_budget(budget).at(AROUND.frames, AROUND.contacts)
    scale = np.array([1.0, 1.0, 1.0, 0.03, 0.03, 0.03])
    G = AROUND.G / scale[:, None]
    stiff = 1000.0 * G @ G.T

    def ratio(y):
        return float(forces.support((y @ G)[None])[0][0] / np.sqrt(y @ stiff @ y))

    drawn = rng.standard_normal((20_000, 6))
    ratios = forces.support(drawn @ G)[0] / np.sqrt(np.einsum("ij,jk,ik->i", drawn, stiff, drawn))
    options = {"maxiter": 5000, "maxfev": 5000, "xatol": 1e-9, "fatol": 1e-12, "adaptive": True}
    runs = [minimize(ratio, drawn[i], method="Nelder-Mead", options=options) for i in np.argsort(ratios)[:4]]
    least = min(minimize(ratio, run.x, method="Nelder-Mead", options=options).fun for run in runs)
    found = energy_to_drop(AROUND, None, force_budget(budget))
    assert 0.97 * 0.5 * least**2 <= found <= 0.5 * least**2 * (1.0 + 1e-6)


def test_two_fingers_without_friction_in_the_plane_bear_no_push_aside():
    pinch = ng.Grasp([[0.03, 0.0], [-0.03, 0.0]], [[-1.0, 0.0], [1.0, 0.0]], ng.PointContact())
    assert energy_to_drop(pinch, None, force_budget("l2")) == 0.0


def test_softer_springs_store_more():
    hard, soft = (energy_to_drop(AROUND, None, force_budget("l2"), k) for k in (1000.0, 100.0))
    assert soft == pytest.approx(10.0 * hard, rel=0.03)


def test_a_solution_states_it_and_its_file_is_verified(tmp_path):
    task = ng.TaskEllipsoid([1, 1, 1, 0.03, 0.03, 0.03])
    problem = ng.GraspProblem(ng.Box([0.08, 0.04, 0.04]), [ng.FrictionContact(0.6)] * 3, task)
    solution = ng.solve(problem, 1, options=ng.SolveOptions(workers=1, rounds=2, analyses=("energy to drop",)))
    (measure,) = solution.measures
    assert measure.value == pytest.approx(energy_to_drop(solution.grasp, None, force_budget("l2")))
    assert "energy to drop" in str(solution)
    checks = ng.verify(solution.save(tmp_path / "box.json")).checks
    assert "energy to drop" in [check.name for check in checks if check.passed]
    (value,) = ng.measure(
        ng.GraspStack(
            solution.grasp.points[None],
            solution.grasp.normals[None],
            ng.FrictionContact(0.6),
            solution.grasp.torque_origin,
        ),
        measures=["energy to drop"],
    )["energy to drop"]
    assert value == pytest.approx(measure.value)
