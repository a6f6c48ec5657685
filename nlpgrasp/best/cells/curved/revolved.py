"""Patches of a cylinder's side and of a torus: cells of surfaces that turn about the z axis."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from nlpgrasp.best.cells.base import Cell, Rows, Surface
from nlpgrasp.best.cells.curved.patches import Curved
from nlpgrasp.best.cells.curved.turned import Revolved, at, rectangles
from nlpgrasp.best.cells.disc import halves
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray

FINE = 0.2  # radians between rows
MOST = 16  # steps between rows, either way
PARTS = 4  # of a whole turn, to begin with


class RevolvedCell(Cell):
    """A patch ``phi_0 <= phi <= phi_1``, ``t_0 <= t <= t_1`` of a surface that turns about the z axis.

    On a cylinder's side t is the height z; on a torus it is the angle around the tube.

    Parameters
    ----------
    patches : Revolved
        Of the surface.
    angles : (2,) array
        phi, radians.
    along : (2,) array
        t, metres or radians.
    """

    kind: ClassVar[str] = "revolved"

    def __init__(self, patches: Revolved, angles: FloatArray, along: FloatArray) -> None:
        self.patches, self.angles, self.along = patches, angles, along
        self.radii, self.round = patches.radii, patches.round

    def rows(self) -> Rows:
        """Return a grid of points and the patches between them."""
        turns, steps = _count(self.angles), _count(self.along) if self.round else int(np.ptp(self.along) > 0.0)
        corners, parts = rectangles(_grid(self.angles, turns), _grid(self.along, steps))
        curved = Curved(self.patches, corners[parts], parts)
        return Rows(*self.patches.contacts(corners), curved=(curved,) if parts.shape[1] > 1 else ())

    def split(self) -> tuple[RevolvedCell, RevolvedCell]:
        """Return both halves of the longer side in metres."""
        if self.cut() == 0:
            first, second = halves(self.angles)
            return RevolvedCell(self.patches, first, self.along), RevolvedCell(self.patches, second, self.along)
        first, second = halves(self.along)
        return RevolvedCell(self.patches, self.angles, first), RevolvedCell(self.patches, self.angles, second)

    def cut(self) -> int:
        """Return 0 for a cut of phi, 1 for one of t, each in the middle, the lower part first."""
        around = float(np.sum(self.radii) * np.ptp(self.angles))
        beside = float(np.ptp(self.along)) * (float(self.radii[1]) if self.round else 1.0)
        return int(around <= beside)

    def ball(self) -> tuple[FloatArray, float]:
        """Return the point in the middle and the longest way over the surface to a corner."""
        middle = at(self.radii, np.mean(self.angles, keepdims=True), np.mean(self.along, keepdims=True))[0][0]
        around = float(np.sum(self.radii) * np.ptp(self.angles))
        beside = float(np.ptp(self.along)) * (float(self.radii[1]) if self.round else 1.0)
        return middle, 0.5 * (around + beside)

    def anchors(self) -> FloatArray:
        """Return the corners and the middle of both intervals."""
        grids = np.meshgrid(*(_grid(interval, 2) for interval in (self.angles, self.along)), indexing="ij")
        return at(self.radii, np.ravel(grids[0]), np.ravel(grids[1]))[0]

    def to_dict(self) -> Json:
        """Return radii, angles and the interval of t."""
        values = (self.radii, self.angles, self.along)
        return {"kind": self.kind} | dict(zip(("radii", "angles", "along"), (v.tolist() for v in values), strict=True))


class RevolvedFace(Surface):
    """The side of a cylinder, or a torus, about the z axis.

    Parameters
    ----------
    name : str
    radii : (2,) array
        As of ``RevolvedCell``, metres.
    along : (2,) array
        The whole interval of t: heights, or a turn.
    """

    def __init__(self, name: str, radii: FloatArray, along: FloatArray) -> None:
        super().__init__(name)
        self.radii, self.along, self.patches = radii, along, Revolved(radii)

    def _parts(self) -> list[FloatArray]:
        if self.radii[0] == 0.0:
            return [self.along]
        ends = np.linspace(float(self.along[0]), float(self.along[1]), PARTS + 1)
        return [ends[i : i + 2] for i in range(PARTS)]

    def cells(self) -> Sequence[Cell]:
        """Return quarter turns, of a torus quarters of them around the tube."""
        ends = 2.0 * np.pi * np.arange(PARTS + 1) / PARTS
        return [RevolvedCell(self.patches, ends[i : i + 2], t) for i in range(PARTS) for t in self._parts()]

    def pinned(self) -> Sequence[Cell]:
        """Return the lines at angle 0: where every contact can be turned to."""
        return [RevolvedCell(self.patches, np.zeros(2), t) for t in self._parts()]


def _count(interval: FloatArray) -> int:
    size = float(np.ptp(interval))
    return int(np.clip(np.ceil(size / FINE), 2, MOST)) if size > 0.0 else 0


def _grid(interval: FloatArray, steps: int) -> FloatArray:
    return np.linspace(float(interval[0]), float(interval[1]), steps + 1)
