"""Supports of one contact over cells: the most work it does along twists from anywhere in them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.best.bound.measure import Measure
from nlpgrasp.best.cells.base import Cell
from nlpgrasp.common.spatial import wrench_transform
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts import ContactModel

IntArray = NDArray[np.int64]
TORSION = 3  # component of a contact-frame wrench that is the moment about the normal, in space


class Supports:
    """The rows of cells for one contact model, and what the contact does along twists from them.

    Parameters
    ----------
    contact : ContactModel
    measure : Measure
    origin : (space,) array
        Torque origin, metres, body frame.
    """

    def __init__(self, contact: ContactModel, measure: Measure, origin: FloatArray) -> None:
        space = len(origin)
        self.contact, self.measure, self.origin, self.space = contact, measure, origin, space
        components = contact.components(space)
        self.steepness = measure.steepness(contact, components)
        self._turns = float(space == 3 and TORSION in contact.axes(space))
        d = 3 if space == 2 else 6
        self.points = np.zeros((0, space))
        self.normals = np.zeros((0, space))
        self.maps = np.zeros((0, d, components))
        self._velocities = np.zeros((0, d, space))
        self._bends = np.zeros((0, 2, 3))
        self._bent = False
        self._used = 0
        self._starts: list[int] = []
        self._counts: list[int] = []

    def add(self, cell: Cell) -> None:
        """Add the rows of a cell; it gets the next number."""
        rows = cell.rows()
        m, space = rows.points.shape
        self._starts.append(self._used)
        self._counts.append(m)
        self._reserve(m)
        where = slice(self._used, self._used + m)
        self.points[where], self.normals[where] = rows.points, rows.normals
        self.maps[where] = self.maps_at(rows.points, rows.normals)
        if rows.bends is not None:
            self._bent = True
            world = np.broadcast_to(np.eye(space), (m, space, space))
            self._velocities[where] = wrench_transform(rows.points - self.origin, world)[..., :space]
            self._bends[where] = rows.bends
        self._used += m

    def maps_at(self, points: FloatArray, normals: FloatArray) -> FloatArray:
        """Return grasp maps of the contact at points with inward normals: (m, space) each to (m, d, n_i)."""
        frames = np.concatenate([normals[:, None], self.contact.tangents(normals)], axis=1).transpose(0, 2, 1)
        return wrench_transform(points - self.origin, frames) @ self.contact.basis(self.space)

    def _reserve(self, count: int) -> None:
        """Make room for some rows more."""
        if self._used + count <= len(self.points):
            return
        more = max(count, 256, len(self.points))
        for name in ("points", "normals", "maps", "_velocities", "_bends"):
            old: FloatArray = getattr(self, name)
            setattr(self, name, np.concatenate([old, np.zeros((more, *old.shape[1:]))]))

    def count(self, cell: int) -> int:
        """Return how many rows a cell has."""
        return self._counts[cell]

    def rows_of(self, cells: IntArray) -> IntArray:
        """Return the numbers of the rows of each cell (b,), the last repeated, (b, m)."""
        counts = np.array([self._counts[c] for c in cells.tolist()], dtype=np.int64)
        starts = np.array([self._starts[c] for c in cells.tolist()], dtype=np.int64)
        return starts[:, None] + np.minimum(np.arange(int(np.max(counts)))[None], counts[:, None] - 1)

    def powers(self, rows: IntArray, twists: FloatArray) -> FloatArray:
        """Return what no contact of the rows' parts exceeds along twists, to the measure's power.

        Parameters
        ----------
        rows : (b, m) array
        twists : (b, j, d) array

        Returns
        -------
        (b, m, j) array
            ``s^p + p M^(p-1) |x| Z``: with the most work Z that bends add, for a force x of one unit, and the largest
            support M of the part.
        """
        s = self.measure.support(self.contact, _work(self.maps[rows], twists))
        p = self.measure.power
        result = s**p
        if self._bent:
            velocity = np.linalg.norm(_work(self._velocities[rows], twists), axis=-1)
            turning = np.linalg.norm(twists[..., self.space :], axis=-1)[:, None, :]
            weights = self._bends[rows]
            linear = weights[..., 1] + self._turns * weights[..., 2]
            off, more = (weights[:, :, i, 0, None] * velocity + linear[:, :, i, None] * turning for i in (0, 1))
            result += p * (s + self.steepness * more) ** (p - 1.0) * self.steepness * off
        return np.asarray(result)


def _work(maps: FloatArray, twists: FloatArray) -> FloatArray:
    """Return ``G^T y``: maps (b, m, d, n) and twists (b, j, d) to (b, m, j, n)."""
    return np.asarray(twists[:, None] @ maps)
