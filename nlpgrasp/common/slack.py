"""Slack models of a quadratic program: none, squared per constraint, or linear per group."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.common.validation import FloatArray

TOLERANCE, SLACK_TOLERANCE = 1e-9, 1e-8  # solver tolerance without and with slack
LEAST_CURVATURE = 1e-8  # quadratic penalty of slacks with a linear one
IntArray = NDArray[np.intp]


class Slack(Protocol):
    """Interface of slack variables s of a quadratic program: ``a d <= b`` becomes ``a d <= b + s``."""

    tolerance: ClassVar[float]  # of the solver
    at_least_zero: ClassVar[bool]  # whether s >= 0
    keeps_equations: ClassVar[bool]  # or takes an equation as two inequalities

    def columns(self, rows: IntArray) -> FloatArray:
        """Return the columns (m, slacks) of the slack variables for these constraints."""

    def prices(self, count: int) -> tuple[FloatArray, FloatArray]:
        """Return the linear and quadratic penalties of the slacks, (count,) each."""


@dataclass(frozen=True)
class NoSlack:
    """Hard constraints, without slack."""

    tolerance: ClassVar[float] = TOLERANCE
    at_least_zero: ClassVar[bool] = False
    keeps_equations: ClassVar[bool] = True

    def columns(self, rows: IntArray) -> FloatArray:
        """Return an empty matrix, (m, 0)."""
        return np.zeros((len(rows), 0))

    def prices(self, count: int) -> tuple[FloatArray, FloatArray]:
        """Return empty penalties, (0,) each."""
        return np.zeros(0), np.zeros(0)


@dataclass(frozen=True)
class RowSlack:
    """One slack per constraint, with a quadratic penalty.

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
        """Return one column per constraint."""
        return -np.eye(len(rows))

    def prices(self, count: int) -> tuple[FloatArray, FloatArray]:
        """Return zero linear penalties and the quadratic penalty for each slack, (count,) each."""
        return np.zeros(count), np.full(count, self.penalty)


@dataclass(frozen=True)
class GroupSlack:
    """One slack per group of constraints: its largest violation, with a linear penalty.

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
        """Return one column per group, also for groups without a constraint here."""
        columns = np.zeros((len(rows), len(self.weights)))
        columns[np.arange(len(rows)), self.member[rows]] = -1.0
        return columns

    def prices(self, count: int) -> tuple[FloatArray, FloatArray]:
        """Return the groups' weights as linear penalties, and tiny quadratic ones, (count,) each."""
        return self.weights, np.full(count, LEAST_CURVATURE)
