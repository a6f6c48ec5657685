"""First-order optimality (KKT) residuals of a nonlinear program, in the solver's scaled units."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Self

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import InputError
from nlpgrasp.solution.record_fields import LATER, LEFT_OUT, Direction, NonNegative, Record

SMALL = 1e-6  # scaled residuals below count as zero: a first-order optimum


@dataclass(frozen=True)
class KKT(Record):
    """Residuals of the Karush-Kuhn-Tucker conditions at a point with its multipliers.

    All three are scaled: variables over their typical sizes, constraints over theirs, the objective over its value.

    Parameters
    ----------
    stationarity : float
        Largest entry of the Lagrangian's gradient.
    feasibility : float
        Largest violation of a constraint or bound.
    complementarity : float
        Largest product of a multiplier and the slack of its limit; the multiplier itself where there is no limit.
    locally_optimal : bool
        Computed: whether all three are below 1e-6, so that the point is a first-order optimum of the program.
    directions : tuple of tuples of d float
        In a solution, the directions of wrench space whose support inequalities bind, scaled to ``phi_A = 1``.
    weights : tuple of float
        Their multipliers, at least zero, over the sum of all.
    reason : str
        In a solution, why the residuals are not small; empty where they are.
    """

    stationarity: NonNegative
    feasibility: NonNegative
    complementarity: NonNegative
    locally_optimal: bool = field(init=False)
    directions: tuple[Direction, ...] = field(default=(), metadata=LATER)
    weights: tuple[NonNegative, ...] = field(default=(), metadata=LATER)
    reason: str = field(default="", metadata=LEFT_OUT)

    def __post_init__(self) -> None:
        object.__setattr__(self, "locally_optimal", self.largest < SMALL)

    @classmethod
    def from_dict(cls, data: Json, name: str = "kkt") -> Self:
        """Return the residuals that ``to_dict`` wrote.

        Raises
        ------
        InputError
            Where the residuals contradict ``locally_optimal``.
        """
        kkt = super().from_dict(data, name)
        if kkt.locally_optimal != data["locally_optimal"]:
            expected = f"{kkt.locally_optimal}, by its residuals"
            raise InputError(f"{name}.locally_optimal", data["locally_optimal"], expected)
        return kkt

    @property
    def words(self) -> str:
        """Interpretation of the residuals as text, such as ``"locally optimal"``."""
        if self.is_small:
            return f"locally optimal (KKT residuals at most {self.largest:.0e})"
        return f"not shown to be locally optimal (KKT residuals up to {self.largest:.0e}: {self.why})"

    @property
    def why(self) -> str:
        """Reason why the residuals are not small, as text; empty if they are small."""
        if self.is_small:
            return ""
        return self.reason or "the last steps did not settle"

    @property
    def largest(self) -> float:
        """Largest of the three residuals."""
        return max(self.stationarity, self.feasibility, self.complementarity)

    @property
    def is_small(self) -> bool:
        """Whether all three residuals are below 1e-6; another name of ``locally_optimal``."""
        return self.locally_optimal


def kkt_residuals(
    gradient: FloatArray,
    jacobian: FloatArray,
    constraints: tuple[FloatArray, FloatArray, FloatArray],
    variables: tuple[FloatArray, FloatArray, FloatArray],
    multipliers: FloatArray,
    bound_multipliers: FloatArray,
) -> tuple[float, float, float]:
    """Return the stationarity, feasibility and complementarity residuals of ``maximise f`` at a point.

    Parameters
    ----------
    gradient : (n,) array
        Of f.
    jacobian : (m, n) array
        Of the constraints.
    constraints : tuple of (m,) arrays
        Values, lower and upper limits.
    variables : tuple of (n,) arrays
        Values, lower and upper bounds.
    multipliers, bound_multipliers : (m,) and (n,) arrays
        Positive at upper limits.
    """
    stationarity = gradient - multipliers @ jacobian - bound_multipliers
    violations, products = [0.0], [0.0]
    for (value, lower, upper), multiplier in ((constraints, multipliers), (variables, bound_multipliers)):
        violations.append(float(np.max(np.maximum(lower - value, value - upper), initial=0.0)))
        slack = np.abs(np.where(multiplier > 0.0, upper, lower) - value)
        products.append(float(np.max(np.abs(multiplier) * np.where(np.isfinite(slack), slack, 1.0), initial=0.0)))
    return float(np.max(np.abs(stationarity), initial=0.0)), max(violations), max(products)
