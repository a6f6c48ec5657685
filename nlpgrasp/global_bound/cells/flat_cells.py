"""Cells of flat faces: convex polygons and segments, bounded by their vertices."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from nlpgrasp.common.spatial import tangents
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.global_bound.cells.cell import CellFace, RepresentativeContacts, SurfaceCell

ROUNDING = 1e-9  # relative difference of equal extents, so that mirror images are cut equally


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
        Unit tangents across which the polygon is cut.
    """

    kind: ClassVar[str] = "polygon"

    def __init__(self, vertices: FloatArray, normal: FloatArray, axes: FloatArray) -> None:
        self.vertices, self.normal, self.axes = vertices, normal, axes

    def representative_contacts(self) -> RepresentativeContacts:
        """Return the vertices of the polygon, with its normal at each."""
        return RepresentativeContacts(self.vertices, np.broadcast_to(self.normal, self.vertices.shape))

    def split(self) -> tuple[PolygonCell, PolygonCell]:
        """Return both halves, cut across the axis with the larger extent."""
        i = self.cut()
        coordinates = self.axes[i] @ self.vertices.T
        midpoint = 0.5 * float(np.max(coordinates) + np.min(coordinates))
        low, high = (clip(self.vertices, s * self.axes[i], s * midpoint) for s in (1.0, -1.0))
        return PolygonCell(low, self.normal, self.axes), PolygonCell(high, self.normal, self.axes)

    def cut(self) -> int:
        """Return the index of the axis with the larger extent, across which the cell is cut.

        It is cut in the middle; the lower part comes first.
        """
        extents = np.ptp(self.axes @ self.vertices.T, axis=1)
        return int(np.argmax(extents >= (1.0 - ROUNDING) * np.max(extents)))

    def ball(self) -> tuple[FloatArray, float]:
        """Return the mean of the vertices as centre, and the distance to the farthest vertex as radius."""
        centre = self.vertices.mean(axis=0)
        return centre, float(np.max(np.linalg.norm(self.vertices - centre, axis=1)))

    def anchors(self) -> FloatArray:
        """Return the corners of the polygon."""
        return self.vertices

    def to_dict(self) -> Json:
        """Return vertices, normal and axes."""
        values = {"vertices": self.vertices, "normal": self.normal, "axes": self.axes}
        return {"kind": self.kind} | {name: value.tolist() for name, value in values.items()}


class FlatFaceCells(CellFace):
    """Flat face, or its allowed part, as convex polygons.

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
        """Return a cell for each convex polygon."""
        return [PolygonCell(piece, self.normal, self.axes) for piece in self.pieces]


def clip(vertices: FloatArray, direction: FloatArray, offset: float) -> FloatArray:
    """Return the part of a convex polygon or segment in the half-space ``direction . p <= offset``, possibly empty."""
    excess = vertices @ direction - offset
    clipped: list[FloatArray] = []
    pairs = len(vertices) if len(vertices) > 2 else 1
    for i in range(len(vertices)):
        j = (i + 1) % len(vertices)
        if excess[i] <= 0.0:
            clipped.append(vertices[i])
        if i < pairs and excess[i] * excess[j] < 0.0:
            clipped.append(vertices[i] + (vertices[j] - vertices[i]) * (excess[i] / (excess[i] - excess[j])))
    return np.array(clipped).reshape(-1, vertices.shape[1])
