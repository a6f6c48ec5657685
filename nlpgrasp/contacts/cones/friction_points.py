"""Sums of friction cones: the wrenches about one point of several friction contacts with the same normal.

Coulomb's law along a line or over a pad with corners: whatever the pressure, the wrench of the forces on it is that of
friction contacts at the ends or corners (docs/paper/02_contacts.md). With ``u_i`` in the friction cone F of point i

    K = {sum_i A_i u_i : u_i in F},   polar  K° = {y : v_n + mu |v_t| <= 0 for v = A_i^T y of every i}.

The projection is ``P(z) = z - q`` where q is the nearest point of the polar cone (Moreau). Four ways find it, each
checked against the conditions of optimality before the next is asked:

1. Where one point sticks, or two, linear maps (``sticking``).
2. Where three or more stick, ``q = 0``: forces that add up to z (``sharing``).
3. Where every point that presses slips, Newton's method (``edge_newton``): nearly all.
4. The method of multipliers (``multipliers``), for anything.
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

CHUNK = 4096  # points at once
LEAST = 1e-9  # work of unit points below which rounding leaves no digits
POLAR, SLIPS, OTHER, INSIDE = -1, -2, -3, -4  # how a nearest point was found; from 0: the map where points stick


class _Nearest(NamedTuple):
    """Points of the polar cone (n, m), how they were found (m,), and the multipliers of the two methods."""

    q: FloatArray
    how: NDArray[np.intp]
    weights: FloatArray  # (N, m), where points slip
    forces: FloatArray  # (N, 3, number of others)


@dataclass(frozen=True)
class FrictionPoints:
    """The cone of several friction contacts, in components of their common frame.

    Parameters
    ----------
    arms : tuple of N pairs
        Where the points are along both tangents, metres.
    friction : float
        Coulomb coefficient.
    axes : tuple of n int
        Components ``(f_n, f_t1, f_t2, m_n, m_t1, m_t2)`` that are kept; the others are zero.
    """

    arms: tuple[tuple[float, float], ...]
    friction: float
    axes: tuple[int, ...]

    @cached_property
    def generators(self) -> FloatArray:
        """A, (n, 3 N): the components of forces ``(f_n, f_t1, f_t2)`` at the points, point by point."""
        parts = []
        for a, b in self.arms:
            moments = np.array([[0.0, -b, a], [b, 0.0, 0.0], [-a, 0.0, 0.0]])  # of r x f, r = a t1 + b t2
            parts.append(np.concatenate([np.eye(3), moments])[list(self.axes)])
        return np.concatenate(parts, axis=1)

    def cones(self) -> list[FloatArray]:
        """Return (3, 3 N) matrices M: forces are in the friction cones where ``M u`` are in second-order ones."""
        scale = np.diag([self.friction, 1.0, 1.0])
        return [np.asarray(np.kron(row[None, :], scale)) for row in np.eye(len(self.arms))]

    def extreme(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return ``max(0, v_n + mu |v_t|)`` over the points, (...), and the force (..., n) of that point alone."""
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
        """Return how the projections of ``z`` (m, n) are found, (m,): ``SLIPS``, ``INSIDE``, ..., or a map's number."""
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
        """The points asked for last, whose derivative is often asked for next."""
        return []

    def _most_work(self, v: FloatArray) -> FloatArray:
        """Return the largest ``v_n + mu |v_t|`` over the points, velocities (3 N, m) to (m,)."""
        v = v.reshape(len(self.arms), 3, -1)
        return np.asarray(np.max(v[:, 0] + self.friction * np.hypot(v[:, 1], v[:, 2]), axis=0, initial=-np.inf))

    def _scaled(self, flat: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return points outside the polar cone with projections near unit length, and the scale (m,)."""
        work = self._most_work(self.generators.T @ flat)
        share = np.where(work > 0.0, np.maximum(work, LEAST), 1.0)
        return flat / share, share

    def _nearest(self, z: FloatArray) -> _Nearest:
        """Return the nearest points of the polar cone to ``z`` (n, m)."""
        if self._last and np.array_equal(self._last[0][0], z):
            return self._last[0][1]
        parts = [self._some(z[:, a : a + CHUNK]) for a in range(0, max(1, z.shape[1]), CHUNK)]
        found = _Nearest(*(np.concatenate(part, axis=-1) for part in zip(*parts, strict=True)))
        self._last[:] = [(z, found)]
        return found

    def _some(self, z: FloatArray) -> _Nearest:
        """Return ``_nearest`` of not too many points."""
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
    """Return points (..., n) as columns of unit length, (n, m), zeros left alone, and their lengths."""
    flat = z.reshape(-1, z.shape[-1]).T
    most = np.max(np.abs(flat), axis=0, initial=0.0)
    most = np.where(most > 0.0, most, 1.0)
    length = np.linalg.norm(flat / most, axis=0)
    length = np.where(length > 0.0, length, 1.0)
    return flat / most / length, most * length
