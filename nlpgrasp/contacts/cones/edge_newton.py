"""The polar cone's nearest point by Newton's method on the conditions of optimality: quick where no point sticks.

With the velocities ``v_i = A_i^T q`` of the points, ``g_i(q) = v_n + mu |v_t|`` is convex, homogeneous and smooth where
``v_t`` is not zero. The nearest q to z with every ``g_i <= 0`` satisfies ``q = z - sum_i l_i a_i(q)``,
``a_i = grad g_i``, ``l_i >= 0`` and ``l_i g_i = 0``. One step of Newton's method solves

    H q = z - a l,   l = argmin over l >= 0 of |z - a l| in the metric of H^-1,   H = 1 + sum_i l_i Hess g_i

since ``a_i^T q = g_i`` and ``Hess g_i q = 0``. H differs from the identity in the components ``(f_t1, f_t2, m_n)``
alone, where ``Hess g_i = mu / |v_t| p_i p_i^T`` with the unit force across the velocity as p_i. What is found is
checked against the conditions themselves; the rest is left to others.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts.cones.cholesky import solve_some

STEPS = 8  # the convergence is quadratic: four or five
DAMPED, SHORTER = 6, 0.6  # where it fails, first so many steps of this length
SETTLED = 1e-8  # the last step, of projections near unit length, after which only rounding is left
EXACT = 4e-14  # of the conditions, relative to the point
SETS = 4  # active sets tried in a step
LEAST = 1e-15  # under the multipliers' matrix, singular where four gradients depend on each other
NORMAL, ACROSS = [0, 4, 5], [1, 2, 3]  # components that normal forces at the points have, and tangential ones


class _Local(NamedTuple):
    """What belongs to q and lam: g (N, m), tangential parts of a (3, N, m), of H^-1 (3, 3, m), and of H^-1 a."""

    values: FloatArray
    gradients: FloatArray
    inverse: FloatArray
    moved: FloatArray


class EdgeNewton:
    """Newton's method for points at ``arms`` (N, 2) along both tangents, with one friction coefficient."""

    def __init__(self, arms: FloatArray, friction: float) -> None:
        self._a, self._b = arms[:, :1], arms[:, 1:]
        self._mu = friction
        self._normal = np.stack([np.ones(len(arms)), arms[:, 1], -arms[:, 0]], axis=1)  # of a_i, (N, 3)
        self._gram = (self._normal @ self._normal.T)[..., None]

    def solve(self, z: FloatArray) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
        """Return nearest points q (6, m) of ``z`` (6, m), multipliers l (N, m), and which meet the conditions (m,)."""
        q, lam, good = self._iterate(z, 0)
        left = np.flatnonzero(~good)
        if left.size:
            q[:, left], lam[:, left], good[left] = self._iterate(z[:, left], DAMPED)
        return q, lam, good

    def _iterate(self, z: FloatArray, damped: int) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
        """Return ``solve`` with that many shorter steps first."""
        size = 1.0 + np.sqrt(np.sum(z**2, axis=0))
        q_all, lam_all = z.copy(), np.zeros((len(self._a), z.shape[1]))
        going, q, lam, some = np.arange(z.shape[1]), z, lam_all, z
        for count in range(damped + STEPS):
            before, pressed = q, lam
            q, lam = self._step(some, q, lam, size[going])
            if 0 < count < damped:
                q, lam = before + SHORTER * (q - before), pressed + SHORTER * (lam - pressed)
            q_all[:, going], lam_all[:, going] = q, lam
            still = np.max(np.abs(q - before), axis=0) > SETTLED + 0.5 * EXACT * size[going]
            if not still.any():
                break
            if not still.all():
                going, q, lam, some = going[still], q[:, still], lam[:, still], some[:, still]
        return q_all, lam_all, self._meets(z, q_all, lam_all, EXACT * size)

    def derivative(self, q: FloatArray, lam: FloatArray) -> FloatArray:
        """Return the Jacobian ``1 - H^-1 + H^-1 a (a^T H^-1 a)^-1 a^T H^-1`` of ``z - q``, (6, 6, m)."""
        local = self._at(q, lam)
        matrix = np.where((lam[:, None] > 0.0) & (lam[None] > 0.0), self._products(local), 0.0).transpose(2, 0, 1)
        matrix += np.eye(len(lam)) * np.where(lam > 0.0, LEAST, 1.0).T[:, None, :]
        a = np.zeros((6, *lam.shape))
        a[NORMAL], a[ACROSS] = self._normal.T[..., None], local.moved
        a *= lam > 0.0
        result = np.asarray(np.einsum("aim,mij,bjm->abm", a, np.linalg.inv(matrix), a, optimize=True))
        result[1:4, 1:4] += np.eye(3)[..., None] - local.inverse
        return result

    def _step(self, z: FloatArray, q: FloatArray, lam: FloatArray, size: FloatArray) -> tuple[FloatArray, FloatArray]:
        local = self._at(q, lam)
        z_n, z_t = z[NORMAL], np.einsum("abm,bm->am", local.inverse, z[ACROSS])
        right = self._normal @ z_n + np.einsum("aim,am->im", local.gradients, z_t)
        active = (lam > 0.0) | (local.values > LEAST * size)
        lam = _nonnegative(self._products(local), right, active, LEAST * size)
        q = np.empty_like(z)
        q[NORMAL] = z_n - self._normal.T @ lam
        q[ACROSS] = z_t - np.einsum("aim,im->am", local.moved, lam)
        return q, lam

    def _at(self, q: FloatArray, lam: FloatArray) -> _Local:
        a, b, mu = self._a, self._b, self._mu
        first, second = q[1] - b * q[3], q[2] + a * q[3]
        speed = np.hypot(first, second)
        values = self._normal @ q[NORMAL] + mu * speed
        inverse = 1.0 / np.where(speed > 0.0, speed, 1.0)
        first, second = first * inverse, second * inverse
        gradients = mu * np.stack([first, second, a * second - b * first])
        across = np.stack([-second, first, a * first + b * second])
        H = np.einsum("aim,bim->abm", across * (mu * lam * inverse), across)
        H[range(3), range(3)] += 1.0
        inverted = _inverse(H)
        return _Local(values, gradients, inverted, np.einsum("abm,bim->aim", inverted, gradients))

    def _products(self, local: _Local) -> FloatArray:
        """Return ``a^T H^-1 a``, (N, N, m)."""
        return np.asarray(self._gram + np.einsum("aim,ajm->ijm", local.gradients, local.moved))

    def _meets(self, z: FloatArray, q: FloatArray, lam: FloatArray, limit: FloatArray) -> NDArray[np.bool_]:
        """Return where the conditions of optimality hold: feasible, complementary, stationary."""
        local = self._at(q, lam)
        off = q - z
        off[NORMAL] += self._normal.T @ lam
        off[ACROSS] += np.einsum("aim,im->am", local.gradients, lam)
        most = np.maximum(np.max(local.values, axis=0), np.max(np.abs(local.values * lam), axis=0))
        return np.asarray((most <= limit) & (np.max(np.abs(off), axis=0) <= limit))


