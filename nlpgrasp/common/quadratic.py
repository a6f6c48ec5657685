"""Quadratic program for the shortest step onto linearised constraints, solved by Clarabel."""

from __future__ import annotations

from dataclasses import dataclass

import clarabel
import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from nlpgrasp.common.conic import quiet_settings
from nlpgrasp.common.slack import NoSlack, Slack
from nlpgrasp.common.validation import FloatArray

NO_SLACK = NoSlack()
SHORT = 0.05  # share of the step's bounds: constraints that such a step can violate are included first
BROKEN = 1e-9  # least violation at which an omitted constraint is added


@dataclass(frozen=True)
class Linearised:
    """Linearised constraints ``lower <= values + jacobian d <= upper`` on a step d, and its bounds.

    Parameters
    ----------
    values : (m,) array
    jacobian : (m, n) array
    lower, upper : (m,) array
        Limits of the rows; equal where the row is an equation.
    least, most : (n,) array
        Bounds of the step, zero between them.
    """

    values: FloatArray
    jacobian: FloatArray
    lower: FloatArray
    upper: FloatArray
    least: FloatArray
    most: FloatArray

    @property
    def violations(self) -> FloatArray:
        """Violation of each constraint by the zero step, (m,), at least zero."""
        return np.maximum(np.maximum(self.lower - self.values, self.values - self.upper), 0.0)

    @property
    def violation(self) -> float:
        """Largest violation; inf where one is unknown."""
        worst = float(np.max(self.violations, initial=0.0))
        return worst if np.isfinite(worst) else np.inf


def step_bounds(
    z: FloatArray, bounds: tuple[FloatArray, FloatArray], longest: FloatArray | float
) -> tuple[FloatArray, FloatArray]:
    """Return least and most step, (n,) each, from z within the variables' bounds and the step's own limit."""
    lower, upper = bounds
    least, most = np.maximum(lower - z, -longest), np.minimum(upper - z, longest)
    return np.minimum(least, 0.0), np.maximum(most, 0.0)  # z may be a little out of bounds


@dataclass(frozen=True)
class QuadraticStep:
    """Solution of the quadratic program: step and multipliers.

    Parameters
    ----------
    d : (n,) array
    multipliers : (m,) array
        Of the rows: positive where the upper limit is active, negative where the lower one is.
    bound_multipliers : (n,) array
        Of the step's bounds, with the same signs.
    """

    d: FloatArray
    multipliers: FloatArray
    bound_multipliers: FloatArray


def shortest_step(
    rows: Linearised,
    cost: FloatArray | None = None,
    damping: float = 1.0,
    slack: Slack = NO_SLACK,
    curvature: FloatArray | None = None,
) -> QuadraticStep | None:
    """Return the minimiser of ``cost d + damping |d|^2 / 2`` plus slack penalty; None if infeasible.

    Most rows are far from their limits: the program begins with equations and with rows that a short step can break,
    and takes in others where its answer breaks them.

    Parameters
    ----------
    rows : Linearised
    cost : (n,) array, optional
        Zero when left out.
    damping : float
    slack : Slack
        How far rows may be broken: by default not at all.
    curvature : (n, n) array, optional
        Positive semidefinite: ``d curvature d / 2`` is added to what is least.
    """
    g, J = rows.values, rows.jacobian
    square = damping * np.eye(J.shape[1]) + (0.0 if curvature is None else curvature)
    reach = SHORT * np.abs(J) @ np.maximum(-rows.least, rows.most)
    seen = (rows.lower == rows.upper) | (g - reach < rows.lower) | (g + reach > rows.upper)
    while True:
        found = _solved(rows, seen, np.zeros(J.shape[1]) if cost is None else cost, square, slack)
        if found is None:
            return None
        there = g + J @ found.d
        broken = ~seen & ((there < rows.lower - BROKEN) | (there > rows.upper + BROKEN))
        if not np.any(broken):
            return found
        seen |= broken


def _solved(
    rows: Linearised, seen: NDArray[np.bool_], cost: FloatArray, square: FloatArray, slack: Slack
) -> QuadraticStep | None:
    """Return the solution with a subset of the constraints; None if infeasible."""
    g, J = rows.values, rows.jacobian
    n = J.shape[1]
    equal = seen & (rows.lower == rows.upper) & slack.keeps_equations
    below, above = seen & ~equal & np.isfinite(rows.lower), seen & ~equal & np.isfinite(rows.upper)
    used = [np.flatnonzero(mask) for mask in (equal, below, above)]
    count = sum(map(len, used))
    columns = slack.columns(np.concatenate(used))
    m = columns.shape[1]
    A = np.zeros((count + 2 * n + m * slack.at_least_zero, n + m))
    A[:count, :n] = np.concatenate([J[equal], -J[below], J[above]])
    A[:count, n:] = columns
    A[count : count + n, :n] = np.eye(n)
    A[count + n : count + 2 * n, :n] = -np.eye(n)
    b = [(rows.lower - g)[equal], (g - rows.lower)[below], (rows.upper - g)[above], rows.most, -rows.least]
    if slack.at_least_zero:
        A[count + 2 * n :, n:] = -np.eye(m)
        b.append(np.zeros(m))
    linear, quadratic = slack.prices(m)
    right = np.concatenate(b)
    cones = [clarabel.ZeroConeT(len(used[0])), clarabel.NonnegativeConeT(len(right) - len(used[0]))]
    P = np.zeros((n + m, n + m))
    P[:n, :n] = np.triu(square)
    P[np.arange(n, n + m), np.arange(n, n + m)] = quadratic
    q = np.concatenate([cost, linear])
    found = clarabel.DefaultSolver(_sparse(P), q, _sparse(A), right, cones, quiet_settings(slack.tolerance)).solve()
    if "Solved" not in str(found.status):
        return None
    multipliers = np.zeros(len(g))
    duals = np.split(np.array(found.z), np.cumsum([*(len(mask) for mask in used), n, n]))
    for where, sign, dual in zip(used, (1.0, -1.0, 1.0), duals, strict=False):
        multipliers[where] += sign * dual
    return QuadraticStep(np.array(found.x)[:n], multipliers, duals[3] - duals[4])


def _sparse(matrix: FloatArray) -> sparse.csc_matrix:
    """Return a matrix in sparse columns (scipy's own conversion takes longer than the solver)."""
    column, row = np.nonzero(matrix.T)
    ends = np.concatenate([[0], np.cumsum(np.bincount(column, minlength=matrix.shape[1]))])
    return sparse.csc_matrix((matrix[row, column], row, ends), shape=matrix.shape)
