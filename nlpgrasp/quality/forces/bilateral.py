"""Closed-form quality for bilateral contacts and centred task ellipsoids, by singular values (3.1-1a)."""

from __future__ import annotations

import numpy as np

from nlpgrasp.quality.bounds import Bounds
from nlpgrasp.quality.certificate.rank import numerical_rank
from nlpgrasp.quality.certificate.wrench_set import WrenchSet
from nlpgrasp.tasks import Task, TaskEllipsoid

ROUNDING = 1e-9  # relative guard against rounding


def bilateral_ellipsoid(wrenches: WrenchSet, task: Task) -> Bounds | None:
    """Return bounds on the least ``|G^T y| / |L^T y|`` if that is the quality, or None if it is not.

    With ``G = U S V^T`` and ``y = U S^-1 v`` it is one over the largest singular value of ``L^T U S^-1``; for a ball of
    wrenches the smallest singular value of G.
    """
    if not (wrenches.is_ellipsoid and isinstance(task, TaskEllipsoid)):
        return None
    rows = np.linalg.norm(wrenches.G, axis=1)
    if not task.is_centred or np.any(rows == 0.0):
        return None
    U, S, _ = np.linalg.svd(wrenches.G / rows[:, None])
    if numerical_rank(S) < len(U):
        return None
    _, values, right = np.linalg.svd((task.axes / rows) @ U / S)
    worst = (U @ (right[0] / S)) / rows
    guard = ROUNDING + 1e-14 * S[0] / S[-1]
    ratio = float(1.0 / values[0])
    return Bounds(float(ratio * (1.0 - guard)), float(ratio * (1.0 + guard)), worst / np.linalg.norm(worst))
