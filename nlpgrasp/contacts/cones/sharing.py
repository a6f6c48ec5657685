"""Membership test for the interior of a Minkowski sum of friction cones.

``z = sum_i A_i u_i`` has many solutions ``u = A^+ z + N x``. The minimum of ``sum_i dist(u_i, F')^2`` over x, with F'
slightly inside the friction cone F, is 0 where z is well inside; a semismooth Newton method approaches it in a few
steps. Only forces with every u_i in F itself count, which proves membership; wrenches close to the boundary are left
to other methods.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.common.validation import FloatArray

NARROWER = 1e-3  # relative reduction of friction in F'; height of its apex over the mean normal force
STEPS = 20
FLAT = 1e-100  # tangential force that counts as zero
REGULAR = 1e-10  # regularisation of the Hessian's diagonal


class Sharing:
    """Search for friction forces that sum to a wrench, for points with generators A (n, 3 N)."""

    def __init__(self, generators: FloatArray, friction: float) -> None:
        self._friction = friction
        self._count = generators.shape[1] // 3
        arms = generators.reshape(len(generators), self._count, 3)
        self._most = np.sum(np.max(np.abs(arms), axis=1) * [1.0, friction, friction], axis=1)
        self._least = np.asarray(np.linalg.pinv(generators))
        self._free = np.asarray(np.linalg.svd(generators)[2][np.linalg.matrix_rank(generators) :].T)
        free = self._free.reshape(self._count, 3, -1)
        self._squares = np.einsum("ipa,iqb->ipqab", free, free).reshape(9 * self._count, -1)

    def inside(self, z: FloatArray) -> NDArray[np.bool_]:
        """Return where wrenches (n, m) were found to be sums of forces in the friction cones, (m,)."""
        found = np.zeros(z.shape[1], dtype=bool)
        left = np.flatnonzero(np.all(np.abs(z) <= self._most[:, None] * z[0], axis=0))
        u = (self._least @ z[:, left]).reshape(self._count, 3, -1)
        for count in range(STEPS):
            if count:
                u = u + self._step(u)
            good = self._allowed(u)
            found[left[good]] = True
            left, u = left[~good], u[..., ~good]
            if not left.size:
                break
        return found

    def _allowed(self, u: FloatArray) -> NDArray[np.bool_]:
        return np.asarray(np.all(np.hypot(u[:, 1], u[:, 2]) <= self._friction * u[:, 0], axis=0))

    def _step(self, u: FloatArray) -> FloatArray:
        """Return the semismooth Newton step (N, 3, m)."""
        mu, apex = self._friction * (1.0 - NARROWER), NARROWER * np.mean(u[:, 0], axis=0)
        u = u.copy()
        u[:, 0] -= apex
        size = np.hypot(u[:, 1], u[:, 2])
        pressing = np.maximum(np.maximum(u[:, 0], 0.0), (u[:, 0] + mu * size) / (1.0 + mu**2))
        edge = (size > mu * pressing) & (pressing > 0.0)
        inverse = 1.0 / np.where(size > FLAT, size, 1.0)
        shrink = np.where(size > mu * pressing, mu * pressing * inverse, 1.0)
        direction = u[:, 1:] * inverse[:, None]
        off = u.copy()
        off[:, 0] -= pressing
        off[:, 1:] *= (1.0 - shrink)[:, None]
        share = edge / (1.0 + mu**2)
        bend = np.zeros((self._count, 3, 3, u.shape[2]))  # 1 - P_F'
        outside = (size > mu * pressing).astype(float)
        bend[:, 0, 0] = np.where(edge, 1.0 - share, outside)
        bend[:, 0, 1:] = bend[:, 1:, 0] = -mu * share[:, None] * direction
        both = direction[:, :, None] * direction[:, None]
        bend[:, 1:, 1:] = (shrink * outside - mu**2 * share)[:, None, None] * both
        bend[:, 1, 1] += outside * (1.0 - shrink)
        bend[:, 2, 2] += outside * (1.0 - shrink)
        d = self._free.shape[1]
        H = (self._squares.T @ bend.reshape(9 * self._count, -1)).T.reshape(-1, d, d)
        H[:, range(d), range(d)] += REGULAR
        slope = self._free.T @ off.reshape(3 * self._count, -1)
        x = np.linalg.solve(H, -slope.T[..., None])[..., 0].T
        return (self._free @ x).reshape(u.shape)
