"""Minkowski sums of friction cones: wrenches of several friction contacts with a common normal.

Under Coulomb's law and any pressure, the wrench on a line or polygonal pad is that of friction contacts at its ends or
corners (docs/paper/02_contacts.md). With ``u_i`` in the friction cone F of point i

    K = {sum_i A_i u_i : u_i in F},   polar  K° = {y : v_n + mu |v_t| <= 0 for v = A_i^T y of every i}.

The projection is ``P(z) = z - q`` where q is the projection onto the polar cone (Moreau). Four methods are tried in
turn, and their results are checked against the optimality conditions:

1. One or two points stick: linear maps (``sticking``).
2. Three or more stick: ``q = 0``, z is a sum of friction forces (``sharing``).
3. All loaded points slip: Newton's method (``edge_newton``), which solves nearly all.
4. All other cases: the method of multipliers (``multipliers``).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts.cones.edge_newton import EdgeNewton
from nlpgrasp.contacts.cones.multipliers import Multipliers
from nlpgrasp.contacts.cones.sharing import Sharing
from nlpgrasp.contacts.cones.sticking import Sticking
from nlpgrasp.contacts.cones.terms import upper_triangle

CHUNK = 4096  # points per batch
LEAST = 1e-9  # work of unit points below which only rounding is left
POLAR, SLIPS, OTHER, INSIDE = -1, -2, -3, -4  # methods of a projection; from 0: index of the map for sticking points


class _Nearest(NamedTuple):
    """Projections onto the polar cone (n, m), their methods (m,), and multipliers."""

    q: FloatArray
    how: NDArray[np.intp]
    weights: FloatArray  # (N, m), where points slip
    forces: FloatArray  # (N, 3, number solved by the method of multipliers)


@dataclass(frozen=True)
class FrictionPoints:
    """Minkowski sum of the friction cones of several points, in wrench components of their common frame.

    Parameters
    ----------
    arms : tuple of N pairs
        Positions of the points along both tangents, metres.
    friction : float
        Coulomb coefficient.
    axes : tuple of n int
        Indices of the components kept of ``(f_n, f_t1, f_t2, m_n, m_t1, m_t2)``; the others are zero.
    """

    arms: tuple[tuple[float, float], ...]
    friction: float
    axes: tuple[int, ...]

    @cached_property
    def generators(self) -> FloatArray:
        """Matrix A, (n, 3 N), from the forces ``(f_n, f_t1, f_t2)`` at the points to wrench components."""
        parts = []
        for a, b in self.arms:
            moments = np.array([[0.0, -b, a], [b, 0.0, 0.0], [-a, 0.0, 0.0]])  # of r x f, r = a t1 + b t2
            parts.append(np.concatenate([np.eye(3), moments])[list(self.axes)])
        return np.concatenate(parts, axis=1)

    def cones(self) -> list[FloatArray]:
        """Return matrices M (3, 3 N): forces u are in the friction cones if all ``M u`` are in second-order cones."""
        scale = np.diag([self.friction, 1.0, 1.0])
        return [np.asarray(np.kron(row[None, :], scale)) for row in np.eye(len(self.arms))]

    def extreme(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the support ``max(0, v_n + mu |v_t|)`` over the points, (...), and a maximiser (..., n)."""
        v = (z @ self.generators).reshape(*z.shape[:-1], len(self.arms), 3)
        size = np.hypot(v[..., 1], v[..., 2])
        work = v[..., 0] + self.friction * size
        best = np.argmax(work, axis=-1)[..., None]
        forces = np.ones_like(v)
        forces[..., 1:] = v[..., 1:] * (self.friction / np.where(size > 0.0, size, 1.0))[..., None]
        value = np.take_along_axis(work, best, axis=-1)[..., 0]
        alone = forces * ((np.arange(len(self.arms)) == best) & (value > 0.0)[..., None])[..., None]
        return np.maximum(value, 0.0), alone.reshape(*z.shape[:-1], -1) @ self.generators.T

    def project(self, z: FloatArray) -> FloatArray:
        """Return the projection of ``z`` (..., n) onto the cone."""
        flat, size = _unit(z)
        one, share = self._scaled(flat)
        result = (one - self._nearest(one).q) * (share * size)
        result[0] = np.maximum(result[0], 0.0)
        return np.asarray(result.T.reshape(z.shape))

    def ways(self, z: FloatArray) -> NDArray[np.intp]:
        """Return the methods (m,) that project ``z`` (m, n): ``SLIPS``, ``INSIDE``, ..., or the index of a map."""
        return self._nearest(self._scaled(_unit(z)[0])[0]).how

    def derivative_entries(self, z: FloatArray) -> FloatArray:
        """Return the upper triangle of the projection's Jacobian, entries first, (n (n + 1) / 2, ...)."""
        flat, _ = _unit(z)
        one, _ = self._scaled(flat)
        near, n = self._nearest(one), len(flat)
        matrix = np.zeros((n, n, flat.shape[1]))
        matrix[..., near.how == INSIDE] = np.eye(n)[..., None]
        sticks = near.how >= 0
        matrix[..., sticks] = self._sticking.maps[near.how[sticks]].transpose(1, 2, 0)
        slips, other = np.flatnonzero(near.how == SLIPS), np.flatnonzero(near.how == OTHER)
        if slips.size:
            six = np.zeros((6, slips.size))
            six[list(self.axes)] = near.q[:, slips]
            full = self._newton.derivative(six, near.weights[:, slips])
            matrix[..., slips] = full[np.ix_(self.axes, self.axes)]
        if other.size:
            matrix[..., other] = self._method.derivative(one[:, other], near.q[:, other], near.forces)
        return np.array([matrix[place].reshape(z.shape[:-1]) for place in upper_triangle(n)])

    @cached_property
    def _newton(self) -> EdgeNewton:
        return EdgeNewton(np.array(self.arms), self.friction)

    @cached_property
    def _method(self) -> Multipliers:
        return Multipliers(self.generators, np.array(self.arms), self.friction)

    @cached_property
    def _sticking(self) -> Sticking:
        return Sticking(self.generators, np.array(self.arms), self.friction)

    @cached_property
    def _sharing(self) -> Sharing:
        return Sharing(self.generators, self.friction)

    @cached_property
    def _last(self) -> list[tuple[FloatArray, _Nearest]]:
        """Cache of the last projections, whose derivative is often needed next."""
        return []

    def _most_work(self, v: FloatArray) -> FloatArray:
        """Return the largest ``v_n + mu |v_t|`` over the points, (m,), for velocities (3 N, m)."""
        v = v.reshape(len(self.arms), 3, -1)
        return np.asarray(np.max(v[:, 0] + self.friction * np.hypot(v[:, 1], v[:, 2]), axis=0, initial=-np.inf))

    def _scaled(self, flat: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Scale points outside the polar cone to projections of about unit length; return them and the scale (m,)."""
        work = self._most_work(self.generators.T @ flat)
        share = np.where(work > 0.0, np.maximum(work, LEAST), 1.0)
        return flat / share, share

    def _nearest(self, z: FloatArray) -> _Nearest:
        """Project ``z`` (n, m) onto the polar cone, with caching and in batches."""
        if self._last and np.array_equal(self._last[0][0], z):
            return self._last[0][1]
        parts = [self._some(z[:, a : a + CHUNK]) for a in range(0, max(1, z.shape[1]), CHUNK)]
        found = _Nearest(*(np.concatenate(part, axis=-1) for part in zip(*parts, strict=True)))
        self._last[:] = [(z, found)]
        return found

    def _some(self, z: FloatArray) -> _Nearest:
        """Project one batch of points ``z`` (n, m) onto the polar cone."""
        q, weights = z.copy(), np.zeros((len(self.arms), z.shape[1]))
        how = np.where(self._most_work(self.generators.T @ z) > 0.0, SLIPS, POLAR)
        left = np.flatnonzero(how == SLIPS)
        which = self._sticking.find(z[:, left])
        sticks = left[which >= 0]
        how[sticks] = which[which >= 0]
        q[:, sticks] -= np.matmul(self._sticking.maps[how[sticks]], z[:, sticks].T[..., None])[..., 0].T
        left = left[which < 0]
        if len(self.arms) > 2:
            inside = self._sharing.inside(z[:, left])
            q[:, left[inside]] = 0.0
            how[left[inside]] = INSIDE
            left = left[~inside]
        if left.size:
            six = np.zeros((6, left.size))
            six[list(self.axes)] = z[:, left]
            found, weights[:, left], good = self._newton.solve(six)
            q[:, left] = found[list(self.axes)]
            left = left[~good]
        forces = np.zeros((len(self.arms), 3, left.size))
        if left.size:
            how[left] = OTHER
            q[:, left], forces = self._method.solve(z[:, left])
        return _Nearest(q, how, weights, forces)


def _unit(z: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return points (..., n) as columns of unit length (or zero), (n, m), and their lengths (m,)."""
    flat = z.reshape(-1, z.shape[-1]).T
    most = np.max(np.abs(flat), axis=0, initial=0.0)
    most = np.where(most > 0.0, most, 1.0)
    length = np.linalg.norm(flat / most, axis=0)
    length = np.where(length > 0.0, length, 1.0)
    return flat / most / length, most * length