def _nonnegative(matrix: FloatArray, right: FloatArray, active: NDArray[np.bool_], least: FloatArray) -> FloatArray:
    """Return the least ``lam^T M lam / 2 - right^T lam`` over ``lam >= 0`` (N, m), from active sets near its own."""
    count, least_pivot = len(right), np.full(right.shape[1], LEAST)
    for _ in range(SETS):
        both = active[:, None] & active[None]
        entries = {
            (i, j): np.where(both[i, j], matrix[i, j], float(i == j)) for i in range(count) for j in range(i, count)
        }
        lam = solve_some(entries, least_pivot, np.where(active, right, 0.0))
        pays = right - np.einsum("ijm,jm->im", matrix, lam) > least
        chosen = np.where(active, lam > 0.0, pays)
        if (chosen == active).all():
            break
        active = chosen
    return np.maximum(lam, 0.0)


def _inverse(H: FloatArray) -> FloatArray:
    """Return the inverses of symmetric matrices (3, 3, m), by cofactors."""
    a, b, c, d, e, f = H[0, 0], H[0, 1], H[0, 2], H[1, 1], H[1, 2], H[2, 2]
    result = np.empty_like(H)
    result[0, 0], result[1, 1], result[2, 2] = d * f - e * e, a * f - c * c, a * d - b * b
    result[0, 1] = result[1, 0] = c * e - b * f
    result[0, 2] = result[2, 0] = b * e - c * d
    result[1, 2] = result[2, 1] = b * c - a * e
    return np.asarray(result / (a * result[0, 0] + b * result[0, 1] + c * result[0, 2]))
