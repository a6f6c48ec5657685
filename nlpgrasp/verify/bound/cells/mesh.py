"""Cells of a mesh: ranges in an ordered list of subdivided triangles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.verify.bodies.triangles import TriangleSurface
from nlpgrasp.verify.bound.cells.cell import Cut, Rows, Sheet

SIDES = "012"


@dataclass(frozen=True)
class MeshCell:
    """A range of the pieces of a mesh's subdivided triangles.

    Parameters
    ----------
    data : mapping
        ``halved`` and ``order`` of the whole mesh, None for the original order (docs/how_close.md).
    corners : (n, 3, 3) array
        Corners of the ordered pieces, metres.
    normals : (n, 3) array
        Unit, into the body.
    first, last : int
        Range of the cell's pieces, the last excluded.
    """

    data: Json
    corners: FloatArray
    normals: FloatArray
    first: int
    last: int

    @classmethod
    def whole(cls, data: Json, mesh: TriangleSurface) -> MeshCell:
        """Return the cell of all pieces; raise ``ValueError`` where the data name pieces that do not exist."""
        corners, triangle = halved(mesh.corners, data["halved"])
        stated = data["order"]
        order = np.arange(len(corners)) if stated is None else np.array(stated, dtype=np.int64)
        if len(order) and not (order.min() >= 0 and order.max() < len(corners)):
            raise ValueError(f"pieces up to {order.max()}, of {len(corners)}")
        return cls({**data, "order": order.tolist()}, corners[order], -mesh.normals[triangle[order]], 0, len(order))

    def left_out(self, mesh: TriangleSurface) -> int:
        """Return the number of the mesh's pieces that the cell lacks."""
        count = len(halved(mesh.corners, self.data["halved"])[0])
        return count - len(set(map(int, self.data["order"][self.first : self.last])))

    def rows(self) -> Rows:
        """Return the corners with their pieces' normals: a convex function on a flat piece is largest at a corner."""
        points = self.corners[self.first : self.last].reshape(-1, 3)
        normals = np.repeat(self.normals[self.first : self.last], 3, axis=0)
        return Rows(points, normals)

    def sheets(self) -> list[Sheet]:
        """Return no curved parts."""
        return []

    def parts(self, cut: Cut) -> tuple[MeshCell, MeshCell]:
        """Return the first pieces, as many as the cut states, and the rest."""
        if not isinstance(cut, int) or not 0 < cut < self.last - self.first:
            raise ValueError(f"{cut} of {self.last - self.first} pieces")
        at = self.first + cut
        first = MeshCell(self.data, self.corners, self.normals, self.first, at)
        return first, MeshCell(self.data, self.corners, self.normals, at, self.last)

    def hull(self) -> tuple[FloatArray, float]:
        """Return the corners."""
        return self.anchors(), 0.0

    def anchors(self) -> FloatArray:
        """Return the corners."""
        return self.corners[self.first : self.last].reshape(-1, 3)


def halved(corners: FloatArray, rounds: Sequence[str]) -> tuple[FloatArray, np.ndarray]:
    """Return the pieces of subdivided triangles (t, 3, 3), and the triangle of each piece.

    In each round every piece has a character: the number of a corner if the side from that corner to the next is
    halved, any other if the piece stays. The half with the corner stays in place, the other half goes to the end.
    """
    pieces, triangle = [*corners], [*range(len(corners))]
    for row in rounds:
        if len(row) != len(pieces):
            raise ValueError(f"{len(row)} characters for {len(pieces)} pieces")
        for i, character in enumerate(row):
            if character in SIDES:
                start = SIDES.index(character)
                end, across = (start + 1) % 3, (start + 2) % 3
                p = pieces[i]
                middle = (p[start] + p[end]) / 2.0
                pieces[i] = np.array([p[start], middle, p[across]])
                pieces.append(np.array([middle, p[end], p[across]]))
                triangle.append(triangle[i])
    return np.array(pieces), np.array(triangle, dtype=np.int64)
