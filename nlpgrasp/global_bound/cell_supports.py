"""Support functions of single contacts at the representative contacts of cells, and their combination by budget.

A row is a surface point with its inward normal. The rows of a flat cell bound the support all over the cell; curved
cells also have parts between their rows (``CurvedParts``), over which ``support_table`` bounds it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.budgets import ForceBudget, L2Budget, PerFingerBudget, PerFingerSizeBudget, SharedBudget
from nlpgrasp.common.spatial import wrench_transform
from nlpgrasp.common.validation import FloatArray, IntArray
from nlpgrasp.contacts import ContactModel, Work
from nlpgrasp.errors import NotCoveredError
from nlpgrasp.global_bound.cells.cell import CurvedParts, SurfaceCell

SEARCH_POWER = 32.0  # power of the norm that replaces the largest of the contacts' supports in searches for directions
THRESHOLDS = (0.5, 0.7, 0.9)  # thresholds of successive rounds, over the bound to be lowered
DIGITS = 8  # decimal digits of thresholds
MAPPED = 4096  # contacts whose grasp maps are computed together; all corners of a scan at once would take 50 MB
TORSION = 3  # component of a contact-frame wrench that is the moment about the normal, in space; beyond it tilting

Powers = TypeVar("Powers", bound=FloatArray | NDArray[np.float32])


@dataclass(frozen=True)
class CombinationRule:
    """Rule by which a force budget combines the contacts' supports s_i to the grasp's support phi_G.

    It is ``phi_G^p = sum_i s_i^p``, or under the shared budget ``phi_G = max_i s_i``. For any threshold theta that
    maximum is at most ``theta + sum_i (s_i - theta)_+``, a sum over contacts again, and tight where one s_i alone
    exceeds theta.

    Parameters
    ----------
    power : float
        p: 2 for the L2 budget, else 1.
    lengths : bool
        Whether a contact's unit is the length of its force (``s = |P_K(z)|``) and not its normal force.
    takes_largest : bool
        Whether the support is the largest s_i instead of the sum.
    """

    power: float
    lengths: bool
    takes_largest: bool = False

    @classmethod
    def of(cls, budget: ForceBudget) -> CombinationRule:
        """Return the combination rule of a force budget.

        Raises
        ------
        NotCoveredError
            On a budget whose contacts' supports do not bound the grasp's: one of joint torques.
        """
        for kind, rule in COMBINATION_RULES.items():
            if type(budget) is kind:
                return rule
        allowed = '"l2", "per_finger", "per_finger_size" or "shared" for a bound over all placements'
        raise NotCoveredError("force_budget", budget.kind, allowed)

    def support(self, contact: ContactModel, z: FloatArray) -> FloatArray:
        """Return a contact's support s, at least zero, (...), for work z (..., n_i) along its force components."""
        if not self.lengths:
            return contact.extreme(z)[0]
        square = contact.squared_support(_work_sizes(contact, z), np)
        if square is None:
            return np.asarray(np.linalg.norm(contact.project(z), axis=-1))
        return np.asarray(np.sqrt(square))

    def powers(self, contact: ContactModel, z: FloatArray) -> FloatArray:
        """Return the power ``s^p`` of a contact's support, (...), for work z (..., n_i) along its force components."""
        powers = self.powers_of(contact, _work_sizes(contact, z))
        return np.asarray(self.support(contact, z) ** self.power) if powers is None else powers

    def powers_of(self, contact: ContactModel, work: Work) -> FloatArray | None:
        """Return ``s^p`` from the work along the normal, along the surface and about the normal.

        None without closed form.
        """
        square = contact.squared_support(work, np) if self.lengths else None
        if square is None:
            return None
        return np.asarray(square if self.power == 2.0 else square ** (0.5 * self.power))

    def has_closed_form(self, contact: ContactModel) -> bool:
        """Return whether a contact's support has a closed form, so that no projections are needed."""
        return not self.lengths or contact.squared_support(Work(0.0, 0.0, 0.0), np) is not None

    def lipschitz(self, contact: ContactModel, space: int) -> tuple[float, float]:
        """Return the Lipschitz constants of s in the force and moment parts of z.

        These are the lengths of the force, and of the moment in metres, of the largest contact force of one unit: with
        ``|f_t| <= c f_n`` and ``|m| <= r f_n`` they are ``sqrt(1 + c^2)`` and r per unit of normal force, 1 and
        ``r / sqrt(1 + r^2)`` per unit of length.
        """
        axes, squares = contact.axes(space), [1.0, 0.0]
        for block, c in contact.blocks(len(axes)):
            squares[axes[block.start] >= space] += c**2
        force, moment = np.sqrt(squares).tolist()
        return (1.0, moment / float(np.hypot(1.0, moment))) if self.lengths else (force, moment)

    @property
    def search_power(self) -> float:
        """Power p of the sum ``sum_i s_i^p`` that a search for weak directions minimises.

        Under the shared budget a large power stands for the maximum.
        """
        return SEARCH_POWER if self.takes_largest else self.power

    def excess(self, powers: Powers, thresholds: FloatArray | float) -> Powers:
        """Return the excess ``(s - theta)_+`` of supports over thresholds, or ``s^p`` for rules without thresholds."""
        return cast("Powers", np.maximum(powers - thresholds, 0.0)) if self.takes_largest else powers

    def thresholds(self, bounds: FloatArray, round_number: int) -> FloatArray:
        """Return the thresholds (b,) on supports in a round: a fraction of current bounds (b,) on mu.

        The fraction changes from round to round. Under budgets other than the shared one thresholds are zero.
        """
        if not self.takes_largest:
            return np.zeros(len(bounds))
        return np.asarray(np.round(THRESHOLDS[round_number % len(THRESHOLDS)] * bounds, DIGITS))


