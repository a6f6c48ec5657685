"""Sectors of a cylinder's ends, and patches of surfaces that turn about the z axis."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array, number
from nlpgrasp.verify.bound.cells.cell import Cut, Rows, Sheet, halves, increasing, one_of
from nlpgrasp.verify.bound.cells.turned_sheet import TurnedSheet


@dataclass(frozen=True)
class Sector:
    """``r_0 <= r <= r_1``, ``phi_0 <= phi <= phi_1`` of a horizontal disc.

    Parameters
    ----------
    data : mapping
        ``radii`` and ``height``, metres; ``angles``, radians, less than half a turn apart; ``normal``.
    """

    data: Json

    @property
    def radii(self) -> FloatArray:
        """From the inner to the outer radius."""
        return increasing("radii", array("radii", self.data["radii"], (2,)))

    @property
    def angles(self) -> FloatArray:
        """Both angles."""
        return increasing("angles", array("angles", self.data["angles"], (2,)), 3.0)

    def rows(self) -> Rows:
        """Return the corners, and where the tangents at the ends of the outer arc meet."""
        (inner, outer), (low, high) = self.radii.tolist(), self.angles.tolist()
        places = [(inner, low), (inner, high), (outer, low), (outer, high)]
        if high > low:
            places.append((outer / np.cos(0.5 * (high - low)), 0.5 * (low + high)))
        height = number("height", self.data["height"])
        points = [(r * np.cos(phi), r * np.sin(phi), height) for r, phi in places]
        return Rows.flat(np.array(points), array("normal", self.data["normal"], (3,)))

    def sheets(self) -> list[Sheet]:
        """Return none."""
        return []

    def parts(self, cut: Cut) -> tuple[Sector, Sector]:
        """Return the halves of the radii, 0, or of the angles, 1."""
        key, interval = (("radii", self.radii), ("angles", self.angles))[one_of(cut, 2)]
        low, high = halves(interval)
        return Sector({**self.data, key: low.tolist()}), Sector({**self.data, key: high.tolist()})

    def hull(self) -> tuple[FloatArray, float]:
        """Return the rows."""
        return self.rows().points, 0.0

    def anchors(self) -> FloatArray:
        """Return the rows."""
        return self.rows().points


@dataclass(frozen=True)
class Revolved:
    """``phi_0 <= phi <= phi_1``, ``t_0 <= t <= t_1`` of a cylinder's side (t the height) or of a torus (t an angle).

    Parameters
    ----------
    data : mapping
        ``radii``: that of the tube's centre line, 0 for a cylinder, and that of tube or cylinder, metres; ``angles``,
        radians; ``along``, t.
    """

    data: Json

    @property
    def radii(self) -> tuple[float, float]:
        """Of the centre line and of tube or cylinder."""
        ring, tube = array("radii", self.data["radii"], (2,)).tolist()
        return ring, tube

    @property
    def angles(self) -> FloatArray:
        """Both angles about the axis."""
        return increasing("angles", array("angles", self.data["angles"], (2,)), 3.0)

    @property
    def along(self) -> FloatArray:
        """Both ends of t."""
        return increasing("along", array("along", self.data["along"], (2,)), 3.0 if self.radii[0] > 0.0 else np.inf)

    def rows(self) -> Rows:
        """Return the point itself, where the cell is one."""
        return Rows.none() if self.sheets() else Rows(*self._sheet.contacts(self._sheet.start()[:, 0]))

    @property
    def _sheet(self) -> TurnedSheet:
        return TurnedSheet(self.radii, self.angles, self.along)

    def sheets(self) -> list[Sheet]:
        """Return the patch, or the line."""
        return [self._sheet] if np.ptp(self.angles) > 0.0 or np.ptp(self.along) > 0.0 else []

    def parts(self, cut: Cut) -> tuple[Revolved, Revolved]:
        """Return the halves of phi, 0, or of t, 1."""
        key, interval = (("angles", self.angles), ("along", self.along))[one_of(cut, 2)]
        low, high = halves(interval)
        return Revolved({**self.data, key: low.tolist()}), Revolved({**self.data, key: high.tolist()})

    def hull(self) -> tuple[FloatArray, float]:
        """Return the point in the middle and the longest way over the surface to a corner."""
        ring, tube = self.radii
        middle = self._sheet.contacts(np.array([[self.angles.mean(), self.along.mean()]]))[0]
        beside = float(np.ptp(self.along)) * (tube if ring > 0.0 else 1.0)
        return middle, 0.5 * ((ring + tube) * float(np.ptp(self.angles)) + beside)

    def anchors(self) -> FloatArray:
        """Return the corners and the middles of all sides."""
        three = [np.linspace(float(ends[0]), float(ends[1]), 3) for ends in (self.angles, self.along)]
        return self._sheet.contacts(np.array(list(product(*three))))[0]
