"""Projection onto the polar cone if all points slip: Newton's method on the KKT conditions.

With the velocities ``v_i = A_i^T q`` of the points, ``g_i(q) = v_n + mu |v_t|`` is convex, homogeneous and smooth where
``v_t`` is not zero. The nearest q to z with every ``g_i <= 0`` satisfies ``q = z - sum_i l_i a_i(q)``,
``a_i = grad g_i``, ``l_i >= 0`` and ``l_i g_i = 0``. One step of Newton's method solves

    H q = z - a l,   l = argmin over l >= 0 of |z - a l| in the metric of H^-1,   H = 1 + sum_i l_i Hess g_i

since ``a_i^T q = g_i`` and ``Hess g_i q = 0``. H differs from the identity in the components ``(f_t1, f_t2, m_n)``
alone, where ``Hess g_i = mu / |v_t| p_i p_i^T`` with the unit force across the velocity as p_i. Steps are limited such
that no loaded point crosses the kink at ``v_t = 0``: each keeps a share of its speed, since all slip at the solution.
Results are checked against the KKT conditions; points that fail are left to the other methods.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts.cones.active_sets import least_nonnegative

SETTLED = 1e-8  # length of the last step, for projections of about unit length: the next would be rounding
EXACT = 4e-14  # tolerance of the KKT conditions, relative to the point
LEAST = 1e-15  # regularisation of the multipliers' matrix, singular where four gradients are dependent
FLAT = 1e-100  # speed that counts as zero
ORDER = [0, 4, 5, 1, 2, 3]  # components reordered: those of normal forces first, then those of tangential forces
BACK = [0, 3, 4, 5, 1, 2]


class _Try(NamedTuple):
    """Settings of a Newton run: least share of speed kept, steps, offset of the start (None: continue)."""

    keeps: float
    steps: int
    aside: float | None


TRIES = (_Try(0.5, 16, 0.0), _Try(0.01, 3, None), _Try(0.1, 24, 0.3))  # the first mostly takes 4 or 5 steps


class _Local(NamedTuple):
    """Local model at q and lam: slip velocities (2, N, m), speeds and g (N, m), and tangential parts.

    The tangential parts are those of a (3, N, m), of H^-1 (3, 3, m) and of H^-1 a (3, N, m).
    """

    slip: FloatArray
    speed: FloatArray
    values: FloatArray
    gradients: FloatArray
    inverse: FloatArray
    moved: FloatArray


class EdgeNewton:
    """Newton's method for contact points at ``arms`` (N, 2) along both tangents, with equal friction."""

    def __init__(self, arms: FloatArray, friction: float) -> None:
        self._a, self._b = arms[:, :1], arms[:, 1:]
        self._mu = friction
        self._normal = np.stack([np.ones(len(arms)), arms[:, 1], -arms[:, 0]], axis=1)  # of a_i, (N, 3)
        self._gram = (self._normal @ self._normal.T)[..., None]

    def solve(self, z: FloatArray) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
        """Return projections q (6, m) of ``z`` (6, m), multipliers l (N, m), and where KKT conditions hold, (m,)."""
        z = z[ORDER]
        q, lam, good = z.copy(), np.zeros((len(self._a), z.shape[1])), np.zeros(z.shape[1], dtype=bool)
        for one in TRIES:
            left = np.flatnonzero(~good)
            if not left.size:
                break
            begin, pressed = q[:, left], lam[:, left]
            if one.aside is not None:
                begin, pressed = z[:, left], np.zeros_like(pressed)
                begin[3:] += one.aside * np.array([[1.0], [0.7], [0.4]])
            q[:, left], lam[:, left], good[left] = self._iterate(z[:, left], begin, pressed, one)
        return q[BACK], lam, good

    def derivative(self, q: FloatArray, lam: FloatArray) -> FloatArray:
        """Return the Jacobian ``1 - H^-1 + H^-1 a (a^T H^-1 a)^-1 a^T H^-1`` of ``z - q``, (6, 6, m)."""
        local = self._at(q[ORDER], lam)
        matrix = np.where((lam[:, None] > 0.0) & (lam[None] > 0.0), self._products(local), 0.0).transpose(2, 0, 1)
        matrix += np.eye(len(lam)) * np.where(lam > 0.0, LEAST, 1.0).T[:, None, :]
        a = np.zeros((6, *lam.shape))
        a[:3], a[3:] = self._normal.T[..., None], local.moved
        a *= lam > 0.0
        result = np.asarray(np.einsum("aim,mij,bjm->abm", a, np.linalg.inv(matrix), a, optimize=True))
        result[3:, 3:] += np.eye(3)[..., None] - local.inverse
        return np.asarray(result[np.ix_(BACK, BACK)])

    def _iterate(
        self, z: FloatArray, q: FloatArray, lam: FloatArray, one: _Try
    ) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
        """Run Newton's method as in ``solve`` from given q and multipliers."""
        size = 1.0 + np.sqrt(np.sum(z**2, axis=0))
        q_all, lam_all = q.copy(), lam.copy()
        going, some, limit = np.arange(z.shape[1]), z, size
        for _ in range(one.steps):
            local = self._at(q, lam)
            step, pressed = self._step(some, local, lam, LEAST * limit)
            step -= q
            length = self._length(local, step, pressed, one.keeps)
            q, lam = q + length * step, lam + length * (pressed - lam)
            q_all[:, going], lam_all[:, going] = q, lam
            still = np.max(np.abs(step), axis=0) > SETTLED + 0.5 * EXACT * limit
            if not still.any():
                break
            if not still.all():
                kept = np.flatnonzero(still)
                going, q, lam, some, limit = going[kept], q[:, kept], lam[:, kept], some[:, kept], limit[kept]
        return q_all, lam_all, self._meets(z, q_all, lam_all, EXACT * size)

    def _length(self, local: _Local, step: FloatArray, pressed: FloatArray, keeps: float) -> FloatArray:
        """Return the step lengths (m,) at which every loaded point keeps a share of its speed along its slip."""
        loss = -local.slip[0] * (step[3] - self._b * step[5]) - local.slip[1] * (step[4] + self._a * step[5])
        room = (1.0 - keeps) * local.speed**2
        return np.asarray(np.min(room / np.where(pressed > 0.0, np.maximum(loss, room), room).clip(FLAT), axis=0))

    def _step(self, z: FloatArray, local: _Local, lam: FloatArray, least: FloatArray) -> tuple[FloatArray, FloatArray]:
        z_t = np.einsum("abm,bm->am", local.inverse, z[3:])
        right = self._normal @ z[:3] + np.einsum("aim,am->im", local.gradients, z_t)
        active = (lam > 0.0) | (local.values > least)
        lam = least_nonnegative(self._products(local), right, active, least, LEAST)
        q = np.empty_like(z)
        q[:3] = z[:3] - self._normal.T @ lam
        q[3:] = z_t - np.einsum("aim,im->am", local.moved, lam)
        return q, lam

    def _at(self, q: FloatArray, lam: FloatArray) -> _Local:
        a, b, mu = self._a, self._b, self._mu
        slip, gradients, across = np.empty((2, *lam.shape)), np.empty((3, *lam.shape)), np.empty((3, *lam.shape))
        slip[0], slip[1] = q[3] - b * q[5], q[4] + a * q[5]
        speed = np.sqrt(slip[0] * slip[0] + slip[1] * slip[1])
        values = self._normal @ q[:3] + mu * speed
        inverse = 1.0 / np.where(speed > FLAT, speed, 1.0)
        first, second = slip * inverse
        gradients[0], gradients[1], gradients[2] = first, second, a * second - b * first
        gradients *= mu
        across[0], across[1], across[2] = -second, first, a * first + b * second
        H = np.einsum("aim,bim->abm", across * (mu * lam * inverse), across)
        inverted = _inverse_of_one_plus(H)
        return _Local(slip, speed, values, gradients, inverted, np.einsum("abm,bim->aim", inverted, gradients))

    def _products(self, local: _Local) -> FloatArray:
        """Return ``a^T H^-1 a``, (N, N, m)."""
        return np.asarray(self._gram + np.einsum("aim,ajm->ijm", local.gradients, local.moved))

    def _meets(self, z: FloatArray, q: FloatArray, lam: FloatArray, limit: FloatArray) -> NDArray[np.bool_]:
        """Return where the KKT conditions hold: feasibility, complementarity, stationarity."""
        local = self._at(q, lam)
        off = q - z
        off[:3] += self._normal.T @ lam
        off[3:] += np.einsum("aim,im->am", local.gradients, lam)
        most = np.maximum(np.max(local.values, axis=0), np.max(np.abs(local.values * lam), axis=0))
        return np.asarray((most <= limit) & (np.max(np.abs(off), axis=0) <= limit))


def _inverse_of_one_plus(H: FloatArray) -> FloatArray:
    """Return the inverses of ``1 + H`` for positive semidefinite matrices H (3, 3, m)."""
    first = 1.0 / (1.0 + H[0, 0])
    a, b = H[0, 1] * first, H[0, 2] * first
    second = 1.0 / np.maximum(1.0 + H[1, 1] - a * H[0, 1], 1.0)
    rest = H[1, 2] - a * H[0, 2]
    c = rest * second
    third = 1.0 / np.maximum(1.0 + H[2, 2] - b * H[0, 2] - c * rest, 1.0)
    b = a * c - b
    result = np.empty_like(H)
    result[2, 2] = third
    result[1, 2] = result[2, 1] = -c * third
    result[0, 2] = result[2, 0] = b * third
    result[1, 1] = second + c * c * third
    result[0, 1] = result[1, 0] = -a * second - b * c * third
    result[0, 0] = first + a * a * second + b * b * third
    return result
