"""Nonnegative least squares: the conditions of the optimum, also where scipy's active set goes round in circles."""

import numpy as np
import pytest

from nlpgrasp.common import least_squares
from nlpgrasp.common.least_squares import nonnegative_least_squares


@pytest.mark.parametrize("cycles", [False, True])
def test_the_solution_meets_the_conditions_of_the_optimum(cycles, rng, monkeypatch):
    if cycles:

        def never_ends(A, b, maxiter):
            raise RuntimeError("Maximum number of iterations reached.")

        monkeypatch.setattr(least_squares, "nnls", never_ends)
    A, b = rng.standard_normal((12, 20)), rng.standard_normal(12)
    x, distance = nonnegative_least_squares(A, b)
    slopes = A.T @ (A @ x - b)
    assert np.all(x >= 0.0)
    assert np.min(slopes) > -1e-6
    assert np.max(np.abs(x * slopes)) < 1e-6
    assert distance == pytest.approx(np.linalg.norm(A @ x - b), abs=1e-9)
