"""Newton's method for feasibility: quadratic convergence, stalling, contradicting constraints."""

import numpy as np
import pytest

from nlpgrasp.common.quadratic_program import ConstraintSlack, Linearised, NewtonRules, restore_feasibility

APART = 1.5


def on_sphere(z):
    """Two points on the unit sphere, at least ``APART`` from each other."""
    p, q = z[:3], z[3:]
    values = np.array([p @ p, q @ q, (p - q) @ (p - q)])
    J = np.zeros((3, 6))
    J[0, :3], J[1, 3:] = 2.0 * p, 2.0 * q
    J[2] = 2.0 * np.concatenate([p - q, q - p])
    lower, upper = np.array([1.0, 1.0, APART**2]), np.array([1.0, 1.0, np.inf])
    return Linearised(values, J, lower, upper, np.full(6, -0.4), np.full(6, 0.4))


@pytest.mark.parametrize("seed", range(4))
def test_two_points_come_onto_a_sphere_and_apart(seed):
    start = np.random.default_rng(seed).uniform(-1.0, 1.0, 6)
    result = restore_feasibility(on_sphere, start, NewtonRules(steps=30, enough=1e-9, slack=ConstraintSlack(1e4)))
    p, q = result.best[:3], result.best[3:]
    assert result.violation <= 1e-9 < on_sphere(start).violation
    np.testing.assert_allclose([p @ p, q @ q], 1.0, atol=1e-9)
    assert np.linalg.norm(p - q) >= APART - 1e-9
    assert not result.contradicted


def test_the_residual_falls_quadratically():
    start = np.array([0.9, 0.2, 0.0, -0.8, 0.3, 0.0])
    first, second, third = (restore_feasibility(on_sphere, start, NewtonRules(n, 0.0)).violation for n in (2, 3, 4))
    assert second < first**1.5
    assert third < second**1.5


def test_no_step_is_taken_where_all_is_well():
    start = np.array([1.0, 0.0, 0.0, -1.0, 0.0, 0.0])
    result = restore_feasibility(on_sphere, start, NewtonRules(steps=5, enough=1e-9))
    np.testing.assert_array_equal(result.last, start)


def contradiction(z):
    return Linearised(
        z[[0, 0]],
        np.ones((2, 1)),
        np.array([1.0, -np.inf]),
        np.array([np.inf, -1.0]),
        np.full(1, -9.0),
        np.full(1, 9.0),
    )


def test_contradicting_rows_end_it_without_slack():
    result = restore_feasibility(contradiction, np.array([0.5]), NewtonRules(steps=10, enough=1e-9))
    assert result.contradicted
    assert result.violation == 1.5
    assert result.last == 0.5


def test_with_slack_it_ends_between_them_and_out_of_patience():
    calls = []

    def record(z):
        calls.append(z)
        return contradiction(z)

    result = restore_feasibility(
        record, np.array([0.5]), NewtonRules(steps=50, enough=1e-9, patience=3, slack=ConstraintSlack(1e4))
    )
    assert not result.contradicted
    assert result.best[0] == pytest.approx(0.0, abs=1e-3)
    assert result.violation == pytest.approx(1.0, abs=1e-3)
    assert len(calls) < 12


def test_the_best_is_kept_and_the_last_step_counted():
    """Rows that mislead: 1 + z^2 = 0 with a slope of -1. A step of 1 makes it worse, and is taken again at 0.3."""

    def misleading(z):
        return Linearised(1.0 + z**2, np.array([[-1.0]]), np.zeros(1), np.zeros(1), -np.full(1, 9.0), np.full(1, 9.0))

    result = restore_feasibility(misleading, np.array([0.0]), NewtonRules(steps=2, enough=0.0))
    assert result.best == 0.0
    assert result.violation == 1.0
    assert result.last == pytest.approx(0.3, abs=1e-6)
