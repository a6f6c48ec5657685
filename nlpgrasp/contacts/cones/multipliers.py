"""Projection onto the polar cone in all cases: method of multipliers (augmented Lagrangian).

Each stage minimises ``|q - z|^2 / 2 + sum_i |P_F(u_i + r A_i^T q)|^2 / (2 r)`` by a semismooth Newton method with the
closed form of ``P_F``, then sets ``u_i = P_F(u_i + r A_i^T q)`` and increases r. Slower than the other methods.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts.cones.cholesky import solve_some
from nlpgrasp.contacts.cones.terms import upper_triangle

FIRST, FACTOR, LAST, MOST = 100.0, 10.0, 1e8, 1e11  # penalty r: first, growth, last for arms of 1 m, largest
ROUGHLY, FINELY = 1e-4, 1e-12  # gradient norms, for unit points, that end a stage, and those at the last r
ROUNDING = 1e-14  # step length relative to the point that ends a stage
AGAIN = 8  # most updates of the multipliers at the last r
FAR = 1e-2  # gradient norm above which a stage has failed and its multipliers are not used
MOVED = 1e-14  # change by the last update, relative to the point
STEPS, SHORTER = 30, 12  # most Newton steps per stage and backtracking steps


class _Look(NamedTuple):
    """Projections ``P_F(w)`` at every point, with value and gradient of the augmented Lagrangian."""

    forces: FloatArray  # (N, 3, m)
    shrink: FloatArray  # (N, m): scale of the tangential part
    outside: FloatArray  # (N, m): 1 where w is outside F, else 0
    w: FloatArray
    gradient: FloatArray  # (n, m)
    value: FloatArray  # (m,)


class Multipliers:
    """Method of multipliers for points with generators A (n, 3 N) at ``arms`` (N, 2) and equal friction."""

    def __init__(self, generators: FloatArray, arms: FloatArray, friction: float) -> None:
        self._generators, self._count, self._friction = generators, len(arms), friction
        self._upper = upper_triangle(len(generators))
        short = np.min(np.abs(arms)[np.abs(arms) > 1e-9 * np.max(np.abs(arms))])
        self._last = float(min(MOST, LAST / min(1.0, short) ** 2))  # moments of short arms weigh little
        columns = []  # entries (a, b) of A P' A^T per entry (p, q) of every point's 3 by 3 matrix P'
        for part in np.split(generators, len(arms), axis=1):
            for p, q in upper_triangle(3):
                both = np.outer(part[:, p], part[:, q])
                both = both if p == q else both + both.T
                columns.append(np.array([both[place] for place in self._upper]))
        self._assemble = np.stack(columns, axis=1)

    def derivative(self, z: FloatArray, q: FloatArray, u: FloatArray) -> FloatArray:
        """Return the Jacobian of ``z - q``, (n, n, m): ``1 - (1 + r A P_F' A^T)^-1`` for large r."""
        n, m = z.shape
        matrix = np.empty((m, n, n))
        entries = self._curvature(self._look(z, q, u, self._last), self._last)
        for (a, b), entry in zip(self._upper, entries, strict=True):
            matrix[:, a, b] = matrix[:, b, a] = entry + (a == b)
        inverse = np.linalg.inv(matrix).transpose(1, 2, 0)
        return np.asarray(np.eye(n)[..., None] - 0.5 * (inverse + inverse.transpose(1, 0, 2)))

    def solve(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return projections q (n, m) of ``z`` (n, m) onto the polar cone and friction forces u (N, 3, m)."""
        q, u, r = z.copy(), np.zeros((self._count, 3, z.shape[1])), FIRST
        while r < self._last:
            q = self._minimise(z, q, u, r, ROUGHLY)
            there = self._look(z, q, u, r)
            u = np.where(np.linalg.norm(there.gradient, axis=0) < FAR, there.forces, u)
            r *= FACTOR
        going = np.arange(z.shape[1])
        for _ in range(AGAIN):
            before = q[:, going]
            q[:, going] = self._minimise(z[:, going], before, u[:, :, going], self._last, FINELY)
            there = self._look(z[:, going], q[:, going], u[:, :, going], self._last)
            near = np.linalg.norm(there.gradient, axis=0) < FAR
            u[:, :, going] = np.where(near, there.forces, u[:, :, going])
            moved = np.linalg.norm(q[:, going] - before, axis=0)
            going = going[moved > MOVED * (1.0 + np.linalg.norm(before, axis=0))]
            if not going.size:
                break
        return q, u

    def _minimise(self, z: FloatArray, q: FloatArray, u: FloatArray, r: float, tolerance: float) -> FloatArray:
        """Return the minimisers (n, m) of one stage by Newton's method, from q."""
        q, here, going = q.copy(), self._look(z, q, u, r), np.arange(z.shape[1])
        for _ in range(STEPS):
            entries = dict(zip(self._upper, self._curvature(here, r), strict=True))
            step = -solve_some(entries, np.ones(len(going)), here.gradient)
            slope, size = np.sum(here.gradient * step, axis=0), np.linalg.norm(here.gradient, axis=0)
            for _ in range(SHORTER):
                there = self._look(z, q[:, going] + step, u, r)
                left = np.linalg.norm(there.gradient, axis=0)
                uphill = (there.value > here.value + 1e-4 * slope) & (left > 0.5 * size)
                if not uphill.any():
                    break
                step[:, uphill] *= 0.25
                slope[uphill] *= 0.25
            else:
                there = self._look(z, q[:, going] + step, u, r)
                left = np.linalg.norm(there.gradient, axis=0)
            q[:, going] += step
            rounding = ROUNDING * (1.0 + np.linalg.norm(q[:, going], axis=0))
            still = (left > tolerance) & (np.linalg.norm(step, axis=0) > rounding)
            if not still.any():
                break
            going, z, u = going[still], z[:, still], u[:, :, still]
            here = _Look(*(part[..., still] for part in there))
        return q

    def _look(self, z: FloatArray, q: FloatArray, u: FloatArray, r: float) -> _Look:
        """Evaluate projections, gradient and value at ``w = u + r A^T q``."""
        mu = self._friction
        w = u + r * (self._generators.T @ q).reshape(u.shape)
        size = np.hypot(w[:, 1], w[:, 2])
        pressing = np.maximum(np.maximum(w[:, 0], 0.0), (w[:, 0] + mu * size) / (1.0 + mu**2))
        outside = size > mu * pressing
        shrink = np.where(outside, mu * pressing / np.where(size > 0.0, size, 1.0), 1.0)
        forces = np.stack([pressing, w[:, 1] * shrink, w[:, 2] * shrink], axis=1)
        off = q - z
        gradient = off + self._generators @ forces.reshape(self._generators.shape[1], -1)
        value = np.sum(q * (0.5 * q - z), axis=0) + np.sum(forces**2, axis=(0, 1)) / (2.0 * r)
        return _Look(forces, shrink, outside.astype(float), w, gradient, value)

    def _curvature(self, look: _Look, r: float) -> FloatArray:
        """Return the upper triangles of ``r A P_F'(w) A^T``, (n (n + 1) / 2, m)."""
        mu = self._friction
        on = (look.forces[:, 0] > 0.0).astype(float)
        edge = on * look.outside
        size = np.hypot(look.w[:, 1], look.w[:, 2])
        first, second = look.w[:, 1:].transpose(1, 0, 2) / np.where(size > 0.0, size, 1.0)
        weight = on / (1.0 + mu**2 * edge)
        across = edge * look.shrink  # of the tangential part across w's own
        along = edge * mu
        rest = on - edge + across
        entries = [
            weight,
            weight * along * first,
            weight * along * second,
            (weight * along**2 - across) * first**2 + rest,
            (weight * along**2 - across) * first * second,
            (weight * along**2 - across) * second**2 + rest,
        ]
        return np.asarray(r * (self._assemble @ np.stack(entries, axis=1).reshape(self._assemble.shape[1], -1)))
