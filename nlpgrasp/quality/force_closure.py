"""Directions along which no contact force does positive work: proofs against force closure (see ``stability``)."""

from __future__ import annotations

import numpy as np
from scipy.optimize import nnls

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.quality.wrench_set import WrenchSet

ZERO_SUPPORT = 1e-10  # |P_K(z)| over |z| up to which z counts as in the polar of K
EXACT = 1e-13  # tolerance at which the search for a separating direction stops


def positive_share(wrenches: WrenchSet, y: FloatArray) -> FloatArray:
    """Return the fraction ``|P_K(z)| / |z|`` of ``z = G^T y`` within the force domain, (m,), for y (m, d).

    It is 0 if no force in K does positive work along y. Comparing ``P_K(z)`` with z itself depends neither on units nor
    on the torque origin.
    """
    z = y @ wrenches.G
    return np.asarray(np.linalg.norm(wrenches.project(z), axis=1) / np.maximum(np.linalg.norm(z, axis=1), 1e-300))


def has_no_support(wrenches: WrenchSet, y: FloatArray) -> bool:
    """Return whether ``G^T y`` is in the polar cone of K, so that no force does positive work along y."""
    return bool(positive_share(wrenches, y[None, :])[0] <= ZERO_SUPPORT)


def separating_direction(wrenches: WrenchSet, rounds: int = 100) -> FloatArray | None:
    """Return a candidate for a direction along which no force in K does positive work, or None.

    Take a force x0 inside the cones and the wrench ``w = -G x0``. If some force in K produces w, both together are an
    internal force inside the cones, and with G of full rank the grasp is force-closed. Otherwise a direction that
    separates w from ``G K`` has ``G^T y`` in the polar cone of K.

    Parameters
    ----------
    wrenches : WrenchSet
        Full row rank.
    rounds : int
        Most rays added per contact.

    Returns
    -------
    (d,) array or None
        The caller has to check ``has_no_support``, which is the proof.
    """
    U, S, _ = np.linalg.svd(wrenches.G, full_matrices=False)
    whitened = wrenches.transformed((U / S).T)  # rows of G orthonormal: as well-conditioned as the question allows
    normal_forces = np.zeros(wrenches.G.shape[1])
    normal_forces[[r.start for r in wrenches.ranges]] = 1.0
    target = -whitened.G @ normal_forces
    if np.linalg.norm(target) <= ZERO_SUPPORT:
        return None
    y = separate_wrench(whitened, target, rounds)
    if y is None:
        return None
    y = (U / S) @ y
    return np.asarray(y / np.linalg.norm(y))


def separate_wrench(wrenches: WrenchSet, target: FloatArray, rounds: int = 100) -> FloatArray | None:
    """Return a unit direction (d,) that separates a wrench (d,) from the cone ``G K``; None for a wrench inside.

    The nearest point of ``G K`` is found by nonnegative least squares over a growing set of its rays; the residual is
    orthogonal to that point and in the polar cone.
    """
    scale, size = float(np.linalg.norm(wrenches.G, 2)), float(np.linalg.norm(target))
    ranges = wrenches.ranges
    rays = [wrenches.G[:, r.start : r.start + 1] for r in ranges]
    direction, least_share = target / size, np.inf
    for _ in range(rounds):
        columns = np.concatenate(rays, axis=1)
        weights, distance = nnls(columns, target, maxiter=50 * columns.shape[1])
        if distance <= EXACT * size:
            return None
        y = (target - columns @ weights) / distance
        force = wrenches.project((y @ wrenches.G)[None, :])[0]
        share = float(positive_share(wrenches, y[None, :])[0])
        if share < least_share:
            direction, least_share = y, share
        if share <= EXACT:
            break
        is_used = weights > 0.0
        maximisers = [wrenches.G[:, r] @ force[r] for r in ranges]
        new_rays = [w[:, None] / np.linalg.norm(w) for w in maximisers if np.linalg.norm(w) > 1e-15 * scale]
        if not new_rays:
            break
        rays = [columns[:, is_used], *new_rays]
    return np.asarray(direction)
