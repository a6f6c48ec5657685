"""Batched nonnegative quadratic programs, by an active-set method."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts.cones.cholesky import solve_matrices

SETS = 4  # active sets tried per problem


def least_nonnegative(
    matrix: FloatArray, right: FloatArray, active: NDArray[np.bool_], least: FloatArray, shift: float
) -> FloatArray:
    """Minimise ``l^T M l / 2 - right^T l`` over ``l >= 0`` for m small problems, from guessed active sets.

    Parameters
    ----------
    matrix : (N, N, m) array
        Symmetric, positive semidefinite.
    right : (N, m) array
    active : (N, m) array of bool
        Guess of the nonzero l.
    least : (m,) array
        Tolerance of the gradient at l = 0.
    shift : float
        Added to the diagonal of M, in case it is singular.

    Returns
    -------
    (N, m) array
        Result of the last active set tried: nearly always the minimiser.
    """
    result = _restricted(matrix, right, active, shift)
    lam, going = result, np.arange(right.shape[1])
    for _ in range(SETS - 1):
        pays = right - np.einsum("ijm,jm->im", matrix, lam) > least
        chosen = np.where(active, lam > 0.0, pays)
        wrong = np.flatnonzero((chosen != active).any(axis=0))
        if not wrong.size:
            break
        going, active, least = going[wrong], chosen[:, wrong], least[wrong]
        matrix, right = matrix[:, :, wrong], right[:, wrong]
        lam = _restricted(matrix, right, active, shift)
        result[:, going] = lam
    return np.maximum(result, 0.0)


def _restricted(matrix: FloatArray, right: FloatArray, active: NDArray[np.bool_], shift: float) -> FloatArray:
    """Return the minimisers (N, m) with all inactive l fixed at zero."""
    both = matrix * (active[:, None] & active)
    for i, one in enumerate(active):
        both[i, i] += np.where(one, 0.0, 1.0)
    return solve_matrices(both, shift, np.where(active, right, 0.0))
