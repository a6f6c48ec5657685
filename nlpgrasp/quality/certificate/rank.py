"""Numerical rank, the same everywhere in this layer."""

from __future__ import annotations

import numpy as np

from nlpgrasp.common.validation import FloatArray

RANK_TOLERANCE = 1e-10  # of the largest singular value


def numerical_rank(values: FloatArray) -> int:
    """Return how many singular values count as more than zero."""
    return int(np.sum(values > RANK_TOLERANCE * max(float(np.max(values, initial=0.0)), 1e-300)))


def equilibrated(rows: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return wrenches, one a row, with every coordinate over its own length, and the lengths (1 for zero), (d,).

    Forces and torques have different units; the rank must not depend on them.
    """
    scale = np.linalg.norm(rows, axis=0)
    scale = np.where(scale > 0.0, scale, 1.0)
    return rows / scale, scale


def wrench_rank(rows: FloatArray) -> int:
    """Return the dimension that wrenches span, one a row, whatever their units."""
    return numerical_rank(np.asarray(np.linalg.svd(equilibrated(rows)[0], compute_uv=False), dtype=np.float64))
