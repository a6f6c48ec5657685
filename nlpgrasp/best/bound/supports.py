"""Supports of one contact over cells: the most work it does along twists from anywhere in them."""

from __future__ import annotations

import numpy as np

from nlpgrasp.best.bound.measure import Measure
from nlpgrasp.best.bound.wide import widened
from nlpgrasp.best.cells.base import Cell, IntArray, Rows
from nlpgrasp.common.spatial import tangents, wrench_transform
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts import ContactModel

NONE = -1  # in place of the number of a finer row
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
        self._cones = np.zeros((0, 2))
        self._frames = np.zeros((0, d, TORSION + 1))
        self.finer = np.zeros((0, 1), dtype=np.int64)
        self._bent = False
        self._used = 0
        self._tables: dict[int, tuple[Rows, int]] = {}
        self._numbers: list[IntArray] = []

    def add(self, cell: Cell) -> None:
        """Add the rows of a cell, those that it shares with others only once; it gets the next number."""
        shared = cell.part_of()
        if shared is None:
            rows = cell.rows()
            self._numbers.append(self._used + np.arange(len(rows.points)))
            self._append(rows)
            return
        table, numbers = shared
        if id(table) not in self._tables:
            self._tables[id(table)] = table, self._used
            self._append(table)
        self._numbers.append(self._tables[id(table)][1] + numbers)

    def _append(self, rows: Rows) -> None:
        m, space = rows.points.shape
        self._reserve(m)
        where = slice(self._used, self._used + m)
        self.points[where], self.normals[where] = rows.points, rows.normals
        self.maps[where] = self.maps_at(rows.points, rows.normals)
        if rows.cones is not None:
            self._cones[where] = rows.cones
            frames = np.concatenate([rows.normals[:, None], tangents(rows.normals)], axis=1).transpose(0, 2, 1)
            self._frames[where] = wrench_transform(rows.points - self.origin, frames)[..., : TORSION + 1]
        if rows.bends is not None:
            self._bent = True
            self._bends[where] = rows.bends
            world = np.broadcast_to(np.eye(space), (m, space, space))
            self._velocities[where] = wrench_transform(rows.points - self.origin, world)[..., :space]
        if rows.finer is not None:
            self._widen(rows.finer.shape[1])
            self.finer[where, : rows.finer.shape[1]] = np.where(rows.finer < 0, NONE, rows.finer + self._used)
        self._used += m

    def _widen(self, count: int) -> None:
        """Make room for so many finer rows in place of one."""
        more = count - self.finer.shape[1]
        if more > 0:
            self.finer = np.pad(self.finer, ((0, 0), (0, more)), constant_values=NONE)

    def maps_at(self, points: FloatArray, normals: FloatArray) -> FloatArray:
        """Return grasp maps of the contact at points with inward normals: (m, space) each to (m, d, n_i)."""
        frames = np.concatenate([normals[:, None], self.contact.tangents(normals)], axis=1).transpose(0, 2, 1)
        return wrench_transform(points - self.origin, frames) @ self.contact.basis(self.space)

    def _reserve(self, count: int) -> None:
        """Make room for some rows more."""
        if self._used + count <= len(self.points):
            return
        more = max(count, 256, len(self.points))
        for name in ("points", "normals", "maps", "_velocities", "_bends", "_cones", "_frames"):
            old: FloatArray = getattr(self, name)
            setattr(self, name, np.concatenate([old, np.zeros((more, *old.shape[1:]))]))
        self.finer = np.pad(self.finer, ((0, more), (0, 0)), constant_values=NONE)

    @property
    def refines(self) -> bool:
        """Whether there are rows that finer ones can replace."""
        return self.finer.shape[1] > 1

    def __len__(self) -> int:
        """Return how many cells were added."""
        return len(self._numbers)

    def count(self, cell: int) -> int:
        """Return how many rows a cell has."""
        return len(self._numbers[cell])

    def rows_of(self, cells: IntArray) -> IntArray:
        """Return the numbers of the rows of each cell (b,), the last repeated, (b, m)."""
        own = [self._numbers[c] for c in cells.tolist()]
        result = np.empty((len(own), max(len(numbers) for numbers in own)), dtype=np.int64)
        for row, numbers in zip(result, own, strict=True):
            row[: len(numbers)] = numbers
            row[len(numbers) :] = numbers[-1]
        return result

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
            support M of the part; ``M^p`` where that is less. Of rows with a cone, what ``best.bound.wide`` says.
        """
        wide = self._cones[rows, 1] > 0.0
        if not np.any(wide):
            return self._narrow(rows, twists)
        result = np.empty((*rows.shape, twists.shape[1]))
        owner = np.broadcast_to(np.arange(len(rows))[:, None], rows.shape)
        for where, make in ((wide, self._wide), (~wide, self._narrow)):
            if np.any(where):
                result[where] = make(rows[where][:, None], twists[owner[where]])[:, 0]
        return result

    def _narrow(self, rows: IntArray, twists: FloatArray) -> FloatArray:
        s = self.measure.support(self.contact, _work(self.maps[rows], twists))
        p = self.measure.power
        result = s**p
        if self._bent:
            velocity = np.linalg.norm(_work(self._velocities[rows], twists), axis=-1)
            turning = np.linalg.norm(twists[..., self.space :], axis=-1)[:, None, :]
            weights = self._bends[rows]
            linear = weights[..., 1] + self._turns * weights[..., 2]
            off, more = (weights[:, :, i, 0, None] * velocity + linear[:, :, i, None] * turning for i in (0, 1))
            most = s + self.steepness * more
            result = np.minimum(result + p * most ** (p - 1.0) * self.steepness * off, most**p)
        return np.asarray(result)

    def _wide(self, rows: IntArray, twists: FloatArray) -> FloatArray:
        z = _work(self._frames[rows], twists)[:, 0]
        turning = np.linalg.norm(twists[..., self.space :], axis=-1)
        cones = self._cones[rows[:, 0]]
        s = widened(self.contact, z, turning, cones[:, :1], cones[:, 1:])
        return np.asarray((self.steepness * s) ** self.measure.power)[:, None]


def _work(maps: FloatArray, twists: FloatArray) -> FloatArray:
    """Return ``G^T y``: maps (b, m, d, n) and twists (b, j, d) to (b, m, j, n)."""
    return np.asarray(twists[:, None] @ maps)
