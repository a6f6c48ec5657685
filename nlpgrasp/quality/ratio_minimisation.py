"""Local minimisation of the support ratio ``phi_W / phi_A`` over directions: gradients, inverse iteration, Newton."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from nlpgrasp.common.validation import FloatArray, IntArray
from nlpgrasp.quality.containment import Containment

STATIONARY = 1e-11  # gradient tolerance of Newton's method
LEAST_CURVATURE, LONGEST = 1e-6, 0.3  # relative lower bound of curvatures; rad, longest Newton step


Model = Callable[[FloatArray], tuple[FloatArray, FloatArray, FloatArray]]


def regularisation(G: FloatArray, bilateral: float = 1e-7, least: float = 1e-14) -> FloatArray:
    """Return matrices (..., d, d) that make the Hessian of ``phi_G^2 / 2`` regular, for grasp maps (..., d, n).

    They are a small share of ``G G^T``, which is the Hessian with bilateral contacts: in any units and coordinates the
    descents are the same. A share of the identity would hide directions along which fingers hardly push.
    """
    moment = G @ np.swapaxes(G, -1, -2)
    trace = np.trace(moment, axis1=-2, axis2=-1)[..., None, None]
    return np.asarray(bilateral * moment + least * trace * np.eye(G.shape[-2]))


def minimise_by_inverse_iteration(model: Model, u: FloatArray, steps: int) -> tuple[FloatArray, FloatArray]:
    """Minimise ``phi_G / phi_A`` by damped inverse iteration from directions of each grasp, (b, m, d).

    With ``phi_A(u) = <w, u>`` for the task's maximiser w, the minimiser of ``phi_G(u) / <w, u>`` is near ``H^-1 w``
    with the Hessian H of ``phi_G^2 / 2``.

    Parameters
    ----------
    model : callable
        Maps directions (b, m, d) to ratios (b, m), the task's maximisers (b, m, d) and H (b, m, d, d).
    u : (b, m, d) array
    steps : int

    Returns
    -------
    directions : (b, m, d) array
    ratios : (b, m) array
        Not above those of the starting directions.
    """
    value, wrench, H = model(u)
    step = np.ones(value.shape)
    for _ in range(steps):
        target = np.linalg.solve(H, wrench[..., None])[..., 0]
        work = np.sum(target * wrench, axis=2)
        target /= np.where(work > 0.0, work, 1.0)[..., None]
        trial = u + step[..., None] * (np.sum(u * wrench, axis=2)[..., None] * target - u)
        trial_value, trial_wrench, trial_H = model(trial)
        is_better = trial_value < value
        u, wrench = (np.where(is_better[..., None], new, old) for new, old in ((trial, u), (trial_wrench, wrench)))
        H = np.where(is_better[..., None, None], trial_H, H)
        value = np.where(is_better, trial_value, value)
        step = np.where(is_better, np.minimum(1.0, 2.0 * step), 0.3 * step)
    return u, value


def descend(problem: Containment, u: FloatArray, iterations: int = 30) -> tuple[FloatArray, FloatArray]:
    """Minimise the support ratio by monotone gradient descent from each direction in ``u``.

    A fixed step oscillates and overestimates the minimum by several percent (docs/certified_bounds.md), so each row has
    an adaptive step, longer after a success and shorter after a failure, and never ascends.

    Parameters
    ----------
    problem : Containment
    u : (m, r) array
        Non-zero starting directions.
    iterations : int

    Returns
    -------
    directions : (m, r) array
        Unit vectors.
    ratios : (m,) array
        Exact ratios there, each an upper bound on the measure.
    """
    u = u / np.linalg.norm(u, axis=1, keepdims=True)
    value, gradient = problem.ratio(u)
    step = np.full(len(u), 0.5)
    for _ in range(iterations):
        length = step / np.where(np.isfinite(value) & (value > 0.0), value, 1.0)
        trial = u - length[:, None] * gradient
        trial /= np.maximum(np.linalg.norm(trial, axis=1, keepdims=True), 1e-300)
        trial_value, trial_gradient = problem.ratio(trial)
        is_better = trial_value < value
        u = np.where(is_better[:, None], trial, u)
        gradient = np.where(is_better[:, None], trial_gradient, gradient)
        value = np.where(is_better, trial_value, value)
        step = np.where(is_better, 1.5 * step, 0.3 * step)
    return u, value


def minimise_l2_ratio(problem: Containment, u: FloatArray, steps: int) -> tuple[FloatArray, FloatArray]:
    """Minimise the support ratio under the L2 budget by inverse iteration from each direction in ``u``.

    The squared support is piecewise quadratic, so this converges in fewer steps than ``descend``
    (``minimise_by_inverse_iteration``). Arguments and results are those of ``descend``; a narrow minimum far from all
    starts may be missed.
    """
    regular = regularisation(problem.wrenches.G)

    def model(u: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        phi = problem.wrenches.support(u[0])[0]
        reach, wrench = problem.task.support(u[0])
        value = np.where(reach > 0.0, phi / np.where(reach > 0.0, reach, 1.0), np.inf)
        return value[None], wrench[None], (problem.wrenches.curvature(u[0]) + regular)[None]

    directions, values = minimise_by_inverse_iteration(model, u[None], steps)
    return directions[0] / np.maximum(np.linalg.norm(directions[0], axis=1, keepdims=True), 1e-300), values[0]


def refine_by_newton(problem: Containment, u: FloatArray, steps: int) -> tuple[FloatArray, FloatArray]:
    """Refine nearby local minimisers of the support ratio by damped Newton steps on the unit sphere.

    Convergence is quadratic, so minimisers can be tracked from one set of contacts to the next as accurately as their
    derivatives require.

    Parameters
    ----------
    problem : Containment
    u : (m, r) array
        Non-zero starting directions.
    steps : int
        At most.

    Returns
    -------
    directions : (m, r) array
        Unit vectors.
    ratios : (m,) array
        Not above those of the starting directions, up to rounding.
    """
    u = u / np.linalg.norm(u, axis=1, keepdims=True)
    value, gradient = problem.ratio(u)
    step, damping = _newton_step(problem, u, gradient), np.ones(len(u))
    for _ in range(steps):
        moving = np.flatnonzero(_slope(gradient, u) > STATIONARY)
        if not len(moving):
            break
        old, old_value, old_gradient = u[moving], value[moving], gradient[moving]
        trial = old + damping[moving, None] * step[moving]
        trial /= np.linalg.norm(trial, axis=1, keepdims=True)
        trial_value, trial_gradient = problem.ratio(trial)
        is_flatter = _slope(trial_gradient, trial) < _slope(old_gradient, old)
        is_better = (trial_value < old_value) | (is_flatter & (trial_value <= old_value * (1.0 + 1e-12)))
        better = moving[is_better]
        u[better], value[better], gradient[better] = trial[is_better], trial_value[is_better], trial_gradient[is_better]
        step[better] = _newton_step(problem, trial, trial_gradient)[is_better]
        damping[moving] = np.where(is_better, np.minimum(1.0, 4.0 * damping[moving]), 0.25 * damping[moving])
    return u, value


def _newton_step(problem: Containment, u: FloatArray, gradient: FloatArray) -> FloatArray:
    """Return tangential Newton steps (m, r) of the ratio, with absolute curvatures and limited length."""
    axes, values = principal_curvatures(problem, u, gradient)
    step = -np.einsum("mar,ma->mr", axes, np.einsum("mar,mr->ma", axes, gradient) / values)
    length = np.linalg.norm(step, axis=1, keepdims=True)
    return np.asarray(step * np.minimum(1.0, LONGEST / np.maximum(length, 1e-300)))


def principal_curvatures(problem: Containment, u: FloatArray, gradient: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the principal axes and the absolute principal curvatures of the ratio on the unit sphere.

    Curvatures are bounded away from zero.

    Parameters
    ----------
    problem : Containment
    u, gradient : (m, r) array
        Unit directions, and the ratio's gradients there.

    Returns
    -------
    axes : (m, r - 1, r) array
        Orthonormal tangents.
    values : (m, r - 1) array
        Curvatures along these.
    """
    r = u.shape[1]
    basis = np.linalg.svd(u[:, None, :])[2][:, 1:, :]  # of the tangent spaces, (m, r - 1, r)
    curvature = basis @ problem.hessian(u) @ basis.transpose(0, 2, 1)
    # of the sphere itself: along a great circle of unit speed u'' = -u, which adds -<gradient, u>
    curvature -= np.sum(gradient * u, axis=1)[:, None, None] * np.eye(r - 1)
    values, vectors = np.linalg.eigh(np.where(np.isfinite(curvature), curvature, 0.0))
    values = np.maximum(np.abs(values), LEAST_CURVATURE * np.max(np.abs(values), axis=1, initial=1e-300, keepdims=True))
    return np.einsum("mab,mar->mbr", vectors, basis), values


def _slope(gradient: FloatArray, u: FloatArray) -> FloatArray:
    """Return the norms (m,) of the tangential parts of gradients (m, r) at unit vectors u (m, r)."""
    return np.asarray(np.linalg.norm(gradient - np.sum(gradient * u, axis=1, keepdims=True) * u, axis=1))


def select_separated(u: FloatArray, order: IntArray, cosine: float, limit: int) -> list[int]:
    """Return indices of at most ``limit`` directions, best first, with pairwise cosines below ``cosine``."""
    ordered = u[order]
    is_near = ordered @ ordered.T >= cosine
    chosen: list[int] = []
    is_covered = np.zeros(len(ordered), dtype=bool)
    for i in range(len(ordered)):
        if len(chosen) >= limit:
            break
        if not is_covered[i]:
            chosen.append(int(order[i]))
            is_covered |= is_near[i]
    return chosen


def random_directions(count: int, dimension: int, rng: np.random.Generator) -> FloatArray:
    """Return random unit vectors, (count, dimension)."""
    u = rng.standard_normal((count, dimension))
    return np.asarray(u / np.linalg.norm(u, axis=1, keepdims=True))
