"""Inverse iteration: the weakest directions of many grasps at once, for a piecewise quadratic support and any task."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from nlpgrasp.common.validation import FloatArray

Model = Callable[[FloatArray], tuple[FloatArray, FloatArray, FloatArray]]


def descend(model: Model, u: FloatArray, steps: int) -> tuple[FloatArray, FloatArray]:
    """Follow ``phi_G / phi_A`` downhill from directions of each grasp, (b, m, d).

    With ``phi_A(u) = <w, u>`` for the task's wrench w, the least ``phi_G(u) / <w, u>`` over u is near ``H^-1 w`` with
    the Hessian H of ``phi_G^2 / 2``.

    Parameters
    ----------
    model : callable
        Directions (b, m, d) to the ratios (b, m), the task's wrenches there (b, m, d) and H (b, m, d, d).
    u : (b, m, d) array
    steps : int

    Returns
    -------
    directions : (b, m, d) array
    ratios : (b, m) array
        Nowhere more than where the descents began.
    """
    value, wrench, H = model(u)
    step = np.ones(value.shape)
    for _ in range(steps):
        target = np.linalg.solve(H, wrench[..., None])[..., 0]
        work = np.sum(target * wrench, axis=2)
        target /= np.where(work > 0.0, work, 1.0)[..., None]
        trial = u + step[..., None] * (np.sum(u * wrench, axis=2)[..., None] * target - u)
        found, found_wrench, found_H = model(trial)
        better = found < value
        u, wrench = (np.where(better[..., None], new, old) for new, old in ((trial, u), (found_wrench, wrench)))
        H = np.where(better[..., None, None], found_H, H)
        value = np.where(better, found, value)
        step = np.where(better, np.minimum(1.0, 2.0 * step), 0.3 * step)
    return u, value
