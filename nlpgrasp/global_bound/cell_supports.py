"""Supports of one contact at the rows of its cells, and their combination by force budget.

A row is a point of the surface with its inward normal, where the contact's work along a twist is evaluated. The rows of
a flat cell bound the support all over the cell; curved cells also have parts between their rows (``CurvedParts``), over
which ``support_table`` bounds it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlpgrasp.budgets import ForceBudget, L2Budget, PerFingerBudget, PerFingerSizeBudget, SharedBudget
from nlpgrasp.common.spatial import wrench_transform
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts import ContactModel, Work
from nlpgrasp.errors import InputError
from nlpgrasp.global_bound.cells.cell import CurvedFace, IntArray, RepresentativeContacts, SmallCurvedParts, SurfaceCell

SHARED_POWER = 8.0  # power of the norm that bounds the largest of the contacts' supports from above
TORSION = 3  # component of a contact-frame wrench that is the moment about the normal, in space


@dataclass(frozen=True)
class Measure:
    """Rule ``phi_G(y)^p <= sum_i s_i(y)^p`` for the supports s_i of single contacts, exact but for a shared budget.

    Parameters
    ----------
    power : float
        p: 2 for the L2 budget, 1 for a unit of force a finger; 8 for a shared one, whose support is the largest s_i.
    lengths : bool
        Whether a contact's unit is the length of its force (``s = |P_K(z)|``) and not its normal force.
    exact : bool
        Whether the sum is the support itself.
    """

    power: float
    lengths: bool
    exact: bool = True

    @classmethod
    def of(cls, budget: ForceBudget) -> Measure:
        """Return the measure of a force budget.

        Raises
        ------
        InputError
            On a budget whose contacts' supports do not bound the grasp's: one of joint torques.
        """
        for kind, measure in MEASURES.items():
            if type(budget) is kind:
                return measure
        allowed = '"l2", "per_finger", "per_finger_size" or "shared" for a bound over all placements'
        raise InputError("force_budget", budget.kind, allowed)

    def support(self, contact: ContactModel, z: FloatArray) -> FloatArray:
        """Return s for force components z (..., n_i), at least zero, (...)."""
        if not self.lengths:
            return contact.extreme(z)[0]
        square = contact.squared_support(_work_sizes(contact, z), np)
        if square is None:
            return np.asarray(np.linalg.norm(contact.project(z), axis=-1))
        return np.asarray(np.sqrt(square))

    def powers(self, contact: ContactModel, z: FloatArray) -> FloatArray:
        """Return ``s^p`` for force components z (..., n_i), (...)."""
        found = self.powers_of(contact, _work_sizes(contact, z))
        return np.asarray(self.support(contact, z) ** self.power) if found is None else found

    def powers_of(self, contact: ContactModel, work: Work) -> FloatArray | None:
        """Return ``s^p`` for work along the normal, the surface and about the normal; None where it has no formula."""
        square = contact.squared_support(work, np) if self.lengths else None
        if square is None:
            return None
        return np.asarray(square if self.power == 2.0 else square ** (0.5 * self.power))

    def steepness(self, contact: ContactModel, components: int) -> float:
        """Return the Lipschitz constant of s in z: the length of the largest force of one unit."""
        if self.lengths:
            return 1.0
        return float(np.sqrt(1.0 + sum(c**2 for _, c in contact.blocks(components))))

    def combined(self, supports: FloatArray, axis: int) -> FloatArray:
        """Return the grasp's support from those of its contacts: exactly, for a shared budget too."""
        if not self.exact:
            return np.asarray(np.max(supports, axis=axis))
        return np.asarray(np.sum(supports**self.power, axis=axis) ** (1.0 / self.power))


MEASURES: dict[type[ForceBudget], Measure] = {
    L2Budget: Measure(2.0, lengths=True),
    PerFingerBudget: Measure(1.0, lengths=False),
    PerFingerSizeBudget: Measure(1.0, lengths=True),
    SharedBudget: Measure(SHARED_POWER, lengths=False, exact=False),
}


def _work_sizes(contact: ContactModel, z: FloatArray) -> Work:
    """Return the sizes of what z does along the normal, along the surface and about the normal."""
    space = 2 if z.shape[-1] == 2 else 3
    tangential = np.abs(z[..., 1]) if space == 2 else np.hypot(z[..., 1], z[..., 2]) if z.shape[-1] > 2 else np.zeros(1)
    torsion = np.abs(z[..., 3]) if z.shape[-1] > 3 else np.zeros(1)
    return Work(z[..., 0], tangential, torsion)


@dataclass(frozen=True)
class CurvedParts:
    """Parts of a cell between its rows on one curved face, with their bends.

    Parameters
    ----------
    patches : CurvedFace
    parts : (n, c, q) array
        Coordinates of each part's corners.
    rows : (n, c) array of int
        Which of the cell's rows is at each corner.
    bends : (n, 2, 3) array
        Of each part.
    most : (2, 3) array
        The largest of these.
    """

    patches: CurvedFace
    parts: FloatArray
    rows: IntArray
    bends: FloatArray
    most: FloatArray

    @classmethod
    def parts_of_cell(cls, curved: SmallCurvedParts) -> CurvedParts:
        """Return the parts of a cell with their bends."""
        bends = curved.patches.bends(curved.parts)
        return cls(curved.patches, curved.parts, curved.rows, bends, np.max(bends, axis=0))


