"""Shortest step of the quadratic program: closed forms, scipy, slack, contradicting constraints."""

import numpy as np
import pytest
from scipy.optimize import minimize

from nlpgrasp.common.quadratic_program import ConstraintSlack, GroupSlack, Linearised, quadratic_step, step_bounds


def rows(jacobian, lower, upper, values=None, longest=10.0):
    J = np.atleast_2d(np.array(jacobian, dtype=float))
    m, n = J.shape
    g = np.zeros(m) if values is None else np.array(values, dtype=float)
    low, high = (np.array(limit, dtype=float) for limit in (lower, upper))
    return Linearised(g, J, low, high, np.full(n, -longest), np.full(n, longest))


def test_an_equation_by_hand():
    """The least d1^2 + d2^2 with d1 + d2 = 1 is at a half each; its multiplier is minus that."""
    step = quadratic_step(rows([1.0, 1.0], [1.0], [1.0]))
    np.testing.assert_allclose(step.d, [0.5, 0.5], atol=1e-8)
    np.testing.assert_allclose(step.multipliers, [-0.5], atol=1e-8)


def test_multipliers_have_the_sign_of_their_limit():
    """Pulled to d = 1 and held at 0.25 from above; pushed from 0 to 0.25 from below."""
    upper = quadratic_step(rows([1.0], [-np.inf], [0.25]), cost=np.array([-1.0]))
    np.testing.assert_allclose([upper.d[0], upper.multipliers[0]], [0.25, 0.75], atol=1e-7)
    lower = quadratic_step(rows([1.0], [0.25], [np.inf]))
    np.testing.assert_allclose([lower.d[0], lower.multipliers[0]], [0.25, -0.25], atol=1e-7)


def test_a_row_out_of_reach_is_left_out():
    step = quadratic_step(rows([[1.0], [1.0]], [-np.inf, 0.5], [100.0, np.inf]))
    assert step.multipliers[0] == 0.0
    assert step.d[0] == pytest.approx(0.5, abs=1e-8)


@pytest.mark.parametrize("seed", range(8))
def test_against_scipy(seed):
    rng = np.random.default_rng(seed)
    n, m, damping = 6, 5, 0.3
    J, cost, feasible = rng.standard_normal((m, n)), rng.standard_normal(n), 0.3 * rng.standard_normal(n)
    g = rng.standard_normal(m)
    low, high = g + J @ feasible - rng.random(m), g + J @ feasible + rng.random(m)
    high[0] = low[0] = (g + J @ feasible)[0]
    linearised = rows(J, low, high, g, longest=1.0)
    step = quadratic_step(linearised, cost, damping)
    inequalities = [
        {"type": "ineq", "fun": lambda d: (g + J @ d - low)[1:], "jac": lambda d: J[1:]},
        {"type": "ineq", "fun": lambda d: (high - g - J @ d)[1:], "jac": lambda d: -J[1:]},
        {"type": "eq", "fun": lambda d: (g + J @ d - low)[:1], "jac": lambda d: J[:1]},
    ]
    expected = minimize(
        lambda d: cost @ d + damping * d @ d / 2.0,
        np.zeros(n),
        jac=lambda d: cost + damping * d,
        bounds=[(-1.0, 1.0)] * n,
        constraints=inequalities,
        method="SLSQP",
        options={"ftol": 1e-14, "maxiter": 500},
    )
    np.testing.assert_allclose(step.d, expected.x, atol=1e-5)
    values = g + J @ step.d
    assert np.all(values >= low - 1e-7)
    assert np.all(values <= high + 1e-7)
    free = np.abs(step.d) < 1.0 - 1e-6
    np.testing.assert_allclose((cost + damping * step.d + J.T @ step.multipliers)[free], 0.0, atol=1e-6)


CONTRADICTION = ([[1.0], [1.0]], [1.0, -np.inf], [np.inf, -1.0])  # d >= 1 and d <= -1


def test_a_contradiction_has_no_step():
    assert quadratic_step(rows(*CONTRADICTION)) is None
    assert quadratic_step(rows([1.0], [1.0], [1.0], longest=0.5)) is None


def test_slack_of_a_row_is_priced_by_its_square():
    """The least d^2 / 2 + w s^2 / 2 with d = 1 + s is at w / (1 + w)."""
    step = quadratic_step(rows([1.0], [1.0], [1.0]), slack=ConstraintSlack(4.0))
    assert step.d[0] == pytest.approx(0.8, abs=1e-6)
    compromise = quadratic_step(rows(*CONTRADICTION), slack=ConstraintSlack(4.0))
    assert compromise.d[0] == pytest.approx(0.0, abs=1e-6)


def test_the_heavier_group_is_kept():
    weights = np.array([1.0, 5.0])
    for member, limit in (([0, 1], -1.0), ([1, 0], 1.0)):
        slack = GroupSlack(np.array(member), weights)
        step = quadratic_step(rows(*CONTRADICTION), damping=1e-3, slack=slack)
        assert step.d[0] == pytest.approx(limit, abs=1e-4)


def test_a_group_pays_for_its_worst_row_alone():
    """Both rows in one group: any d between the limits costs d^2 more than the middle, the violations' largest is 1."""
    slack = GroupSlack(np.array([0, 0]), np.array([5.0]))
    assert quadratic_step(rows(*CONTRADICTION), damping=1e-3, slack=slack).d[0] == pytest.approx(0.0, abs=1e-4)


def test_a_group_takes_an_equation_as_two_inequalities():
    slack = GroupSlack(np.array([0]), np.array([5.0]))
    step = quadratic_step(rows([1.0], [2.0], [2.0], longest=0.5), damping=1e-3, slack=slack)
    assert step.d[0] == pytest.approx(0.5, abs=1e-5)


def test_violations_and_bounds_of_a_step():
    linearised = rows(np.eye(3), [0.0, 1.0, -np.inf], [1.0, 2.0, 0.5], values=[-0.5, 1.5, 0.7])
    np.testing.assert_allclose(linearised.violations, [0.5, 0.0, 0.2])
    assert linearised.violation == 0.5
    assert rows([1.0], [0.0], [1.0], values=[np.nan]).violation == np.inf
    least, most = step_bounds(np.array([0.0, 0.9, 1.2]), (np.zeros(3), np.ones(3)), 0.4)
    np.testing.assert_allclose(least, [0.0, -0.4, -0.4])
    np.testing.assert_allclose(most, [0.4, 0.1, 0.0])
