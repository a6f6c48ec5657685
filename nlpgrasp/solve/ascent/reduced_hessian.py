"""Hessian of the Lagrangian on the constraints, with the weakest directions moving along: curvature for Newton steps.

A cut ``phi_G(y_j; p) >= beta`` touches ``psi_j(p) = min over y near y_j of phi_G(y; p) / phi_A(y)`` from above: the
two have the same gradient, but not the same curvature, and at most local optima the cuts alone curve the wrong way.
Derivatives of the reduced functions psi_j make Newton's method (local reduction of semi-infinite programs, Hettich and
Kortanek 1993, doi:10.1137/1035089): contacts move by a difference, the minimisers y_j follow, and so do the gradients.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.quality.certificate.wrench_set import WrenchSet
from nlpgrasp.solve.ascent.steps.linear import Linearisation
from nlpgrasp.solve.ascent.weakest import followed

STEP = 1e-5  # solver units, of the differences
ACTIVE = 1e-7  # a multiplier below is zero
INDEPENDENT = 1e-9  # relative: singular values of dependent rows
LEAST = 1e-4  # curvature, solver units, that directions of less are given: along these the step is a short one


def reduced_hessian(
    here: Linearisation, cuts: FloatArray, minimisers: NDArray[np.bool_], multipliers: FloatArray
) -> FloatArray:
    """Return the reduced Hessian of ``-beta + multipliers g``, its negative part left out, (n, n), solver units.

    Parameters
    ----------
    here : Linearisation
        The program linearised where contacts and hand are.
    cuts : (m, d) array
        Directions that it was linearised with.
    minimisers : (m,) array of bool
        Which of them are local minimisers of the support ratio there; others stay as they are.
    multipliers : (rows,) array
        Of all rows of ``Linearisation.rows``.
    """
    bench, rows = here.bench, here.rows()
    basis = _tangents(rows.jacobian[rows.lower == rows.upper], here.beta)
    slope = multipliers @ rows.jacobian
    moving = minimisers & (here.support(multipliers) > ACTIVE)
    second = np.zeros((basis.shape[1], basis.shape[1]))
    for i, direction in enumerate(basis.T):
        z, moved = here.z + STEP * direction, cuts.copy()
        budget = bench.budget(here.placed_at(z))
        moved[moving] = followed(WrenchSet.of(here.grasp_at(z), budget), bench.problem.task, cuts[moving])
        second[:, i] = basis.T @ (multipliers @ here.jacobian_at(z, moved) - slope) / STEP
    values, vectors = np.linalg.eigh(0.5 * (second + second.T))
    vectors = basis @ vectors
    return np.asarray((vectors * np.maximum(values, LEAST)) @ vectors.T)


def _tangents(equations: FloatArray, beta: int) -> FloatArray:
    """Return an orthonormal basis (n, r) of the directions that keep linearised equations and beta."""
    fixed = np.concatenate([equations, np.eye(equations.shape[1])[beta : beta + 1]])
    _, values, vectors = np.linalg.svd(fixed)
    return np.asarray(vectors[int(np.sum(values > INDEPENDENT * values[0])) :].T)
