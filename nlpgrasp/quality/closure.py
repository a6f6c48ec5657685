"""Which direction, if any, no force in the contacts' cones can work along."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from scipy.optimize import nnls

from nlpgrasp.quality.wrench_set import WrenchSet
from nlpgrasp.validation import FloatArray

ZERO_SUPPORT = 1e-9


def separating_direction(wrenches: WrenchSet, rounds: int = 100) -> FloatArray | None:
    """Return a unit direction y with ``phi(y | G(B n K)) = 0``, or None when none was found.

    Take a force x0 inside the cones and the wrench ``w = -G x0``. If some other force in K produces w, the
    two together produce no wrench from inside the cones, and with G of full rank the grasp is force-closed.
    Otherwise the part of w that the cone ``G K`` cannot reach separates it: ``G^T y`` lies in the polar of K.
    The nearest point of ``G K`` is found by non-negative least squares over a growing set of its rays.

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
    starts = np.cumsum([0] + [c.components(wrenches.space) for c in wrenches.contacts])
    pressing[starts[:-1]] = 1.0
    target = -wrenches.G @ pressing
    scale = float(np.linalg.norm(wrenches.G, 2))
    size = float(np.linalg.norm(target))
    if size <= ZERO_SUPPORT * scale:
        return None
    rays = [wrenches.G[:, s : s + 1] for s in starts[:-1]]
    for _ in range(rounds):
        columns = np.concatenate(rays, axis=1)
        weights, distance = nnls(columns, target, maxiter=50 * columns.shape[1])
        if distance <= ZERO_SUPPORT * size:
            return None
        y = (target - columns @ weights) / distance
        force = wrenches.project((y @ wrenches.G)[None, :])[0]
        if np.linalg.norm(force) <= ZERO_SUPPORT * scale:
            return y
        keep = weights > 0.0
        new = [wrenches.G[:, a:b] @ force[a:b] for a, b in pairwise(starts)]
        grown = [w[:, None] / np.linalg.norm(w) for w in new if np.linalg.norm(w) > 1e-12 * scale]
        rays = [columns[:, keep], *grown]
    return y
