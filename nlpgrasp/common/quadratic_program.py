"""Quadratic program for the shortest step onto linearised constraints, and Newton's method for feasibility."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, Generic, Protocol, TypeVar

import clarabel
import numpy as np
from scipy import sparse

from nlpgrasp.common.validation import BoolArray, FloatArray, IntArray

LONG, SHORT = 0.99, 0.9  # step fractions to the cones' boundary: Clarabel's default, and a more robust one
TOLERANCE, SLACK_TOLERANCE = 1e-9, 1e-8  # solver tolerance without and with slack
LEAST_CURVATURE = 1e-8  # quadratic penalty of slacks with a linear one
STEP_SHARE = 0.05  # share of the step's bounds: constraints that such a step can violate are included first
BROKEN = 1e-9  # least violation at which an omitted constraint is added
OVERSHOT = 1.5  # violation after a Newton step over the one before it above which the step is shortened
SHORTER, LEAST_SHARE = 0.3, 0.1  # factor on the step; share of it below which it is taken as it is
STALLED = 0.98  # share of the violation left by a step above which it counts as no progress


class Slack(Protocol):
    """Interface of slack variables s of a quadratic program: ``a d <= b`` becomes ``a d <= b + s``."""

    tolerance: ClassVar[float]  # of the solver
    at_least_zero: ClassVar[bool]  # whether s >= 0
    keeps_equations: ClassVar[bool]  # or takes an equation as two inequalities

    def columns(self, indices: IntArray) -> FloatArray:
        """Return the columns (m, slacks) of the slack variables in the constraints with given indices."""

    def penalties(self, count: int) -> tuple[FloatArray, FloatArray]:
        """Return the linear and quadratic penalties of the slacks, (count,) each."""


@dataclass(frozen=True)
class NoSlack:
    """Hard constraints without slack variables."""

    tolerance: ClassVar[float] = TOLERANCE
    at_least_zero: ClassVar[bool] = False
    keeps_equations: ClassVar[bool] = True

    def columns(self, indices: IntArray) -> FloatArray:
        """Return a matrix without columns, (m, 0)."""
        return np.zeros((len(indices), 0))

    def penalties(self, count: int) -> tuple[FloatArray, FloatArray]:
        """Return two empty arrays."""
        return np.zeros(0), np.zeros(0)


NO_SLACK = NoSlack()  # default of quadratic programs


@dataclass(frozen=True)
class ConstraintSlack:
    """One slack variable per constraint, with a quadratic penalty.

    Parameters
    ----------
    penalty : float
        Of half the square.
    """

    penalty: float
    tolerance: ClassVar[float] = SLACK_TOLERANCE
    at_least_zero: ClassVar[bool] = False
    keeps_equations: ClassVar[bool] = True

    def columns(self, indices: IntArray) -> FloatArray:
        """Return one column for each of the constraints."""
        return -np.eye(len(indices))

    def penalties(self, count: int) -> tuple[FloatArray, FloatArray]:
        """Return zero linear penalties and the quadratic penalty for each slack, (count,) each."""
        return np.zeros(count), np.full(count, self.penalty)


@dataclass(frozen=True)
class GroupSlack:
    """One slack variable per group of constraints, their largest violation, with a linear penalty.

    Parameters
    ----------
    member : (rows,) array of int
        Group of each row of the program.
    weights : (groups,) array
    """

    member: IntArray
    weights: FloatArray
    tolerance: ClassVar[float] = SLACK_TOLERANCE
    at_least_zero: ClassVar[bool] = True
    keeps_equations: ClassVar[bool] = False

    def columns(self, indices: IntArray) -> FloatArray:
        """Return one column for each group, even if none of its constraints is given."""
        columns = np.zeros((len(indices), len(self.weights)))
        columns[np.arange(len(indices)), self.member[indices]] = -1.0
        return columns

    def penalties(self, count: int) -> tuple[FloatArray, FloatArray]:
        """Return the groups' weights as linear penalties, and tiny quadratic ones, (count,) each."""
        return self.weights, np.full(count, LEAST_CURVATURE)


