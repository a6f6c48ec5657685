"""Which wrenches the contacts cannot produce at all, and a direction that proves it."""

from __future__ import annotations

import numpy as np
from scipy.optimize import nnls

from nlpgrasp.budgets.base import ranges
from nlpgrasp.quality.wrench_set import WrenchSet
from nlpgrasp.validation import FloatArray

ZERO_SUPPORT = 1e-9


def separating_direction(wrenches: WrenchSet, rounds: int = 100) -> FloatArray | None:
    """Return a unit direction y along which no force in K does positive work, or None when none was found.

    Take a force x0 inside the cones and the wrench ``w = -G x0``. If some other force in K produces w, the
    two together produce no wrench from inside the cones, and with G of full rank the grasp is force-closed.
    Otherwise a direction that separates w from ``G K`` is one: ``G^T y`` lies in the polar of K.

    Parameters
    ----------
    wrenches : WrenchSet
        Full row rank.
    rounds : int
        Most rays added a contact.

    Returns
    -------
    (d,) array or None
        The caller checks ``phi(y)`` itself: this function is a search, not the proof.
    """
    pressing = np.zeros(wrenches.G.shape[1])
    pressing[[r.start for r in ranges(wrenches.contacts, wrenches.space)]] = 1.0
    target = -wrenches.G @ pressing
    if np.linalg.norm(target) <= ZERO_SUPPORT * np.linalg.norm(wrenches.G, 2):
        return None
    return unreachable(wrenches, target, rounds)


def unreachable(wrenches: WrenchSet, target: FloatArray, rounds: int = 100) -> FloatArray | None:
    """Return a unit direction that separates a wrench from the cone ``G K``, or None when it is in the cone.

    The nearest point of ``G K`` is found by non-negative least squares over a growing set of its rays; what is left
    of the wrench is orthogonal to that point and in the polar of the cone.
    """
    scale, size = float(np.linalg.norm(wrenches.G, 2)), float(np.linalg.norm(target))
    where = ranges(wrenches.contacts, wrenches.space)
    rays = [wrenches.G[:, r.start : r.start + 1] for r in where]
    y = target / size
    for _ in range(rounds):
        columns = np.concatenate(rays, axis=1)
        weights, distance = nnls(columns, target, maxiter=50 * columns.shape[1])
        if distance <= ZERO_SUPPORT * size:
            return None
        y = (target - columns @ weights) / distance
        force = wrenches.project((y @ wrenches.G)[None, :])[0]
        if np.linalg.norm(force) <= ZERO_SUPPORT * scale:
            return np.asarray(y)
        keep = weights > 0.0
        new = [wrenches.G[:, r] @ force[r] for r in where]
        grown = [w[:, None] / np.linalg.norm(w) for w in new if np.linalg.norm(w) > 1e-12 * scale]
        rays = [columns[:, keep], *grown]
    return np.asarray(y)
