"""Flat cells: polygons of flat faces and segments of straight edges."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array
from nlpgrasp.verify.bound.cells.cell import Cut, Rows, Sheet, one_of

UNIT = 1e-9


@dataclass(frozen=True)
class Polygon:
    """A polygon around its vertices, in order; a segment if there are two.

    Parameters
    ----------
    data : mapping
        ``vertices`` (m, space), metres; ``normal`` (space,), unit, into the body; ``axes`` (space - 1, space), unit,
        the directions along which it may be halved.
    """

    data: Json

    @cached_property
    def vertices(self) -> FloatArray:
        """Corners in order, (m, space), metres."""
        return array("vertices", self.data["vertices"], (None, None))

    @cached_property
    def normal(self) -> FloatArray:
        """Unit inward normal, (space,)."""
        return array("normal", self.data["normal"], (self.vertices.shape[1],))

    @cached_property
    def axes(self) -> FloatArray:
        """Directions of cuts, (space - 1, space), unit."""
        return array("axes", self.data["axes"], (None, self.vertices.shape[1]))

    def rows(self) -> Rows:
        """Return the vertices as contacts: a convex function of the point is largest at one of them."""
        if not abs(float(np.linalg.norm(self.normal)) - 1.0) <= UNIT:
            raise ValueError("a normal that is no unit vector")
        return Rows.flat(self.vertices, self.normal)

    def sheets(self) -> list[Sheet]:
        """Return no curved parts."""
        return []

    def parts(self, cut: Cut) -> tuple[Polygon, Polygon]:
        """Return the parts below and above the middle of the extent along an axis."""
        axis = self.axes[one_of(cut, len(self.axes))]
        height = self.vertices @ axis
        middle = 0.5 * float(height.min() + height.max())
        low, high = below(self.vertices, height - middle), below(self.vertices, middle - height)
        return self._of(low), self._of(high)

    def _of(self, vertices: FloatArray) -> Polygon:
        return Polygon({**self.data, "vertices": vertices.tolist()})

    def hull(self) -> tuple[FloatArray, float]:
        """Return the vertices."""
        return self.vertices, 0.0

    def anchors(self) -> FloatArray:
        """Return the vertices."""
        return self.vertices


def below(vertices: FloatArray, height: FloatArray) -> FloatArray:
    """Return the part of a polygon or segment where a linear function is at most zero.

    Parameters
    ----------
    vertices : (m, space) array
        In order.
    height : (m,) array
        Values of the function at the vertices.
    """
    count = len(vertices)
    kept = []
    for i in range(count):
        if height[i] <= 0.0:
            kept.append(vertices[i])
        following = (i + 1) % count
        if (following > i or count > 2) and min(height[i], height[following]) < 0.0 < max(height[i], height[following]):
            share = height[i] / (height[i] - height[following])
            kept.append(vertices[i] + share * (vertices[following] - vertices[i]))
    return np.array(kept).reshape(-1, vertices.shape[1])
