"""The shortest step that keeps linearised rows: a small quadratic program, by Clarabel."""

from __future__ import annotations

from dataclasses import dataclass

import clarabel
import numpy as np
from scipy import sparse

from nlpgrasp.conic_solver import quiet_settings
from nlpgrasp.validation import FloatArray

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


def shortest_step(rows: Linearised, cost: FloatArray, damping: float) -> FloatArray | None:
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
    return np.array(found.x) if "Solved" in str(found.status) else None
