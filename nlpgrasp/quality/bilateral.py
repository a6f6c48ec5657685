"""Bilateral contacts: the wrench set is an ellipsoid, and a centred one inside it an eigenvalue problem (3.1-1a)."""

from __future__ import annotations

import numpy as np
from scipy.linalg import eigh

from nlpgrasp.budgets import L2Budget
from nlpgrasp.contacts import BilateralContact
from nlpgrasp.quality.bounds import Bounds
from nlpgrasp.quality.containment import Containment
from nlpgrasp.tasks import TaskEllipsoid

ROUNDING = 1e-9


def bilateral_ellipsoid(problem: Containment) -> Bounds | None:
    """Return the least ``|G^T y| / |L^T y|`` where that is all there is to it, or None where it is not.

    It is ``1 / sqrt(lambda)`` with the largest lambda of ``L L^T y = lambda G G^T y``; for a ball of wrenches the
    smallest singular value of G.
    """
    wrenches, task = problem.wrenches, problem.task
    bilateral = all(isinstance(c, BilateralContact) for c in wrenches.contacts)
    if not (
        bilateral and isinstance(wrenches.budget, L2Budget) and isinstance(task, TaskEllipsoid) and task.is_centred
    ):
        return None
    values, vectors = eigh(task.axes.T @ task.axes, wrenches.G @ wrenches.G.T)
    ratio = float(1.0 / np.sqrt(values[-1]))
    return Bounds(ratio * (1.0 - ROUNDING), ratio * (1.0 + ROUNDING), vectors[:, -1])
