"""Projection onto the polar cone if one or two points stick: a finite set of linear maps.

Read the projection q of z onto the polar cone as the body's motion. A loaded point then either sticks,
``A_i^T q = 0``, or slips, and ``z - q = sum_i A_i u_i``. Where a point sticks the body turns about it, so the slip
directions of all others follow from the sign of that turn. Hence (docs/paper/02_contacts.md):

* If one point sticks and those of a set S slip with forces ``l_j a_j``, ``(u_i, l_S)`` is the least-squares solution
  of ``A_i u_i + sum_S a_j l_j = z``. It is optimal if u_i is in the friction cone, ``l_S >= 0`` and q is in the polar
  cone.
* If two points stick, q is a rotation about the line through both, or zero without others; ``z - q`` has to be a
  wrench of two friction contacts, whose forces are unique but for the friction along the line, shared by both.
* If three or more stick, q is zero.

In each case q is in the polar cone, z - q in the cone, and both are orthogonal: conditions that only the projection
meets.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.common.validation import FloatArray

RANK = 1e-9  # relative rank tolerance
ROUNDING = 1e-14  # relative tolerance of the conditions on the velocities
NONE = -1


class Sticking:
    """Projection maps for points with generators A (n, 3 N) at ``arms`` (N, 2) and equal friction."""

    def __init__(self, generators: FloatArray, arms: FloatArray, friction: float) -> None:
        self._generators, self._arms, self._friction = generators, arms, friction
        one = [self._one(i, sign, others) for i, sign, others in self._patterns()]
        two = [found for pair in combinations(range(len(arms)), 2) if (found := self._two(*pair)) is not None]
        rows = max(len(force) for force, _ in one)
        padded = [np.pad(force, [(0, rows - len(force)), (0, 0)]) for force, _ in one]
        self._alone, self._pairs = np.stack(padded), np.stack([force for force, _ in two])
        self.maps = np.stack([kept for _, kept in (*one, *two)])  # z to z - q, each (n, n)

    def find(self, z: FloatArray) -> NDArray[np.intp]:
        """Return the indices (m,) of the ``maps`` that project points (n, m); ``NONE`` if none does."""
        mu, count = self._friction, z.shape[1]
        force = (self._alone.reshape(-1, len(z)) @ z).reshape(*self._alone.shape[:2], count)
        good = np.all(force[:, [0, *range(3, force.shape[1])]] >= 0.0, axis=1)
        good &= force[:, 1] ** 2 + force[:, 2] ** 2 <= (mu * force[:, 0]) ** 2
        force = (self._pairs.reshape(-1, len(z)) @ z).reshape(len(self._pairs), 5, count)
        room, across = mu * force[:, :2], np.abs(force[:, 2:4])
        along = np.sqrt(np.maximum((room - across) * (room + across), 0.0)).sum(axis=1)
        both = np.all(room >= across, axis=1) & (np.abs(force[:, 4]) <= along)
        which, where = np.nonzero(np.concatenate([good, both]))
        some = z[:, where]
        q = some - np.matmul(self.maps[which], some.T[..., None])[..., 0].T
        v = (self._generators.T @ q).reshape(len(self._arms), 3, -1)
        work = np.max(v[:, 0] + mu * np.hypot(v[:, 1], v[:, 2]), axis=0)
        meets = work <= ROUNDING * (1.0 + np.sqrt(np.sum(some**2, axis=0)))
        result = np.full(count, NONE)
        result[where[meets]] = which[meets]
        return result

    def _patterns(self) -> list[tuple[int, float, tuple[int, ...]]]:
        """Return all patterns: the sticking point, the sign of the turn about it, and the slipping points."""
        every, count = range(len(self._arms)), self._generators.shape[0] - 3
        result: list[tuple[int, float, tuple[int, ...]]] = []
        for i in every:
            others = [j for j in every if j != i]
            result.append((i, 1.0, ()))
            result += [
                (i, sign, some) for sign in (1.0, -1.0) for m in range(1, count) for some in combinations(others, m)
            ]
        return result

    def _one(self, i: int, sign: float, others: tuple[int, ...]) -> tuple[FloatArray, FloatArray]:
        """Return the matrices that map z to ``(u_i, l_S)`` and to ``z - q`` for one sticking point."""
        columns = [self._part(i)]
        for j in others:
            first, second = self._arms[j] - self._arms[i]
            slip = sign * self._friction / np.hypot(first, second)
            columns.append(self._part(j) @ np.array([[1.0], [-slip * second], [slip * first]]))
        span = np.concatenate(columns, axis=1)
        force = np.asarray(np.linalg.pinv(span, rcond=RANK))
        return force, span @ force

    def _two(self, i: int, j: int) -> tuple[FloatArray, FloatArray] | None:
        """Return the matrices that map z to the forces of two sticking points (5, n) and to ``z - q``.

        The forces are both normal forces, both across the line, and their sum along it. None if other points lie on
        both sides of the line, about which the body then cannot turn.
        """
        middle = 0.5 * (self._arms[i] + self._arms[j])
        apart = self._arms[j] - self._arms[i]
        length = float(np.hypot(*apart))
        e = apart / length
        side = (self._arms - middle) @ np.array([-e[1], e[0]])
        if np.min(side) < -RANK * length and np.max(side) > RANK * length:
            return None
        forces = np.concatenate([self._part(i), self._part(j)], axis=1)
        inverse = np.asarray(np.linalg.pinv(forces, rcond=RANK))
        turn = np.zeros((5, 6))
        turn[0, 0] = turn[1, 3] = 1.0
        turn[2, 1:3] = turn[3, 4:6] = -e[1], e[0]
        turn[4, 1:3] = turn[4, 4:6] = e
        return turn @ inverse, forces @ inverse

    def _part(self, i: int) -> FloatArray:
        return self._generators[:, 3 * i : 3 * i + 3]
