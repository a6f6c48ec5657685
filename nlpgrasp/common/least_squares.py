"""Nonnegative least squares."""

from __future__ import annotations

import numpy as np
from scipy.optimize import lsq_linear, nnls

from nlpgrasp.common.validation import FloatArray


def nonnegative_least_squares(A: FloatArray, b: FloatArray) -> tuple[FloatArray, float]:
    """Return x >= 0 (n,) with the least ``|A x - b|``, and that distance, for A (m, n) and b (m,)."""
    try:
        x, distance = nnls(A, b, maxiter=50 * A.shape[1])
        return np.asarray(x), float(distance)
    except RuntimeError:  # its active set goes round in circles
        x = np.asarray(lsq_linear(A, b, (0.0, np.inf), tol=1e-14, max_iter=50 * A.shape[1]).x)
        return x, float(np.linalg.norm(A @ x - b))
