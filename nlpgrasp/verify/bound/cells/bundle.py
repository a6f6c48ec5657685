"""Union of cells, and the constructor of cells from JSON data."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.verify.bound.cells.cell import Cell, Cut, Rows, Sheet
from nlpgrasp.verify.bound.cells.ellipsoid import Ellipsoid
from nlpgrasp.verify.bound.cells.polygon import Polygon
from nlpgrasp.verify.bound.cells.round import Revolved, Sector
from nlpgrasp.verify.check import NotMadeError


@dataclass(frozen=True)
class Bundle:
    """A union of cells.

    Parameters
    ----------
    data : mapping
        ``members``, cells.
    """

    data: Json

    @cached_property
    def members(self) -> list[Cell]:
        """The member cells."""
        return [cell_of(member) for member in self.data["members"]]

    def rows(self) -> Rows:
        """Return the vertex contacts of all members."""
        every = [member.rows() for member in self.members]
        return Rows(*(np.concatenate([getattr(rows, name) for rows in every]) for name in ("points", "normals")))

    def sheets(self) -> list[Sheet]:
        """Return the curved parts of all members."""
        return [sheet for member in self.members for sheet in member.sheets()]

    def parts(self, cut: Cut) -> tuple[Cell, Cell]:
        """Return the two bundles of a partition of the members."""
        count = len(self.members)
        if isinstance(cut, int) or len(cut) != 2 or not all(cut) or set(cut[0] + cut[1]) != set(range(count)):
            raise ValueError("a cut that does not share the members out")
        first, second = ([self.data["members"][i] for i in part] for part in cut)
        return self._of(first), self._of(second)

    def _of(self, members: list[Json]) -> Cell:
        return cell_of(members[0] if len(members) == 1 else {**self.data, "members": members})

    def hull(self) -> tuple[FloatArray, float]:
        """Return the points of all members, and the largest of their radii."""
        every = [member.hull() for member in self.members]
        return np.concatenate([points for points, _ in every]), max(radius for _, radius in every)

    def anchors(self) -> FloatArray:
        """Return the anchor points of all members."""
        return np.concatenate([member.anchors() for member in self.members])


KINDS: dict[str, Callable[[Json], Cell]] = {
    "polygon": Polygon,
    "ellipsoid": Ellipsoid,
    "sector": Sector,
    "revolved": Revolved,
    "bundle": Bundle,
}


def cell_of(data: Json) -> Cell:
    """Return the cell of its JSON data; raise ``NotMadeError`` on an unknown kind."""
    kind = KINDS.get(str(data["kind"]))
    if data["kind"] == "superquadric":
        raise NotMadeError("a bound of a superquadric, by an earlier version: superquadrics are not bounded any more")
    if kind is None:
        raise NotMadeError(f"nothing recomputes a cell of kind {data['kind']!r}")
    return kind(data)


def same_place(cell: Cell, other: Cell, image: FloatArray, tolerance: float) -> bool:
    """Return whether a cell is the image of another with transformed anchors (m, space), in any order."""
    if cell.data["kind"] != other.data["kind"]:
        return False
    if isinstance(cell, Bundle) and isinstance(other, Bundle):
        ends = np.cumsum([len(member.anchors()) for member in other.members])[:-1]
        moved = list(zip(other.members, np.split(image, ends), strict=True))
        one = all(any(same_place(m, o, i, tolerance) for m in cell.members) for o, i in moved)
        return one and all(any(same_place(m, o, i, tolerance) for o, i in moved) for m in cell.members)
    own = cell.anchors()
    if len(own) != len(image):
        return False
    apart = np.max(np.abs(own[:, None] - image[None]), axis=2)
    return bool(np.max(apart.min(axis=0)) <= tolerance and np.max(apart.min(axis=1)) <= tolerance)
