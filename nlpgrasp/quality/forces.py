"""Least finger forces for many wrenches at once (theory, Section 5).

``min ||x||^2 / 2  s.t.  G x = w, x in K`` has the dual ``max_y <w, y> - ||P_K(G^T y)||^2 / 2`` with d unknowns
whatever the number of contacts; the primal is ``x = P_K(G^T y)``. The dual is concave, C^1 and piecewise
smooth: a semismooth Newton method with a line search solves it to rounding in some ten steps.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlpgrasp.grasp import Grasp
from nlpgrasp.quality.wrench_set import WrenchSet
from nlpgrasp.validation import FloatArray, array

TOLERANCE = 1e-10
STEPS = 60
DIFFERENCE = 1e-7


@dataclass(frozen=True)
class FingerForces:
    """Least forces that produce given wrenches.

    Parameters
    ----------
    forces : (m, n) array
        Force components in the contact frames, normal first; the nearest attempt where infeasible.
    feasible : (m,) bool array
        Whether the contacts can produce the wrench.
    residual : (m,) array
        ``||G x - w||`` relative to ``max(||w||, 1e-300)``, torques over the grasp's own length scale.
    """

    forces: FloatArray
    feasible: np.ndarray[tuple[int, ...], np.dtype[np.bool_]]
    residual: FloatArray


def least_forces(grasp: Grasp, wrenches: FloatArray) -> FingerForces:
    """Return the forces of least L2 norm that produce each wrench.

    Parameters
    ----------
    grasp : Grasp
    wrenches : (m, d) array
        About the grasp's torque origin.
    """
    w = array("wrenches", wrenches, (None, grasp.dimension))
    scale = np.sqrt(np.maximum(np.sum(grasp.G**2, axis=1), 1e-300))
    wrench_set = WrenchSet.of(grasp).transformed(np.diag(1.0 / scale))
    target = w / scale
    size = np.asarray(np.maximum(np.linalg.norm(target, axis=1), 1e-300))
    unit = target / size[:, None]
    x, residual = _newton(wrench_set, unit)
    return FingerForces(x * size[:, None], residual <= 1e-7, residual)


def _newton(wrench_set: WrenchSet, w: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Solve the dual for unit wrenches (m, d): forces (m, n) and residuals (m,)."""
    G = wrench_set.G
    d = G.shape[0]
    y: FloatArray = np.asarray(np.linalg.lstsq(G @ G.T + 1e-9 * np.eye(d), w.T, rcond=None)[0].T, dtype=np.float64)
    x = wrench_set.project(y @ G)
    value = _dual(w, y, x)
    for _ in range(STEPS):
        gradient = w - x @ G.T
        if np.max(np.linalg.norm(gradient, axis=1)) <= TOLERANCE:
            break
        matrix: FloatArray = _hessian(wrench_set, y) + _regular(gradient, d)
        step = np.linalg.solve(matrix, gradient[:, :, None])[:, :, 0]
        slope = np.sum(gradient * step, axis=1)
        length = np.ones(len(w))
        for _ in range(30):
            trial = y + length[:, None] * step
            trial_x = wrench_set.project(trial @ G)
            trial_value = _dual(w, trial, trial_x)
            short = trial_value < value + 1e-4 * length * slope - 1e-15 * np.abs(value)
            if not short.any():
                break
            length = np.where(short, 0.5 * length, length)
        better = trial_value >= value
        y = np.where(better[:, None], trial, y)
        x = np.where(better[:, None], trial_x, x)
        value = np.where(better, trial_value, value)
    return x, np.linalg.norm(w - x @ G.T, axis=1)


def _dual(w: FloatArray, y: FloatArray, x: FloatArray) -> FloatArray:
    return np.asarray(np.sum(w * y, axis=1) - 0.5 * np.sum(x * x, axis=1))


def _regular(gradient: FloatArray, d: int) -> FloatArray:
    """Return a multiple of the identity that vanishes with the gradient, (m, d, d)."""
    return np.asarray(
        (1e-3 * np.minimum(1.0, np.linalg.norm(gradient, axis=1)) ** 2 + 1e-14)[:, None, None] * np.eye(d)
    )


def _hessian(wrench_set: WrenchSet, y: FloatArray) -> FloatArray:
    """Return ``G P_K'(G^T y) G^T`` by central differences of the projection, column by column (m, d, d)."""
    G = wrench_set.G
    columns = []
    size = DIFFERENCE * np.maximum(np.linalg.norm(y, axis=1, keepdims=True), 1e-12)
    for row in G:
        up = wrench_set.project((y @ G) + size * row)
        down = wrench_set.project((y @ G) - size * row)
        columns.append(((up - down) / (2.0 * size)) @ G.T)
    result = np.stack(columns, axis=2)
    return np.asarray(0.5 * (result + result.transpose(0, 2, 1)))
