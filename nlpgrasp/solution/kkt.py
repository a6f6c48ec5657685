"""First-order optimality (KKT) residuals of a solved program, in the solver's scaled units."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlpgrasp.common.validation import FloatArray

SMALL = 1e-6  # scaled: residuals below are those of a local optimum


@dataclass(frozen=True)
class KKT:
    """Residuals of the Karush-Kuhn-Tucker conditions at a point with its multipliers.

    All three are scaled: variables over their typical sizes, constraints over theirs, the objective over its value.

    Parameters
    ----------
    stationarity : float
        Largest entry of the Lagrangian's gradient.
    feasibility : float
        Largest violation of a constraint or bound.
    complementarity : float
        Largest product of a multiplier and the distance from its limit; where there is no limit, the multiplier.
    """

    stationarity: float
    feasibility: float
    complementarity: float

    @property
    def largest(self) -> float:
        """The largest of the three residuals."""
        return max(self.stationarity, self.feasibility, self.complementarity)

    @property
    def is_small(self) -> bool:
        """Whether all residuals are below 1e-6: the point is a first-order optimum of the program."""
        return self.largest < SMALL


def kkt_residuals(
    gradient: FloatArray,
    jacobian: FloatArray,
    constraints: tuple[FloatArray, FloatArray, FloatArray],
    variables: tuple[FloatArray, FloatArray, FloatArray],
    multipliers: FloatArray,
    bound_multipliers: FloatArray,
) -> tuple[float, float, float]:
    """Return stationarity, feasibility and complementarity at a point of ``maximise f``.

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
    for (value, lower, upper), price in ((constraints, multipliers), (variables, bound_multipliers)):
        violations.append(float(np.max(np.maximum(lower - value, value - upper), initial=0.0)))
        apart = np.abs(np.where(price > 0.0, upper, lower) - value)
        products.append(float(np.max(np.abs(price) * np.where(np.isfinite(apart), apart, 1.0), initial=0.0)))
    return float(np.max(np.abs(stationarity), initial=0.0)), max(violations), max(products)
