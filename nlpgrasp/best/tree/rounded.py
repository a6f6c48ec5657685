"""Weights of mixtures as they are written."""

from __future__ import annotations

import numpy as np

from nlpgrasp.common.validation import FloatArray

DIGITS = 8  # of weights
LEAST = 1e-5  # weights below are left out


def rounded(weights: FloatArray) -> FloatArray:
    """Return a mixture (j,) as it is written: of few digits, without the weights that hardly count."""
    result = np.where(weights < LEAST, 0.0, np.round(weights, DIGITS))
    return np.asarray(np.round(result / np.sum(result), DIGITS)) if np.count_nonzero(result) == 1 else result
