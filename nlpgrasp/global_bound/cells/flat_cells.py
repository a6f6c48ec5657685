"""Cells of flat faces: convex polygons and segments, bounded by their vertices."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from nlpgrasp.common.spatial import tangents
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.global_bound.cells.cell import CellFace, RepresentativeContacts, SurfaceCell

ROUNDING = 1e-9  # relative: extents that differ by less are equal, so that mirror images are cut alike


class PolygonCell(SurfaceCell):
    """A convex polygon of a flat face, or a segment of a straight edge.

    The normal is the same everywhere, so the work is linear in the point: its convex functions are largest at a vertex.

    Parameters
    ----------
    vertices : (m, space) array
        In order around the polygon; two of a segment. Metres, body frame.
    normal : (space,) array
        Unit, into the body.
    axes : (space - 1, space) array
        Unit, along which it is cut.
    """

    kind: ClassVar[str] = "polygon"

    def __init__(self, vertices: FloatArray, normal: FloatArray, axes: FloatArray) -> None:
        self.vertices, self.normal, self.axes = vertices, normal, axes

    def rows(self) -> RepresentativeContacts:
        """Return the vertices."""
        return RepresentativeContacts(self.vertices, np.broadcast_to(self.normal, self.vertices.shape))

    def split(self) -> tuple[PolygonCell, PolygonCell]:
        """Return both halves of the longer extent along the axes."""
        i = self.cut()
        along = self.axes[i] @ self.vertices.T
        middle = 0.5 * float(np.max(along) + np.min(along))
        low, high = (clip(self.vertices, s * self.axes[i], s * middle) for s in (1.0, -1.0))
        return PolygonCell(low, self.normal, self.axes), PolygonCell(high, self.normal, self.axes)

    def cut(self) -> int:
        """Return the number of the axis with the larger extent; it is cut in the middle, the lower part first."""
        extents = np.ptp(self.axes @ self.vertices.T, axis=1)
        return int(np.argmax(extents >= (1.0 - ROUNDING) * np.max(extents)))

    def ball(self) -> tuple[FloatArray, float]:
        """Return the mean of the vertices and the distance to the farthest."""
        middle = self.vertices.mean(axis=0)
        return middle, float(np.max(np.linalg.norm(self.vertices - middle, axis=1)))

    def anchors(self) -> FloatArray:
        """Return the corners."""
        return self.vertices

    def to_dict(self) -> Json:
        """Return vertices, normal and axes."""
        values = {"vertices": self.vertices, "normal": self.normal, "axes": self.axes}
        return {"kind": self.kind} | {name: value.tolist() for name, value in values.items()}


class FlatFaceCells(CellFace):
    """Flat face, or what constraints leave of it, as convex polygons.

    Parameters
    ----------
    name : str
    pieces : sequence of (m, space) array
        Vertices of the polygons in order.
    normal : (space,) array
        Unit, into the body.
    """

    def __init__(self, name: str, pieces: Sequence[FloatArray], normal: FloatArray) -> None:
        super().__init__(name)
        self.pieces, self.normal = tuple(pieces), normal
        self.axes = tangents(normal[None])[0]

    def cells(self) -> Sequence[SurfaceCell]:
        """Return a cell for each piece."""
        return [PolygonCell(piece, self.normal, self.axes) for piece in self.pieces]


def clip(vertices: FloatArray, direction: FloatArray, offset: float) -> FloatArray:
    """Return what a half-space ``direction . p <= offset`` leaves of a convex polygon or a segment, perhaps nothing."""
    beyond = vertices @ direction - offset
    kept: list[FloatArray] = []
    pairs = len(vertices) if len(vertices) > 2 else 1
    for i in range(len(vertices)):
        j = (i + 1) % len(vertices)
        if beyond[i] <= 0.0:
            kept.append(vertices[i])
        if i < pairs and beyond[i] * beyond[j] < 0.0:
            kept.append(vertices[i] + (vertices[j] - vertices[i]) * (beyond[i] / (beyond[i] - beyond[j])))
    return np.array(kept).reshape(-1, vertices.shape[1])