@dataclass(frozen=True)
class Linearised:
    """Linearised constraints ``lower <= values + jacobian d <= upper`` and bounds on a step d.

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
        """Violation of each constraint without a step, (m,), at least zero."""
        return np.maximum(np.maximum(self.lower - self.values, self.values - self.upper), 0.0)

    @property
    def violation(self) -> float:
        """Largest violation; inf if any violation is not finite."""
        worst = float(np.max(self.violations, initial=0.0))
        return worst if np.isfinite(worst) else np.inf


def step_bounds(
    z: FloatArray, bounds: tuple[FloatArray, FloatArray], longest: FloatArray | float
) -> tuple[FloatArray, FloatArray]:
    """Return the bounds of a step, (n,) each, given the variables' bounds and the longest step."""
    lower, upper = bounds
    least, most = np.maximum(lower - z, -longest), np.minimum(upper - z, longest)
    return np.minimum(least, 0.0), np.maximum(most, 0.0)  # z may be a little out of bounds


@dataclass(frozen=True)
class QuadraticStep:
    """Solution of the quadratic program: step and Lagrange multipliers.

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


def quadratic_step(
    constraints: Linearised,
    cost: FloatArray | None = None,
    damping: float = 1.0,
    slack: Slack = NO_SLACK,
    curvature: FloatArray | None = None,
) -> QuadraticStep | None:
    """Return the step d that solves the quadratic program, with multipliers; None if it is infeasible.

    It minimises ``cost d + damping |d|^2 / 2 + d curvature d / 2`` and the penalty. Most rows are far from their
    limits: the program begins with equations and with rows that a short step can break, and takes in others where its
    answer breaks them.

    Parameters
    ----------
    constraints : Linearised
    cost : (n,) array, optional
        Zero when left out.
    damping : float
    slack : Slack
        How far rows may be broken: by default not at all.
    curvature : (n, n) array, optional
        Positive semidefinite; zero when left out.
    """
    g, J, lower, upper = constraints.values, constraints.jacobian, constraints.lower, constraints.upper
    square = damping * np.eye(J.shape[1]) + (0.0 if curvature is None else curvature)
    reach = STEP_SHARE * np.abs(J) @ np.maximum(-constraints.least, constraints.most)
    included = (lower == upper) | (g - reach < lower) | (g + reach > upper)
    while True:
        step = _solve_subset(constraints, included, np.zeros(J.shape[1]) if cost is None else cost, square, slack)
        if step is None:
            return None
        trial = g + J @ step.d
        violated = ~included & ((trial < lower - BROKEN) | (trial > upper + BROKEN))
        if not np.any(violated):
            return step
        included |= violated


def _solve_subset(
    constraints: Linearised, included: BoolArray, cost: FloatArray, square: FloatArray, slack: Slack
) -> QuadraticStep | None:
    """Return the solution of the quadratic program with a subset of the constraints; None if infeasible."""
    g, J, lower, upper = constraints.values, constraints.jacobian, constraints.lower, constraints.upper
    n = J.shape[1]
    equal = included & (lower == upper) & slack.keeps_equations
    below, above = included & ~equal & np.isfinite(lower), included & ~equal & np.isfinite(upper)
    indices = [np.flatnonzero(mask) for mask in (equal, below, above)]
    count = sum(map(len, indices))
    columns = slack.columns(np.concatenate(indices))
    m = columns.shape[1]
    A = np.zeros((count + 2 * n + m * slack.at_least_zero, n + m))
    A[:count, :n] = np.concatenate([J[equal], -J[below], J[above]])
    A[:count, n:] = columns
    A[count : count + n, :n] = np.eye(n)
    A[count + n : count + 2 * n, :n] = -np.eye(n)
    b = [(lower - g)[equal], (g - lower)[below], (upper - g)[above], constraints.most, -constraints.least]
    if slack.at_least_zero:
        A[count + 2 * n :, n:] = -np.eye(m)
        b.append(np.zeros(m))
    linear, quadratic = slack.penalties(m)
    rhs = np.concatenate(b)
    cones = [clarabel.ZeroConeT(len(indices[0])), clarabel.NonnegativeConeT(len(rhs) - len(indices[0]))]
    P = np.zeros((n + m, n + m))
    P[:n, :n] = np.triu(square)
    P[np.arange(n, n + m), np.arange(n, n + m)] = quadratic
    q = np.concatenate([cost, linear])
    solution = clarabel.DefaultSolver(_sparse(P), q, _sparse(A), rhs, cones, quiet_settings(slack.tolerance)).solve()
    if "Solved" not in str(solution.status):
        return None
    multipliers = np.zeros(len(g))
    duals = np.split(np.array(solution.z), np.cumsum([*(len(mask) for mask in indices), n, n]))
    for index, sign, dual in zip(indices, (1.0, -1.0, 1.0), duals, strict=False):
        multipliers[index] += sign * dual
    return QuadraticStep(np.array(solution.x)[:n], multipliers, duals[3] - duals[4])


def _sparse(matrix: FloatArray) -> sparse.csc_matrix:
    """Return a matrix in compressed sparse columns.

    scipy's own conversion takes longer than the solver.
    """
    column, row = np.nonzero(matrix.T)
    ends = np.concatenate([[0], np.cumsum(np.bincount(column, minlength=matrix.shape[1]))])
    return sparse.csc_matrix((matrix[row, column], row, ends), shape=matrix.shape)


def cone_of(matrix: FloatArray) -> object:
    """Return the cone in which ``M x`` has to be: second-order, or nonnegative for a single row."""
    return clarabel.NonnegativeConeT(1) if len(matrix) == 1 else clarabel.SecondOrderConeT(len(matrix))


def quiet_settings(tolerance: float, step: float = LONG) -> clarabel.DefaultSettings:
    """Return solver settings without output, with a tolerance for gap and feasibility."""
    options = clarabel.DefaultSettings()
    options.verbose = False
    options.max_step_fraction = step
    options.tol_gap_abs = options.tol_gap_rel = options.tol_feas = tolerance
    return options


R = TypeVar("R", bound=Linearised)


@dataclass(frozen=True)
class NewtonRules:
    """Termination rules of Newton's method for feasibility.

    Parameters
    ----------
    steps : int
        At most.
    enough : float
        Violation at which they end.
    patience : int
        Steps in a row that hardly help, after which they end.
    slack : Slack
        With slack a step exists also where the rows contradict each other (Levenberg and Marquardt, with bounds).
    """

    steps: int
    enough: float
    patience: int = 1000
    slack: Slack = NO_SLACK


@dataclass(frozen=True)
class NewtonResult(Generic[R]):
    """Result of Newton's method for feasibility.

    Parameters
    ----------
    best : (n,) array
        The variables of least violation.
    rows : Linearised
        The rows there.
    last : (n,) array
        The variables after the last step, whose rows have not been looked at where all steps were taken.
    contradicted : bool
        Whether the steps ended because the linearised rows contradict each other.
    """

    best: FloatArray
    rows: R
    last: FloatArray
    contradicted: bool

    @property
    def violation(self) -> float:
        """Least violation that was reached."""
        return self.rows.violation


def restore_feasibility(linearise: Callable[[FloatArray], R], z: FloatArray, rules: NewtonRules) -> NewtonResult[R]:
    """Return the result of Newton steps that reduce the violation of the constraints.

    Parameters
    ----------
    linearise : callable
        Variables to the rows there, linearised, with bounds of the step.
    z : (n,) array
    rules : NewtonRules
    """
    constraints = linearise(z)
    best, best_constraints, stalled, contradicted = z, constraints, 0, False
    step, fraction = None, 1.0
    for remaining in reversed(range(rules.steps)):
        if constraints.violation <= rules.enough or stalled > rules.patience:
            break
        if step is None:
            step, fraction = quadratic_step(constraints, slack=rules.slack), 1.0
        if step is None:
            contradicted = True
            break
        moved_z = z + fraction * step.d
        if remaining:
            moved = linearise(moved_z)
            stalled = 0 if moved.violation < STALLED * best_constraints.violation else stalled + 1
            if moved.violation < best_constraints.violation:
                best, best_constraints = moved_z, moved
            if moved.violation > OVERSHOT * constraints.violation and fraction > LEAST_SHARE:
                fraction *= SHORTER
                continue
            constraints, step = moved, None
        z = moved_z
    return NewtonResult(best, best_constraints, z, contradicted)
