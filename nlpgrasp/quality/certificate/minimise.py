"""Local minimisers of ``phi_W / phi_A`` over directions: upper bounds and cutting planes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.quality import inverse_iteration
from nlpgrasp.quality.certificate.containment import Containment

REGULAR = 1e-6  # of the Hessian's trace without cones, where the contacts do nothing along a direction
DIFFERENCE, STATIONARY = 1e-6, 1e-11  # step of differences of gradients; gradient at which Newton's method ends
LEAST_CURVATURE, LONGEST = 1e-6, 0.3  # relative to the largest curvature; radians a step of Newton's method


def descend(problem: Containment, u: FloatArray, iterations: int = 30) -> tuple[FloatArray, FloatArray]:
    """Return directions and ratios after a monotone descent from each row of ``u``, all rows at once.

    A fixed step oscillates and overestimates the minimum by several percent (docs/certified_bounds.md): every
    row keeps its own step, longer after a success, shorter after a failure, and never goes uphill.

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
        Exact values of the ratio there: each is an upper bound on the measure.
    """
    u = u / np.linalg.norm(u, axis=1, keepdims=True)
    value, gradient = problem.ratio(u)
    step = np.full(len(u), 0.5)
    for _ in range(iterations):
        length = step / np.where(np.isfinite(value) & (value > 0.0), value, 1.0)
        trial = u - length[:, None] * gradient
        trial /= np.maximum(np.linalg.norm(trial, axis=1, keepdims=True), 1e-300)
        trial_value, trial_gradient = problem.ratio(trial)
        better = trial_value < value
        u = np.where(better[:, None], trial, u)
        gradient = np.where(better[:, None], trial_gradient, gradient)
        value = np.where(better, trial_value, value)
        step = np.where(better, 1.5 * step, 0.3 * step)
    return u, value


def iterate(problem: Containment, u: FloatArray, steps: int) -> tuple[FloatArray, FloatArray]:
    """Return directions and ratios after inverse iteration from each row of ``u``, for the L2 budget and any task.

    The support squared is piecewise quadratic, so that fewer steps than ``descend`` takes come nearer to the least
    ratio (``quality.inverse_iteration``). Arguments and values are those of ``descend``; a narrow dip may be missed
    where no start is near it.
    """
    regular = REGULAR * np.sum(problem.wrenches.G**2) * np.eye(problem.rank)

    def model(u: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        phi = problem.wrenches.support(u[0])[0]
        reach, wrench = problem.task.support(u[0])
        value = np.where(reach > 0.0, phi / np.where(reach > 0.0, reach, 1.0), np.inf)
        return value[None], wrench[None], (problem.wrenches.curvature(u[0]) + regular)[None]

    found, values = inverse_iteration.descend(model, u[None], steps)
    return found[0] / np.maximum(np.linalg.norm(found[0], axis=1, keepdims=True), 1e-300), values[0]


def newton(problem: Containment, u: FloatArray, steps: int) -> tuple[FloatArray, FloatArray]:
    """Return directions and ratios after damped Newton steps on the unit sphere, from near local minimisers.

    Where ``descend`` and ``iterate`` come near a minimiser in ten steps, these double the digits with each: minimisers
    are followed from one placement of the contacts to the next as exactly as their derivatives have to be.

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
        Nowhere above those of the starting directions.
    """
    u = u / np.linalg.norm(u, axis=1, keepdims=True)
    value, gradient = problem.ratio(u)
    damping = np.ones(len(u))
    for _ in range(steps):
        if not len(u) or np.max(np.linalg.norm(_tangential(gradient, u), axis=1)) <= STATIONARY:
            break
        trial = u + damping[:, None] * _newton_step(problem, u, gradient)
        trial /= np.linalg.norm(trial, axis=1, keepdims=True)
        found, slope = problem.ratio(trial)
        flatter = np.linalg.norm(_tangential(slope, trial), axis=1) < np.linalg.norm(_tangential(gradient, u), axis=1)
        better = (found < value) | (flatter & (found <= value * (1.0 + 1e-12)))
        u, gradient = (np.where(better[:, None], new, old) for new, old in ((trial, u), (slope, gradient)))
        value = np.where(better, found, value)
        damping = np.where(better, np.minimum(1.0, 4.0 * damping), 0.25 * damping)
    return u, value


def _newton_step(problem: Containment, u: FloatArray, gradient: FloatArray) -> FloatArray:
    """Return tangential steps (m, r) to where the quadratic models of the ratio are least, no curvature negative."""
    axes, values = principal_curvatures(problem, u, gradient)
    step = -np.einsum("mar,ma->mr", axes, np.einsum("mar,mr->ma", axes, gradient) / values)
    length = np.linalg.norm(step, axis=1, keepdims=True)
    return np.asarray(step * np.minimum(1.0, LONGEST / np.maximum(length, 1e-300)))


def principal_curvatures(problem: Containment, u: FloatArray, gradient: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the ratio's curvature on the unit sphere at directions (m, r) with these gradients (m, r).

    Returns
    -------
    axes : (m, r - 1, r) array
        Unit tangents, at right angles to each other.
    values : (m, r - 1) array
        Sizes of the curvature along these, none next to nothing.
    """
    m, r = u.shape
    basis = np.linalg.svd(u[:, None, :])[2][:, 1:, :]  # of the tangent spaces, (m, r - 1, r)
    around = [problem.ratio((u[:, None, :] + h * basis).reshape(-1, r))[1] for h in (DIFFERENCE, -DIFFERENCE)]
    change = ((around[0] - around[1]) / (2.0 * DIFFERENCE)).reshape(m, r - 1, r)
    curvature = np.einsum("mar,mbr->mab", change, basis)
    curvature = 0.5 * (curvature + curvature.transpose(0, 2, 1))
    curvature -= np.sum(gradient * u, axis=1)[:, None, None] * np.eye(r - 1)
    values, vectors = np.linalg.eigh(np.where(np.isfinite(curvature), curvature, 0.0))
    values = np.maximum(np.abs(values), LEAST_CURVATURE * np.max(np.abs(values), axis=1, initial=1e-300, keepdims=True))
    return np.einsum("mab,mar->mbr", vectors, basis), values


def _tangential(gradient: FloatArray, u: FloatArray) -> FloatArray:
    """Return gradients (m, r) without their parts along the unit vectors u."""
    return np.asarray(gradient - np.sum(gradient * u, axis=1, keepdims=True) * u)


def separated(u: FloatArray, order: NDArray[np.intp], cosine: float, most: int) -> list[int]:
    """Return indices of at most ``most`` directions, best first, no two closer than ``cosine``."""
    ordered = u[order]
    near = ordered @ ordered.T >= cosine
    chosen: list[int] = []
    taken = np.zeros(len(ordered), dtype=bool)
    for i in range(len(ordered)):
        if len(chosen) >= most:
            break
        if not taken[i]:
            chosen.append(int(order[i]))
            taken |= near[i]
    return chosen


def random_directions(count: int, dimension: int, rng: np.random.Generator) -> FloatArray:
    """Return random unit vectors, (count, dimension)."""
    u = rng.standard_normal((count, dimension))
    return np.asarray(u / np.linalg.norm(u, axis=1, keepdims=True))
