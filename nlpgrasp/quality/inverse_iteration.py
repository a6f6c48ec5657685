"""Batched inverse iteration for the weakest directions of grasps, with piecewise quadratic squared supports."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from nlpgrasp.common.validation import FloatArray

Model = Callable[[FloatArray], tuple[FloatArray, FloatArray, FloatArray]]


def descend(model: Model, u: FloatArray, steps: int) -> tuple[FloatArray, FloatArray]:
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
        found, found_wrench, found_H = model(trial)
        better = found < value
        u, wrench = (np.where(better[..., None], new, old) for new, old in ((trial, u), (found_wrench, wrench)))
        H = np.where(better[..., None, None], found_H, H)
        value = np.where(better, found, value)
        step = np.where(better, np.minimum(1.0, 2.0 * step), 0.3 * step)
    return u, value