COMBINATION_RULES: dict[type[ForceBudget], CombinationRule] = {
    L2Budget: CombinationRule(2.0, lengths=True),
    PerFingerBudget: CombinationRule(1.0, lengths=False),
    PerFingerSizeBudget: CombinationRule(1.0, lengths=True),
    SharedBudget: CombinationRule(1.0, lengths=False, takes_largest=True),
}


def _work_sizes(contact: ContactModel, z: FloatArray) -> Work:
    """Return the work along the normal, and the absolute work along the surface and about the normal."""
    space = 2 if z.shape[-1] == 2 else 3
    tangential = np.abs(z[..., 1]) if space == 2 else np.hypot(z[..., 1], z[..., 2]) if z.shape[-1] > 2 else np.zeros(1)
    torsion = np.abs(z[..., 3]) if z.shape[-1] > 3 else np.zeros(1)
    return Work(z[..., 0], tangential, torsion)


class Supports:
    """Support function of one contact model at the representative contacts (rows) of cells.

    Parameters
    ----------
    contact : ContactModel
        The same in all directions around the normal (``ContactModel.isotropic_relaxation``).
    rule : CombinationRule
    origin : (space,) array
        Torque origin, metres, body frame.

    Attributes
    ----------
    evaluations : int
        Number of supports evaluated inside curved cells so far, most of a search's effort.
    largest_radius : float
        Radius of the largest cell, metres.
    has_curved : bool
        Whether any cell has curved parts.
    """

    def __init__(self, contact: ContactModel, rule: CombinationRule, origin: FloatArray) -> None:
        space = len(origin)
        self.contact, self.rule, self.origin, self.space = contact, rule, origin, space
        components = contact.components(space)
        self.lipschitz = rule.lipschitz(contact, space)
        d = 3 if space == 2 else 6
        self.points = np.zeros((0, space))
        self.normals = np.zeros((0, space))
        self.maps = np.zeros((0, d, components))
        self._row_count = 0
        self._rows: list[IntArray] = []
        self.curved: list[tuple[CurvedParts, ...]] = []
        self.balls: list[tuple[FloatArray, float]] = []
        self.evaluations, self.largest_radius, self.has_curved = 0, 0.0, False

    def add(self, cell: SurfaceCell) -> None:
        """Add the representative contacts of a cell, which gets the next index."""
        contacts = cell.representative_contacts()
        self.balls.append(cell.ball())
        self.largest_radius = max(self.largest_radius, self.balls[-1][1])
        self.curved.append(contacts.curved)
        self.has_curved = self.has_curved or bool(contacts.curved)
        rows = self._row_count + np.arange(len(contacts.points))
        self._rows.append(rows)
        self._reserve(len(rows))
        self.points[rows], self.normals[rows] = contacts.points, contacts.normals
        self.maps[rows] = self.maps_at(contacts.points, contacts.normals)
        self._row_count += len(rows)

    def maps_at(self, points: FloatArray, normals: FloatArray) -> FloatArray:
        """Return grasp maps (m, d, n_i) of the contact at points with inward normals, (m, space) each."""
        basis = self.contact.basis(self.space)
        maps = np.empty((len(points), *basis.shape))
        for begin in range(0, len(points), MAPPED):
            block = slice(begin, begin + MAPPED)
            tangents = self.contact.tangents(normals[block])
            frames = np.concatenate([normals[block, None], tangents], axis=1).transpose(0, 2, 1)
            maps[block] = wrench_transform(points[block] - self.origin, frames) @ basis
        return maps

    def _reserve(self, count: int) -> None:
        """Allocate memory for ``count`` further representative contacts."""
        if self._row_count + count <= len(self.points):
            return
        more = max(count, 256, len(self.points))
        for name in ("points", "normals", "maps"):
            values: FloatArray = getattr(self, name)
            setattr(self, name, np.concatenate([values, np.zeros((more, *values.shape[1:]))]))

    def count(self, cell: int) -> int:
        """Return the number of representative contacts of a cell."""
        return len(self._rows[cell])

    def rows_of(self, cells: IntArray) -> IntArray:
        """Return the indices (b, m) of the representative contacts of cells (b,).

        A cell with fewer than m repeats its last one.
        """
        rows = [self._rows[c] for c in cells.tolist()]
        result = np.empty((len(rows), max(map(len, rows))), dtype=np.int64)
        for padded, indices in zip(result, rows, strict=True):
            padded[: len(indices)] = indices
            padded[len(indices) :] = indices[-1]
        return result

    def speed_bounds(self, cells: IntArray, twists: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return upper bounds on speeds within cells (c,) under twists (c, j, 6), and angular speeds, (c, j) each."""
        arms = np.stack([self.balls[c][0] for c in cells.tolist()])[:, None] - self.origin
        turning = np.sqrt(np.sum(twists[..., 3:] ** 2, axis=2))
        at_centre = np.sqrt(np.sum((twists[..., :3] + np.cross(twists[..., 3:], arms)) ** 2, axis=2))
        return at_centre + self.radii(cells)[:, None] * turning, turning

    def radii(self, cells: IntArray) -> FloatArray:
        """Return the radii (c,), metres, of the balls that contain cells (c,)."""
        return np.array([self.balls[c][1] for c in cells.tolist()])

    def evaluate(
        self, points: FloatArray, normals: FloatArray, twists: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return powers ``s^p`` of supports, speeds and angular speeds of contacts at any points for given twists.

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
        turning, axes = np.sqrt(np.sum(twists[..., 3:] ** 2, axis=2)), self.contact.axes(3)
        about = tx * nx + ty * ny + tz * nz if axes[-1] >= TORSION else np.zeros(1)
        powers = self.rule.powers_of(self.contact, Work(along, across, np.abs(about)))
        if powers is None:
            tilting = np.sqrt(np.maximum(turning[:, None] ** 2 - about**2, 0.0))
            parts = np.broadcast_arrays(along, across, 0.0, about, tilting, 0.0)
            powers = self.rule.powers(self.contact, np.stack([parts[axis] for axis in axes], axis=3))
        return powers, np.sqrt(square), turning

    def powers(self, rows: IntArray, twists: FloatArray) -> FloatArray:
        """Return the powers ``s^p`` (b, m, j) at representative contacts (b, m) along twists (b, j, d)."""
        return self.rule.powers(self.contact, twists[:, None] @ self.maps[rows])
