"""Tests of interval arithmetic against values at random points, and against exact sums of fractions."""

from fractions import Fraction

import casadi as ca
import numpy as np
import pytest

from nlpgrasp.common.intervals import Interval, UnknownOperationError, interval_bounds


def function(*expressions):
    u = ca.SX.sym("u", 2)
    return ca.Function("f", [u], [ca.vertcat(*(expression(u) for expression in expressions))])


def boxes(rng, count, low=-3.0, high=3.0):
    lower = rng.uniform(low, high, (count, 2))
    return lower, lower + rng.uniform(0.0, 1.5, (count, 2)) * rng.uniform(0.0, 1.0, (count, 1)) ** 3


EXPRESSIONS = {
    "waves": lambda u: ca.sin(3.0 * u[0]) * ca.cos(u[1] - 2.0 * u[0]),
    "quotient": lambda u: (u[0] - u[1]) / (1.0 + u[0] ** 2 + u[1] ** 4),
    "root": lambda u: ca.sqrt(u[0] ** 2 + 0.1) - 1.0 / ca.sqrt(u[1] ** 2 + 0.3),
    "exponential": lambda u: ca.exp(-u[0] * u[1]) + ca.log(2.0 + ca.sin(u[0])),
    "powers": lambda u: u[0] ** 3 - 2.0 * u[1] ** 5 + (4.0 + u[0]) ** 1.7 + (u[1] ** 2 + 1.0) ** -3,
    "squares": lambda u: u[0] ** 2 - (u[0] * u[1]) ** 2,
}


@pytest.mark.parametrize("name", EXPRESSIONS)
def test_bounds_hold_at_all_points_and_close_in_with_the_box(name):
    rng, f = np.random.default_rng(0), function(EXPRESSIONS[name])
    lower, upper = boxes(rng, 200)
    (bounds,) = interval_bounds(f, lower, upper)[0]
    for share in [np.zeros((200, 2)), np.ones((200, 2)), *rng.uniform(size=(40, 200, 2))]:
        values = np.array(f.map(200)((lower + share * (upper - lower)).T)).ravel()
        assert np.all(bounds.lower <= values)
        assert np.all(values <= bounds.upper)
    widths = []
    for size in (1e-2, 1e-4):
        (narrow,) = interval_bounds(f, lower, lower + size)[0]
        widths.append(np.max(narrow.upper - narrow.lower))
    assert widths[1] < 0.02 * widths[0]


def test_sums_and_products_are_rounded_outwards():
    a, b = np.random.default_rng(1).standard_normal((2, 1000))
    for result, exact in (
        (Interval.of(a) + Interval.of(b), [Fraction(x) + Fraction(y) for x, y in zip(a, b, strict=True)]),
        (Interval.of(a) * Interval.of(b), [Fraction(x) * Fraction(y) for x, y in zip(a, b, strict=True)]),
        (Interval.of(a) / Interval.of(b), [Fraction(x) / Fraction(y) for x, y in zip(a, b, strict=True)]),
    ):
        ends = zip(result.lower.tolist(), exact, result.upper.tolist(), strict=True)
        assert all(Fraction(low) <= value <= Fraction(high) for low, value, high in ends)


def test_where_nothing_is_known_no_bound_is_finite():
    f = function(lambda u: 1.0 / u[0], lambda u: ca.sqrt(u[0] - 2.0) / u[1])
    for bound in interval_bounds(f, np.array([[-1.0, 0.0]]), np.array([[1.0, 0.0]]))[0]:
        assert not np.isfinite(bound.largest[0])


def test_an_operation_without_bounds_is_named():
    with pytest.raises(UnknownOperationError, match=r"operation \d+ of CasADi \(f\)"):
        interval_bounds(function(lambda u: ca.erf(u[0])), np.zeros((1, 2)), np.ones((1, 2)))
    with pytest.raises(UnknownOperationError, match="a power whose exponent is not constant"):
        interval_bounds(function(lambda u: u[0] ** u[1]), np.ones((1, 2)), np.ones((1, 2)))
