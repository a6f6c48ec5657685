"""How far the rows of a quadratic program may be broken, and at what price: not at all, each alone, in groups."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.common.validation import FloatArray

TOLERANCE, SLACK_TOLERANCE = 1e-9, 1e-8  # of the solver
LEAST_CURVATURE = 1e-8  # of slacks with a linear price
IntArray = NDArray[np.intp]


class Slack(Protocol):
    """Slack variables s of a quadratic program: a row ``a d <= b`` becomes ``a d <= b + s``."""

    tolerance: ClassVar[float]  # of the solver
    at_least_zero: ClassVar[bool]  # whether s >= 0
    keeps_equations: ClassVar[bool]  # or takes an equation as two inequalities

    def columns(self, rows: IntArray) -> FloatArray:
        """Return the columns (m, slacks) of the slack variables for these rows of the program."""

    def prices(self, count: int) -> tuple[FloatArray, FloatArray]:
        """Return linear and quadratic prices of so many slack variables, (count,) each."""


@dataclass(frozen=True)
class NoSlack:
    """Rows that have to be kept."""

    tolerance: ClassVar[float] = TOLERANCE
    at_least_zero: ClassVar[bool] = False
    keeps_equations: ClassVar[bool] = True

    def columns(self, rows: IntArray) -> FloatArray:
        """Return a matrix without columns, (m, 0)."""
        return np.zeros((len(rows), 0))

    def prices(self, count: int) -> tuple[FloatArray, FloatArray]:
        """Return no prices, (0,) each, as there is nothing to price."""
        return np.zeros(0), np.zeros(0)


@dataclass(frozen=True)
class RowSlack:
    """One slack a row, priced by its square.

    Parameters
    ----------
    penalty : float
        Of half the square.
    """

    penalty: float
    tolerance: ClassVar[float] = SLACK_TOLERANCE
    at_least_zero: ClassVar[bool] = False
    keeps_equations: ClassVar[bool] = True

    def columns(self, rows: IntArray) -> FloatArray:
        """Return a column for each row."""
        return -np.eye(len(rows))

    def prices(self, count: int) -> tuple[FloatArray, FloatArray]:
        """Return no linear prices and the penalty for each square, (count,) each."""
        return np.zeros(count), np.full(count, self.penalty)


@dataclass(frozen=True)
class GroupSlack:
    """One slack a group of rows: the largest violation in it, priced as it is.

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

    def columns(self, rows: IntArray) -> FloatArray:
        """Return a column for each group, also for those without a row here."""
        columns = np.zeros((len(rows), len(self.weights)))
        columns[np.arange(len(rows)), self.member[rows]] = -1.0
        return columns

    def prices(self, count: int) -> tuple[FloatArray, FloatArray]:
        """Return the groups' weights, and next to nothing for the squares, (count,) each."""
        return self.weights, np.full(count, LEAST_CURVATURE)
