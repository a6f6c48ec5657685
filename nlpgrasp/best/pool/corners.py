"""Mixed supports of one contact at all corners of a mesh's triangles at once."""

from __future__ import annotations

import numpy as np

from nlpgrasp.best.bound.supports import TORSION, Supports
from nlpgrasp.best.cells.base import IntArray
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts import Work

CHUNK = 150_000  # corners times directions at a time: what a processor's cache holds


class Corners:
    """Contacts at some rows, with what their work is made of as products of matrices.

    With the arm a from the torque origin and the inward normal n the work along the normal is
    ``n . f + (a x n) . tau``, and the squared velocity ``|f + tau x a|^2`` is linear in 1, a and the products of a's
    components. The rest is across the normal.

    Parameters
    ----------
    supports : Supports
        Of which these rows are.
    rows : slice or (m,) array
    """

    def __init__(self, supports: Supports, rows: slice | IntArray) -> None:
        self.supports = supports
        points, normals = supports.points[rows], supports.normals[rows]
        arms = points - supports.origin
        self._along = np.ascontiguousarray(np.concatenate([normals, np.cross(arms, normals)], axis=1).T)
        self._arms, self._normals = np.ascontiguousarray(arms.T), np.ascontiguousarray(normals.T)
        self._maps = np.ascontiguousarray(supports.maps[rows].transpose(1, 0, 2))
        x, y, z = self._arms
        self._products = np.stack([np.ones_like(x), x, y, z, x * x, y * y, z * z, x * y, y * z, z * x])
        self.torsion = TORSION in supports.contact.axes(3)

    def __len__(self) -> int:
        """Return how many rows there are."""
        return int(self._along.shape[1])

    def mixed(self, twists: FloatArray, weights: FloatArray) -> FloatArray:
        """Return ``sum over j of w_j s^p`` at every row, (m,), for twists (j, 6) and weights (j,)."""
        result = np.empty(len(self))
        squares = _squares(twists)
        step = max(1, CHUNK // len(twists))
        for begin in range(0, len(self), step):
            part = slice(begin, begin + step)
            result[part] = weights @ self._powers(twists, squares, part)
        return result

    def _powers(self, twists: FloatArray, squares: FloatArray, part: slice) -> FloatArray:
        """Return ``s^p`` of some rows along twists, (j, m)."""
        contact, measure = self.supports.contact, self.supports.measure
        along = twists @ self._along[:, part]
        if measure.lengths:  # the square is as exact as its parts, though what is across the normal may not be
            across = squares @ self._products[:, part]
            across -= along**2
            across = np.sqrt(np.maximum(across, 0.0, out=across), out=across)
            square = contact.squared_support(self._work(along, across, twists, part), np)
            if square is not None:
                return np.asarray(square if measure.power == 2.0 else square ** (0.5 * measure.power))
        z = (twists @ self._maps[:, part].reshape(6, -1)).reshape(len(twists), -1, self._maps.shape[2])
        return np.asarray(measure.support(contact, z) ** measure.power)

    def _work(self, along: FloatArray, across: FloatArray, twists: FloatArray, part: slice) -> Work:
        if not self.torsion:
            return Work(along, across, np.zeros(1))
        return Work(along, across, np.abs(twists[:, 3:] @ self._normals[:, part]))


def _squares(twists: FloatArray) -> FloatArray:
    """Return what ``|f + tau x a|^2`` has of 1, a, the squares of a's components and their products, (j, 10)."""
    force, (x, y, z) = twists[:, :3], twists[:, 3:].T
    square = x * x + y * y + z * z
    parts = [square - x * x, square - y * y, square - z * z, -2.0 * x * y, -2.0 * y * z, -2.0 * z * x]
    once = 2.0 * np.cross(force, twists[:, 3:])
    return np.column_stack([np.sum(force**2, axis=1), once, *parts])