class Supports:
    """Rows of cells for one contact model, and its supports along twists from them.

    Parameters
    ----------
    contact : ContactModel
    measure : Measure
    origin : (space,) array
        Torque origin, metres, body frame.

    Attributes
    ----------
    looked : int
        Supports inside curved cells evaluated so far, most of a search's effort.
    """

    def __init__(self, contact: ContactModel, measure: Measure, origin: FloatArray) -> None:
        space = len(origin)
        self.contact, self.measure, self.origin, self.space = contact, measure, origin, space
        components = contact.components(space)
        self.steepness = measure.steepness(contact, components)
        self.turns = float(space == 3 and TORSION in contact.axes(space))
        d = 3 if space == 2 else 6
        self.points = np.zeros((0, space))
        self.normals = np.zeros((0, space))
        self.maps = np.zeros((0, d, components))
        self._used = 0
        self._numbers: list[IntArray] = []
        self.curved: list[tuple[CurvedParts, ...]] = []
        self._balls: list[tuple[FloatArray, float]] = []
        self.looked = 0
        self.widest, self.bent = 0.0, False  # radius of the largest cell; whether any has curved parts

    def add(self, cell: SurfaceCell) -> None:
        """Add the rows of a cell, which gets the next number."""
        rows = cell.rows()
        self._balls.append(cell.ball())
        self.widest = max(self.widest, self._balls[-1][1])
        self._numbers.append(self._used + np.arange(len(rows.points)))
        self.curved.append(tuple(CurvedParts.parts_of_cell(curved) for curved in rows.curved))
        self.bent = self.bent or bool(rows.curved)
        self._append(rows)

    def _append(self, rows: RepresentativeContacts) -> None:
        m = len(rows.points)
        self._reserve(m)
        where = slice(self._used, self._used + m)
        self.points[where], self.normals[where] = rows.points, rows.normals
        self.maps[where] = self.maps_at(rows.points, rows.normals)
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
        for name in ("points", "normals", "maps"):
            old: FloatArray = getattr(self, name)
            setattr(self, name, np.concatenate([old, np.zeros((more, *old.shape[1:]))]))

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

    def speeds(self, cells: IntArray, twists: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return ``|v|`` at most anywhere in cells (c,), and ``|tau|``, along twists (c, j, 6), (c, j) each."""
        balls = [self._balls[c] for c in cells.tolist()]
        arms = np.stack([centre for centre, _ in balls])[:, None] - self.origin
        turning = np.sqrt(np.sum(twists[..., 3:] ** 2, axis=2))
        middle = np.sqrt(np.sum((twists[..., :3] + np.cross(twists[..., 3:], arms)) ** 2, axis=2))
        return middle + self.radii(cells)[:, None] * turning, turning

    def radii(self, cells: IntArray) -> FloatArray:
        """Return the radii of balls around cells (c,), metres, (c,)."""
        return np.array([self._balls[c][1] for c in cells.tolist()])

    def at(
        self, points: FloatArray, normals: FloatArray, twists: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return what contacts anywhere do: ``s^p``, ``|v|`` and ``|tau|``.

        Parameters
        ----------
        points, normals : (n, v, 3) arrays
            Metres; unit, into the body.
        twists : (n, j, 6) array

        Returns
        -------
        powers, speed : (n, v, j) arrays
        turning : (n, j) array
        """
        fx, fy, fz, tx, ty, tz = np.moveaxis(twists, 2, 0)[:, :, None]
        x, y, z = np.moveaxis(points - self.origin, 2, 0)[..., None]
        nx, ny, nz = np.moveaxis(normals, 2, 0)[..., None]
        vx, vy, vz = fx + ty * z - tz * y, fy + tz * x - tx * z, fz + tx * y - ty * x
        along = vx * nx + vy * ny + vz * nz
        square = vx**2 + vy**2 + vz**2
        across = np.sqrt(np.maximum(square - along**2, 0.0))
        about = tx * nx + ty * ny + tz * nz if self.maps.shape[2] > 3 else np.zeros(1)
        powers = self.measure.powers_of(self.contact, Work(along, across, np.abs(about)))
        if powers is None:
            work = np.stack(np.broadcast_arrays(along, across, 0.0, about), axis=3)[..., : self.maps.shape[2]]
            powers = self.measure.powers(self.contact, work)
        turning = np.sqrt(np.sum(twists[..., 3:] ** 2, axis=2))
        return powers, np.sqrt(square), turning

    def powers(self, rows: IntArray, twists: FloatArray) -> FloatArray:
        """Return what contacts do along twists, to the measure's power.

        Parameters
        ----------
        rows : (b, m) array
        twists : (b, j, d) array

        Returns
        -------
        (b, m, j) array
            ``s^p`` of each row.
        """
        return self.measure.powers(self.contact, _contact_work(self.maps[rows], twists))


def _contact_work(maps: FloatArray, twists: FloatArray) -> FloatArray:
    """Return ``G^T y``: maps (b, m, d, n) and twists (b, j, d) to (b, m, j, n)."""
    return np.asarray(twists[:, None] @ maps)
