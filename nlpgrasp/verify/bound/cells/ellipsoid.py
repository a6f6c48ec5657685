"""Spherical triangles, arcs and points, mapped onto an ellipsoid about the origin."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array
from nlpgrasp.verify.bodies.smooth import positive
from nlpgrasp.verify.bound.cells.cell import Cut, Rows, Sheet, one_of
from nlpgrasp.verify.bound.cells.ellipsoid_sheet import EllipsoidSheet, between

UNIT = 1e-9


@dataclass(frozen=True)
class Ellipsoid:
    """The image under ``diag(semi_axes)`` of the smallest part of the unit sphere that is convex around corners.

    Parameters
    ----------
    data : mapping
        ``corners`` (1 to 3, 3), unit, and ``semi_axes`` (3,), metres.
    """

    data: Json

    @cached_property
    def corners(self) -> FloatArray:
        """Unit vectors (c, 3)."""
        found = array("corners", self.data["corners"], (None, 3))
        good = 1 <= len(found) <= 3 and np.all(np.abs(np.linalg.norm(found, axis=1) - 1.0) <= UNIT)
        if not good or np.min(found @ found.T) < -UNIT:
            raise ValueError("corners that are not one to three unit vectors within a right angle of each other")
        return found

    @cached_property
    def axes(self) -> FloatArray:
        """Semi-axes (3,), metres."""
        return positive("semi_axes", self.data["semi_axes"], 3)

    def rows(self) -> Rows:
        """Return the point itself, where the cell is one."""
        if len(self.corners) > 1:
            return Rows.none()
        return Rows(*EllipsoidSheet(self.corners, self.axes).contacts(self.corners))

    def sheets(self) -> list[Sheet]:
        """Return the triangle or arc."""
        return [EllipsoidSheet(self.corners, self.axes)] if len(self.corners) > 1 else []

    def parts(self, cut: Cut) -> tuple[Ellipsoid, Ellipsoid]:
        """Return both halves of a cut from the middle of a side to the corner across."""
        first = one_of(cut, len(self.corners))
        second = (first + 1) % len(self.corners)
        middle = self.corners[first] + self.corners[second]
        middle = middle / np.linalg.norm(middle)
        return self._with(second, middle), self._with(first, middle)

    def _with(self, corner: int, place: FloatArray) -> Ellipsoid:
        corners = self.corners.tolist()
        corners[corner] = place.tolist()
        return Ellipsoid({**self.data, "corners": corners})

    def hull(self) -> tuple[FloatArray, float]:
        """Return the middle, and the largest semi-axis times the angle to the farthest corner."""
        middle = np.sum(self.corners, axis=0)
        middle /= np.linalg.norm(middle)
        return (middle * self.axes)[None], float(self.axes.max() * np.max(between(self.corners, middle[None])))

    def anchors(self) -> FloatArray:
        """Return the corners on the ellipsoid."""
        return self.corners * self.axes
