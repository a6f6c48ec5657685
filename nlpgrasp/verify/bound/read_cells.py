"""Surface cells of a global bound by kind, and unions of cells."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.verify.bound.stated_cells import (
    Cut,
    StatedCell,
    StatedCurvedFace,
    StatedEllipsoidCell,
    StatedPolygonCell,
    StatedRevolvedCell,
    StatedSectorCell,
    VertexContacts,
)
from nlpgrasp.verify.bound.stated_charts import StatedChartCell
from nlpgrasp.verify.check import NotCheckedError


@dataclass(frozen=True)
class StatedCellUnion:
    """Union of several cells.

    Parameters
    ----------
    data : mapping
        ``members``, cells.
    """

    data: Json

    @cached_property
    def members(self) -> list[StatedCell]:
        """The member cells."""
        return [read_cell(member) for member in self.data["members"]]

    def vertex_contacts(self) -> VertexContacts:
        """Return the vertex contacts of all members."""
        contacts = [member.vertex_contacts() for member in self.members]
        return VertexContacts(
            *(np.concatenate([getattr(part, name) for part in contacts]) for name in ("points", "normals"))
        )

    def curved_faces(self) -> list[StatedCurvedFace]:
        """Return the curved parts of all members."""
        return [face for member in self.members for face in member.curved_faces()]

    def parts(self, cut: Cut) -> tuple[StatedCell, StatedCell]:
        """Return the unions of the two sets into which the members are divided."""
        count = len(self.members)
        if isinstance(cut, int) or len(cut) != 2 or not all(cut) or set(cut[0] + cut[1]) != set(range(count)):
            raise ValueError("a cut that does not share the members out")
        first, second = ([self.data["members"][i] for i in part] for part in cut)
        return self._of(first), self._of(second)

    def _of(self, members: list[Json]) -> StatedCell:
        """Return the union of the given members, or the member itself if there is only one."""
        return read_cell(members[0] if len(members) == 1 else {**self.data, "members": members})

    def hull(self) -> tuple[FloatArray, float]:
        """Return the points of all members, and the largest of their distances."""
        hulls = [member.hull() for member in self.members]
        return np.concatenate([points for points, _ in hulls]), max(radius for _, radius in hulls)

    def anchors(self) -> FloatArray:
        """Return the anchor points of all members."""
        return np.concatenate([member.anchors() for member in self.members])


CELL_KINDS: dict[str, Callable[[Json], StatedCell]] = {
    "polygon": StatedPolygonCell,
    "ellipsoid": StatedEllipsoidCell,
    "sector": StatedSectorCell,
    "revolved": StatedRevolvedCell,
    "chart": StatedChartCell,
    "bundle": StatedCellUnion,
}


def read_cell(data: Json) -> StatedCell:
    """Return the cell of JSON data; raise ``NotCheckedError`` on an unknown kind."""
    kind = CELL_KINDS.get(str(data["kind"]))
    if kind is None:
        raise NotCheckedError(f"nothing recomputes a cell of kind {data['kind']!r}")
    return kind(data)


def is_image(cell: StatedCell, other: StatedCell, image: FloatArray, tolerance: float) -> bool:
    """Return whether a cell is the image of another cell under a motion.

    ``image`` (m, space) holds the other cell's anchor points after the motion; their order does not matter.
    """
    if cell.data["kind"] != other.data["kind"]:
        return False
    if isinstance(cell, StatedCellUnion) and isinstance(other, StatedCellUnion):
        ends = np.cumsum([len(member.anchors()) for member in other.members])[:-1]
        images = list(zip(other.members, np.split(image, ends), strict=True))
        is_covered = all(any(is_image(m, o, i, tolerance) for m in cell.members) for o, i in images)
        return is_covered and all(any(is_image(m, o, i, tolerance) for o, i in images) for m in cell.members)
    anchors = cell.anchors()
    if len(anchors) != len(image):
        return False
    distances = np.max(np.abs(anchors[:, None] - image[None]), axis=2)
    return bool(np.max(distances.min(axis=0)) <= tolerance and np.max(distances.min(axis=1)) <= tolerance)
