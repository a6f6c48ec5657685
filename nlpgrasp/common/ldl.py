"""Batched solution of small symmetric linear systems by LDL^T factorisation."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from nlpgrasp.common.validation import FloatArray

FEW = 48  # number of systems up to which LAPACK is faster


def solve_columns(entries: Mapping[tuple[int, int], FloatArray], shift: FloatArray, right: FloatArray) -> FloatArray:
    """Return the solutions of ``(H + shift I) s = right`` for m positive semidefinite matrices H.

    Every operation runs over all systems: with d at most 6, one LAPACK call per system costs mostly overhead.

    Parameters
    ----------
    entries : mapping of (a, b) with a <= b to (m,) array
        H's upper triangle.
    shift : (m,) array
        Greater than zero.
    right : (d, m) array

    Returns
    -------
    (d, m) array
        The solutions s, one per column.
    """
    d = len(right)
    L: dict[tuple[int, int], FloatArray] = {}  # the unit lower triangle of L D L^T, times D
    inverse: list[FloatArray] = []
    s = [row.copy() for row in right]
    for j in range(d):
        pivot = entries[j, j] + shift
        for k in range(j):
            pivot -= L[j, k] * L[j, k] * inverse[k]
        inverse.append(1.0 / np.maximum(pivot, shift))
        for i in range(j + 1, d):
            entry = entries[j, i].copy()
            for k in range(j):
                entry -= L[i, k] * (L[j, k] * inverse[k])
            L[i, j] = entry
        for k in range(j):
            s[j] -= L[j, k] * s[k]
        s[j] *= inverse[j]
    for j in reversed(range(d)):
        for i in range(j + 1, d):
            s[j] -= L[i, j] * inverse[j] * s[i]
    return np.array(s)


def solve_batch(entries: Mapping[tuple[int, int], FloatArray], shift: FloatArray, right: FloatArray) -> FloatArray:
    """Return the solutions of the systems of ``solve_columns``, computed by LAPACK where there are few systems.

    LAPACK is then faster, and rounds differently.
    """
    d, m = right.shape
    if m > FEW:
        return solve_columns(entries, shift, right)
    matrix = np.empty((m, d, d))
    for (a, b), entry in entries.items():
        matrix[:, a, b] = matrix[:, b, a] = entry
    matrix[:, range(d), range(d)] += shift[:, None]
    solved = _solve_by_lapack(matrix, right)
    return solve_columns(entries, shift, right) if solved is None else solved


def solve_matrices(matrix: FloatArray, shift: float, right: FloatArray) -> FloatArray:
    """Return the solutions as ``solve_batch`` does, for full matrices (d, d, m) with one common shift."""
    d, m = right.shape
    if m <= FEW:
        shifted = matrix.transpose(2, 0, 1).copy()
        shifted.reshape(m, d * d)[:, :: d + 1] += shift
        solved = _solve_by_lapack(shifted, right)
        if solved is not None:
            return solved
    entries = {(a, b): matrix[a, b] for a in range(d) for b in range(a, d)}
    return solve_columns(entries, np.full(m, shift), right)


def _solve_by_lapack(matrix: FloatArray, right: FloatArray) -> FloatArray | None:
    """Return the solutions (d, m) for matrices (m, d, d), or None if any matrix is singular."""
    try:
        return np.asarray(np.linalg.solve(matrix, right.T[..., None])[..., 0].T)
    except np.linalg.LinAlgError:
        return None
