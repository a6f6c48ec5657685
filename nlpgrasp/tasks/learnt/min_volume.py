"""Minimum-volume enclosing ellipsoid with a certified gap.

The dual of ``min -ln det H`` subject to ``q_i^T H q_i <= n`` is to choose weights u >= 0 of sum one that maximise
``ln det sum_i u_i q_i q_i^T`` (D-optimal design; Khachiyan 1996, doi:10.1287/moor.21.2.307). Few points matter: a
small core set is solved by an interior-point method, and the farthest of all points join it until none is outside
(Sun and Freund 2004, doi:10.1287/opre.1040.0115). The first core set is that of Kumar and Yildirim (2005,
doi:10.1007/s10957-005-2653-6).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.common.validation import FloatArray

CORE, JOINING = 60, 60  # points of the first core set, and most added per round
ROUNDS, STEPS = 200, 100  # most rounds, most steps of the interior-point method
SHRINK, BACK_OFF = 0.15, 0.95  # factor of the complementarity per step; share of the way to the boundary
NEGLIGIBLE = 1e-9  # weight relative to the largest that counts as zero
IDLE, PRUNED = 1e-5, 20  # relative weight below which points leave the core set; number of rounds that prune
ROUNDING = 1e-12  # relative tolerance of containment


@dataclass(frozen=True)
class MinVolume:
    """Minimum-volume ellipsoid ``{c + L u, |u| <= 1}`` around all points.

    Parameters
    ----------
    center : (d,) array
    axes : (d, d) array
        Orthogonal semi-axes, one per row.
    gap : float
        Certified: the volume is at most ``1 + gap`` times the minimum.
    """

    center: FloatArray
    axes: FloatArray
    gap: float


def min_volume_ellipsoid(
    points: FloatArray, gap: float, center: FloatArray | None = None, first: NDArray[np.intp] | None = None
) -> MinVolume:
    """Return the minimum-volume ellipsoid around points that span their space.

    Parameters
    ----------
    points : (m, d) array
        Well scaled: the caller normalises units.
    gap : float
        Relative excess of volume, the stopping tolerance.
    center : (d,) array, optional
        Fixed centre; free by default.
    first : (k,) array, optional
        Warm start: indices of points on or outside a previous ellipsoid.
    """
    d = points.shape[1]
    lifted = np.c_[points, np.ones(len(points))] if center is None else points - center
    n = lifted.shape[1]
    weights = _weights(lifted, 2.0 * gap / n * 0.9, first)
    if center is None:
        center = weights @ points
    away = points - center
    shape = (away * weights[:, None]).T @ away
    values, vectors = np.linalg.eigh(shape)
    local = (away @ vectors) / np.sqrt(values)
    # the radius sqrt(d) gives the weights' lower bound of the volume; the farthest point sets ours
    reach = float(np.max(np.einsum("ij,ij->i", local, local))) * (1.0 + ROUNDING)
    axes = np.sqrt(reach * values)[:, None] * vectors.T
    return MinVolume(np.asarray(center), axes[::-1], float((reach / d) ** (d / 2.0) - 1.0))


def levels(points: FloatArray, center: FloatArray, axes: FloatArray) -> FloatArray:
    """Return the levels (m,) of points (m, d) in an ellipsoid with d semi-axes: below 1 inside."""
    return np.asarray(np.linalg.norm(np.linalg.solve(axes.T, (points - center).T), axis=0))


def _weights(q: FloatArray, tolerance: float, begun: NDArray[np.intp] | None) -> FloatArray:
    """Return dual weights for points (m, n) with all ``q_i^T M^-1 q_i`` at most ``n (1 + tolerance)``."""
    n = q.shape[1]
    first = _independent(q)
    if begun is None:
        begun = np.argsort(-_sizes(q, np.asarray(np.linalg.pinv(q.T @ q / len(q)))))[:CORE]
    core = np.concatenate([first, np.setdiff1d(begun, first)])
    for done in range(ROUNDS):
        u = _best_weights(q[core], 0.3 * tolerance)
        far = _sizes(q, _inverse(q[core], u))
        if far.max() <= n * (1.0 + tolerance):
            break
        farthest = np.argpartition(-far, min(JOINING, len(far)) - 1)[:JOINING]
        fresh = np.setdiff1d(farthest[far[farthest] > n * (1.0 + 0.3 * tolerance)], core)
        core = np.concatenate([core[u > (IDLE * u.max() if done < PRUNED else 0.0)], fresh])
    result = np.zeros(len(q))
    result[core] = u
    return np.asarray(result / result.sum())


def _sizes(q: FloatArray, inner: FloatArray) -> FloatArray:
    """Return ``q_i^T inner q_i`` of points (m, n)."""
    return np.asarray(np.einsum("ij,ij->i", q @ inner, q))


def _independent(q: FloatArray) -> NDArray[np.intp]:
    """Return the indices of n linearly independent points, each the farthest from the span of the previous."""
    rest = q.copy()
    chosen = []
    for _ in range(q.shape[1]):
        chosen.append(int(np.argmax(np.einsum("ij,ij->i", rest, rest))))
        along = rest[chosen[-1]] / np.linalg.norm(rest[chosen[-1]])
        rest -= np.outer(rest @ along, along)
    return np.array(chosen)


def _best_weights(q: FloatArray, tolerance: float) -> FloatArray:
    """Return the optimal dual weights of few points by a primal-dual interior-point method.

    ``min -ln det sum u_i q_i q_i^T + n sum u_i`` over u >= 0 has the optimality conditions ``w_i(u) + s_i = n`` and
    ``u_i s_i = 0`` with ``w_i = q_i^T M^-1 q_i``, whose derivative is ``-(q_i^T M^-1 q_j)^2``.
    """
    m, n = q.shape
    u, slack = np.full(m, 1.0 / m), np.full(m, float(n))
    for _ in range(STEPS):
        cross = q @ _inverse(q, u) @ q.T
        w = np.diag(cross)
        if np.max(w) * u.sum() <= n * (1.0 + tolerance):
            break
        level = SHRINK * float(u @ slack) / m
        system = cross**2 + np.diag(slack / u)
        step = np.linalg.solve(system, w - n + level / u)
        dual = (level - slack * step) / u - slack
        reach = min(1.0, BACK_OFF / max(1e-300, float(np.max(-step / u)), float(np.max(-dual / slack))))
        u, slack = u + reach * step, slack + reach * dual
    u = np.where(u > NEGLIGIBLE * u.max(), u, 0.0)
    return np.asarray(u / u.sum())


def _inverse(q: FloatArray, u: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.inv((q * u[:, None]).T @ q))
