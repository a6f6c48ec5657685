"""The shortest step that keeps linearised rows: a small quadratic program, by Clarabel."""

from __future__ import annotations

from dataclasses import dataclass

import clarabel
import numpy as np
from scipy import sparse

from nlpgrasp.common.conic import quiet_settings
from nlpgrasp.common.validation import FloatArray

TOLERANCE = 1e-9


@dataclass(frozen=True)
class Linearised:
    """Rows ``lower <= values + jacobian d <= upper`` of a step d, and its bounds.

    Parameters
    ----------
    values : (m,) array
    jacobian : (m, n) sparse matrix
    lower, upper : (m,) array
        Limits of the rows; equal where the row is an equation.
    least, most : (n,) array
        Bounds of the step, zero between them.
    """

    values: FloatArray
    jacobian: sparse.csr_matrix
    lower: FloatArray
    upper: FloatArray
    least: FloatArray
    most: FloatArray

    @property
    def violations(self) -> FloatArray:
        """How far each row is beyond its limits without a step, at least zero."""
        return np.maximum(np.maximum(self.lower - self.values, self.values - self.upper), 0.0)


def step_bounds(
    z: FloatArray, bounds: tuple[FloatArray, FloatArray], longest: FloatArray | float
) -> tuple[FloatArray, FloatArray]:
    """Return least and most step from z within bounds of the variables and of the step's own length."""
    lower, upper = bounds
    least, most = np.maximum(lower - z, -longest), np.minimum(upper - z, longest)
    return np.minimum(least, 0.0), np.maximum(most, 0.0)  # z may be a little out of bounds


@dataclass(frozen=True)
class Step:
    """A step and what its rows cost.

    Parameters
    ----------
    d : (n,) array
    multipliers : (m,) array
        Of the rows: positive where the upper limit is active, negative where the lower one is.
    """

    d: FloatArray
    multipliers: FloatArray


def shortest_step(rows: Linearised, cost: FloatArray, damping: float) -> Step | None:
    """Return the d of least ``cost d + damping |d|^2 / 2``, or None where the linearised rows contradict.

    Rows that no step within the bounds can break are left out.
    """
    g, J = rows.values, rows.jacobian
    reach = np.asarray(abs(J) @ np.maximum(-rows.least, rows.most)).ravel()
    equal = rows.lower == rows.upper
    below, above = ~equal & (g - reach < rows.lower), ~equal & (g + reach > rows.upper)
    n = J.shape[1]
    identity = sparse.identity(n, format="csr")
    A = sparse.vstack([J[equal], -J[below], J[above], identity, -identity], format="csc")
    parts = [(rows.lower - g)[equal], (g - rows.lower)[below], (rows.upper - g)[above], rows.most, -rows.least]
    b = np.concatenate(parts)
    equations = int(equal.sum())
    cones = [clarabel.ZeroConeT(equations), clarabel.NonnegativeConeT(len(b) - equations)]
    P = sparse.csc_matrix(sparse.identity(n) * damping)
    found = clarabel.DefaultSolver(P, cost, A, b, cones, quiet_settings(TOLERANCE)).solve()
    if "Solved" not in str(found.status):
        return None
    duals = np.split(np.array(found.z), np.cumsum([equations, int(below.sum()), int(above.sum())]))
    multipliers = np.zeros(len(g))
    multipliers[equal] = duals[0]
    multipliers[below] -= duals[1]
    multipliers[above] += duals[2]
    return Step(np.array(found.x), multipliers)
