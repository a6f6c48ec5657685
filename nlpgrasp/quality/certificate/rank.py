"""Numerical rank with a common tolerance."""

from __future__ import annotations

import numpy as np

from nlpgrasp.common.validation import FloatArray

RANK_TOLERANCE = 1e-10  # of the largest singular value


def numerical_rank(values: FloatArray) -> int:
    """Return the number of singular values that count as nonzero."""
    return int(np.sum(values > RANK_TOLERANCE * max(float(np.max(values, initial=0.0)), 1e-300)))


def equilibrated(rows: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return wrenches (rows) with equilibrated columns, and the column norms (d,) (1 for zero columns).

    Forces and torques have different units; the rank must not depend on them.
    """
    scale = np.linalg.norm(rows, axis=0)
    scale = np.where(scale > 0.0, scale, 1.0)
    return rows / scale, scale


def wrench_rank(rows: FloatArray) -> int:
    """Return the dimension of the span of wrenches (rows), independent of units."""
    return numerical_rank(np.asarray(np.linalg.svd(equilibrated(rows)[0], compute_uv=False), dtype=np.float64))
