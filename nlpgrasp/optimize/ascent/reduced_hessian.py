"""Reduced Hessian of the Lagrangian with moving minimisers, as curvature for Newton steps.

A cut ``phi_G(y_j; p) >= beta`` touches ``psi_j(p) = min over y near y_j of phi_G(y; p) / phi_A(y)`` from above: the
two have the same gradient, but not the same curvature, and at most local optima the cuts alone curve the wrong way.
Derivatives of the reduced functions psi_j make Newton's method (local reduction of semi-infinite programs, Hettich and
Kortanek 1993, doi:10.1137/1035089). As g_y = 0 at a minimiser, the implicit function theorem gives their Hessian:
``g_zz - g_zy g_yy^-1 g_yz``.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.optimize.ascent.steps.linear import Linearisation
from nlpgrasp.optimize.ascent.weakest import in_coordinates
from nlpgrasp.quality.certificate.containment import conditioned
from nlpgrasp.quality.certificate.minimise import principal_curvatures
from nlpgrasp.quality.certificate.wrench_set import WrenchSet

STEP = 1e-5  # difference step, solver units or radians
ACTIVE = 1e-7  # multipliers below count as zero
INDEPENDENT = 1e-9  # relative singular value below which constraints are dependent
LEAST_REACH = 1e-300  # lower bound on the task's support, against division by zero
FLAT = 1e-12  # solver units: smaller curvature counts as zero
LEAST = 1e-4  # solver units, lower bound on curvature in the reduced space, which limits the step there


def reduced_hessian(
    here: Linearisation, cuts: FloatArray, minimisers: NDArray[np.bool_], multipliers: FloatArray
) -> FloatArray:
    """Return the reduced Hessian of ``-beta + multipliers g``, its negative part removed, (n, n), solver units.

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
    rows = here.rows()
    basis = _tangents(rows.jacobian[rows.lower == rows.upper], here.beta)
    slope = multipliers @ rows.jacobian
    around = [multipliers @ here.at(here.z + STEP * direction, cuts)[1] for direction in basis.T]
    second = np.array([(there - slope) @ basis / STEP for there in around]).reshape(basis.shape[1], -1)
    moving = np.flatnonzero(minimisers & (here.support(multipliers) > ACTIVE))
    second = 0.5 * (second + second.T) + _of_moving(here, cuts, moving, multipliers, basis)
    values, vectors = np.linalg.eigh(second)
    vectors = basis @ vectors
    return np.asarray((vectors * np.maximum(values, LEAST)) @ vectors.T)


def _of_moving(
    here: Linearisation, cuts: FloatArray, moving: NDArray[np.intp], multipliers: FloatArray, basis: FloatArray
) -> FloatArray:
    """Return the part ``-g_zy g_yy^-1 g_yz`` of the Hessian in a basis (n, s), summed over the moving minimisers."""
    size, task = basis.shape[1], here.bench.problem.task
    budget = here.bench.budget(here.placed_at(here.z))
    problem, _ = conditioned(WrenchSet.of(here.grasp_at(here.z), budget), task)
    if problem is None or not len(moving):
        return np.zeros((size, size))
    own = here.cut_rows[moving]

    def rows_at(y: FloatArray) -> tuple[FloatArray, FloatArray]:
        other = cuts.copy()
        other[moving] = y
        values, jacobian = here.at(here.z, other)
        return values[own], jacobian[own] @ basis

    u = in_coordinates(problem, cuts[moving])
    ratio, gradient = problem.ratio(u)
    axes, curvature = principal_curvatures(problem, u, gradient)
    values, slopes = rows_at(cuts[moving])
    rise = (rows_at((1.0 + STEP) * cuts[moving])[0] - values) / (STEP * ratio)  # of the row, over the ratio's
    tilted = [(u + STEP * axis) @ problem.matrix for axis in axes.transpose(1, 0, 2)]
    turned = [rows_at(y / np.maximum(task.support(y)[0], LEAST_REACH)[:, None])[1] for y in tilted]
    mixed = (np.array(turned) - slopes) / STEP  # g_yz, (r - 1, m, s)
    steep = rise * curvature.T  # nothing moves along where the row does not change
    weights = np.where(steep > FLAT, multipliers[own] / np.maximum(steep, FLAT), 0.0)
    return np.asarray(-np.einsum("amr,ams,am->rs", mixed, mixed, weights))


def _tangents(equations: FloatArray, beta: int) -> FloatArray:
    """Return an orthonormal basis (n, r) of the directions that preserve linearised equations and beta."""
    fixed = np.concatenate([equations, np.eye(equations.shape[1])[beta : beta + 1]])
    _, values, vectors = np.linalg.svd(fixed)
    return np.asarray(vectors[int(np.sum(values > INDEPENDENT * values[0])) :].T)
