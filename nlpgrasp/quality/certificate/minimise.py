"""Local minimisers of ``phi_W / phi_A`` over directions: upper bounds and cutting planes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.quality import inverse_iteration
from nlpgrasp.quality.certificate.containment import Containment

REGULAR = 1e-6  # of the Hessian's trace without cones, where the contacts do nothing along a direction


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
