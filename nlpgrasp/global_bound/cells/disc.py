"""Sectors of rings: cells of a cylinder's flat ends."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.global_bound.cells.base import Cell, Rows, Surface

SECTORS = 8  # of a disc: angles that differ by less than half a turn are needed


class SectorCell(Cell):
    """The part of a horizontal disc about the z axis with ``r_0 <= r <= r_1`` and ``phi_0 <= phi <= phi_1``.

    The normal is the same everywhere, so that a convex function of the work is largest at a corner of any polygon
    around the sector: its own corners, and where the outer arc's end tangents meet.

    Parameters
    ----------
    radii : (2,) array
        Metres, from 0.
    angles : (2,) array
        Radians, less than pi apart; equal for a radius alone.
    height : float
        z of the disc, metres.
    normal : (3,) array
        Unit, into the body.
    """

    kind: ClassVar[str] = "sector"

    def __init__(self, radii: FloatArray, angles: FloatArray, height: float, normal: FloatArray) -> None:
        self.radii, self.angles, self.height, self.normal = radii, angles, height, normal

    def rows(self) -> Rows:
        """Return the corners and where the outer tangents meet."""
        low, high = self.angles
        polar = [(r, phi) for r in self.radii for phi in (low, high)]
        if high > low:
            polar.append((self.radii[1] / np.cos(0.5 * (high - low)), 0.5 * (low + high)))
        points = np.array([(r * np.cos(phi), r * np.sin(phi), self.height) for r, phi in polar])
        return Rows(points, np.broadcast_to(self.normal, points.shape))

    def split(self) -> tuple[SectorCell, SectorCell]:
        """Return both halves, of the radii or of the angles, whichever are further apart."""
        if self.cut() == 0:
            first, second = halves(self.radii)
            return self._with(first, self.angles), self._with(second, self.angles)
        first, second = halves(self.angles)
        return self._with(self.radii, first), self._with(self.radii, second)

    def cut(self) -> int:
        """Return 0 for a cut of the radii, 1 for one of the angles, each in the middle, the lower part first."""
        return int(np.ptp(self.radii) < self.radii[1] * np.ptp(self.angles))

    def _with(self, radii: FloatArray, angles: FloatArray) -> SectorCell:
        return SectorCell(radii, angles, self.height, self.normal)

    def ball(self) -> tuple[FloatArray, float]:
        """Return the mean of the rows and the distance to the farthest."""
        points = self.rows().points
        middle = points.mean(axis=0)
        return middle, float(np.max(np.linalg.norm(points - middle, axis=1)))

    def anchors(self) -> FloatArray:
        """Return the corners."""
        return self.rows().points

    def to_dict(self) -> Json:
        """Return radii, angles, height and normal."""
        radii, angles = self.radii.tolist(), self.angles.tolist()
        return {
            "kind": self.kind,
            "radii": radii,
            "angles": angles,
            "height": self.height,
            "normal": self.normal.tolist(),
        }


class DiscFace(Surface):
    """A flat end of a cylinder about the z axis.

    Parameters
    ----------
    name : str
    radius, height : float
        Of the disc and its z, metres.
    normal : (3,) array
        Unit, into the body.
    """

    def __init__(self, name: str, radius: float, height: float, normal: FloatArray) -> None:
        super().__init__(name)
        self.radius, self.height, self.normal = radius, height, normal

    def cells(self) -> Sequence[Cell]:
        """Return the sectors from the centre to the rim."""
        ends = 2.0 * np.pi * np.arange(SECTORS + 1) / SECTORS
        radii = np.array([0.0, self.radius])
        return [SectorCell(radii, ends[i : i + 2], self.height, self.normal) for i in range(SECTORS)]

    def pinned(self) -> Sequence[Cell]:
        """Return the radius at angle 0: where every contact of the disc can be turned to."""
        return [SectorCell(np.array([0.0, self.radius]), np.zeros(2), self.height, self.normal)]


def halves(interval: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return both halves of an interval (2,)."""
    middle = 0.5 * float(interval[0] + interval[1])
    return np.array([interval[0], middle]), np.array([middle, interval[1]])
