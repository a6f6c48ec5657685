"""Spherical triangles, arcs and points: cells of ellipsoids and spheres."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import ClassVar

import numpy as np

from nlpgrasp.best.cells.base import Cell, Rows, Surface
from nlpgrasp.best.cells.curved.patches import Curved
from nlpgrasp.best.cells.curved.spherical import Spherical, angles, grid
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray

FINE = 0.2  # radians between rows
LEVELS = (1, 4)  # times that the sides of a cell are halved for its rows


class EllipsoidCell(Cell):
    """A triangle, an arc or a point u of the unit sphere, mapped onto an ellipsoid about the origin by ``p = A u``.

    Parameters
    ----------
    corners : (m, 3) array
        Unit; three of a triangle, two of an arc, one of a point.
    patches : Spherical
        Of the ellipsoid.
    """

    kind: ClassVar[str] = "ellipsoid"

    def __init__(self, corners: FloatArray, patches: Spherical) -> None:
        self.corners, self.patches, self.a = corners, patches, patches.a

    def rows(self) -> Rows:
        """Return the corners of small triangles, or arcs, and these."""
        longest = float(np.max(angles(self.corners, np.roll(self.corners, -1, axis=0))))
        levels = int(np.clip(np.ceil(np.log2(max(longest / FINE, 1e-9))), *LEVELS)) if longest > 0.0 else 0
        pairs, parts = grid(len(self.corners), levels)
        u = self.corners
        for first, second in pairs:
            middle = u[first] + u[second]
            u = np.concatenate([u, middle / np.linalg.norm(middle, axis=1, keepdims=True)])
        curved = Curved(self.patches, u[parts], parts)
        return Rows(*self.patches.contacts(u), curved=(curved,) if len(self.corners) > 1 else ())

    def split(self) -> tuple[EllipsoidCell, ...]:
        """Return both halves, cut at the middle of the side that is longest on the ellipsoid; a point as it is."""
        if len(self.corners) == 1:
            return (self,)
        i = self.cut()
        j = (i + 1) % len(self.corners)
        middle = self.corners[i] + self.corners[j]
        middle /= np.linalg.norm(middle)
        first, second = self.corners.copy(), self.corners.copy()
        first[j], second[i] = middle, middle
        return EllipsoidCell(first, self.patches), EllipsoidCell(second, self.patches)

    def cut(self) -> int:
        """Return the number i of the side from corner i to the next; the part with corner i comes first."""
        following = np.roll(self.corners, -1, axis=0)
        longest = np.round(np.linalg.norm((self.corners - following) * self.a, axis=1) / np.max(self.a), 9)
        return int(np.argmax(longest))

    def ball(self) -> tuple[FloatArray, float]:
        """Return the point in the middle, and the largest semi-axis times the angle to the farthest corner."""
        middle = self.corners.mean(axis=0)
        middle /= np.linalg.norm(middle)
        return middle * self.a, float(np.max(self.a) * np.max(angles(self.corners, middle[None])))

    def anchors(self) -> FloatArray:
        """Return the corners."""
        return self.corners * self.a

    def to_dict(self) -> Json:
        """Return the corners and the semi-axes."""
        return {"kind": self.kind, "corners": self.corners.tolist(), "semi_axes": self.a.tolist()}


class EllipsoidFace(Surface):
    """The surface of an ellipsoid about the origin.

    Parameters
    ----------
    name : str
    semi_axes : (3,) array
        Metres.
    """

    def __init__(self, name: str, semi_axes: FloatArray) -> None:
        super().__init__(name)
        self.a, self.patches = semi_axes, Spherical(semi_axes)

    def cells(self) -> Sequence[Cell]:
        """Return the eight octants."""
        return [EllipsoidCell(np.diag(signs).astype(float), self.patches) for signs in product((1, -1), repeat=3)]

    def half_plane(self, axis: FloatArray, side: FloatArray) -> Sequence[Cell]:
        """Return arcs over the half-plane through an axis, unit, on the side of another unit vector across it."""
        return [EllipsoidCell(np.stack([end, side]), self.patches) for end in (axis, -axis)]
