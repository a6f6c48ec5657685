"""Weighted supports of one contact at all corners of a mesh's triangles at once."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts import Work
from nlpgrasp.global_bound.bound.supports import TORSION, Supports
from nlpgrasp.global_bound.cells.base import IntArray

CHUNK = 80_000  # corners times directions at a time: what a processor's cache holds
EVERY = slice(0, None)

Numbers = FloatArray | NDArray[np.float32]


class Corners:
    """Contacts at mesh corners, whose work is evaluated by matrix products.

    With the arm a from the middle of all rows and the inward normal n, the twist's force part taken about that middle,
    the work along the normal is ``n . f + (a x n) . tau``, and the squared velocity ``|f + tau x a|^2`` is linear in 1,
    a and the products of a's components. The rest is across the normal.

    Parameters
    ----------
    supports : Supports
        Of which these rows are.
    rows : slice or (m,) array
    single : bool
        Whether single precision is enough.
    """

    def __init__(self, supports: Supports, rows: slice | IntArray, single: bool = False) -> None:
        self.supports, self._type = supports, np.dtype(np.float32 if single else np.float64)
        points, normals = supports.points[rows], supports.normals[rows]
        middle = points.mean(axis=0)
        self._arm, arms = middle - supports.origin, points - middle
        x, y, z = arms.T
        self._along = self._made(np.concatenate([normals, np.cross(arms, normals)], axis=1).T)
        self._products = self._made(np.stack([np.ones_like(x), x, y, z, x * x, y * y, z * z, x * y, y * z, z * x]))
        self._normals = self._made(normals.T)
        self._maps = self._made(supports.maps_at(points - self._arm, normals).transpose(1, 0, 2))
        self.torsion = TORSION in supports.contact.axes(3)

    def __len__(self) -> int:
        """Return how many rows there are."""
        return int(self._along.shape[1])

    def _made(self, values: FloatArray) -> Numbers:
        return np.ascontiguousarray(values, dtype=self._type)

    def mixed(self, twists: FloatArray, weights: FloatArray, part: slice = EVERY) -> FloatArray:
        """Return ``sum over j of w_j s^p`` at rows, (m,), for twists (j, 6) and weights (j,)."""
        first, last, _ = part.indices(len(self))
        result = np.empty(last - first)
        moved = np.concatenate([twists[:, :3] + np.cross(twists[:, 3:], self._arm), twists[:, 3:]], axis=1)
        own, squares, shares = self._made(moved), self._made(_squares(moved)), self._made(weights)
        step = max(1, CHUNK // len(twists))
        for begin in range(first, last, step):
            end = min(last, begin + step)
            result[begin - first : end - first] = shares @ self._powers(own, squares, slice(begin, end))
        return result

    def _powers(self, twists: Numbers, squares: Numbers, part: slice) -> Numbers:
        """Return ``s^p`` at some rows along twists, (j, m)."""
        contact, measure = self.supports.contact, self.supports.measure
        if measure.lengths:  # the square is as exact as its parts, though what is across the normal may not be
            along = twists @ self._along[:, part]
            across = squares @ self._products[:, part]
            across -= along**2
            across = np.sqrt(np.maximum(across, 0.0, out=across), out=across)
            square = contact.squared_support(self._work(along, across, twists, part), np)
            if square is not None:
                return np.asarray(square if measure.power == 2.0 else square ** (0.5 * measure.power))
        maps = self._maps[:, part]
        z = (twists @ maps.reshape(6, -1)).reshape(len(twists), -1, maps.shape[2])
        return np.asarray(measure.support(contact, np.asarray(z, dtype=float)) ** measure.power)

    def _work(self, along: Numbers, across: Numbers, twists: Numbers, part: slice) -> Work:
        if not self.torsion:
            return Work(along, across, np.zeros(1))
        return Work(along, across, np.abs(twists[:, 3:] @ self._normals[:, part]))


def _squares(twists: FloatArray) -> FloatArray:
    """Return the coefficients of ``|f + tau x a|^2`` in 1, a, and the products of a's components, (j, 10)."""
    force, (x, y, z) = twists[:, :3], twists[:, 3:].T
    square = x * x + y * y + z * z
    parts = [square - x * x, square - y * y, square - z * z, -2.0 * x * y, -2.0 * y * z, -2.0 * z * x]
    once = 2.0 * np.cross(force, twists[:, 3:])
    return np.column_stack([np.sum(force**2, axis=1), once, *parts])
