"""Cells of surfaces of revolution about the z axis: disc sectors and curved patches."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array, number
from nlpgrasp.verify.bound.cells.cell import Cut, Rows, Sheet, halves, increasing, one_of

SPACING = 0.3  # radians: largest side of the initial parts
MOST = 8  # most initial parts in each direction


@dataclass(frozen=True)
class TurnedSheet:
    """Patch ``phi_0 <= phi <= phi_1``, ``t_0 <= t <= t_1`` of a cylinder's side (t height) or a torus (t angle).

    A rotation by phi turns point and normal alike: ``|z''| <= |f_c| + |tau| |p_0|`` about any point c of the axis, and
    likewise around the tube about its centre line; along a cylinder the work is linear.

    Parameters
    ----------
    radii : (ring, tube)
        Of a torus; 0 and the radius of a cylinder, metres.
    angles, along : (2,) arrays
        Intervals of phi and t, the coordinates of a point.
    """

    radii: tuple[float, float]
    angles: FloatArray
    along: FloatArray

    def start(self) -> FloatArray:
        """Return patches with corners (low, low), (low, high), (high, low), (high, high); lines with both ends."""
        straight = self.radii[0] == 0.0
        return _patches(_steps(self.angles, False), _steps(self.along, straight))

    def contacts(self, places: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return points and inward normals at (phi, t), (m, 2)."""
        (ring, tube), phi, t = self.radii, places[:, 0], places[:, 1:]
        out, up = np.stack([np.cos(phi), np.sin(phi), 0.0 * phi], axis=1), np.array([0.0, 0.0, 1.0])
        if ring == 0.0:
            return tube * out + t * up, -out
        around = np.cos(t) * out + np.sin(t) * up
        return ring * out + tube * around, -around

    def bends(self, parts: FloatArray) -> FloatArray:
        """Return the interpolation coefficients (n, 2, 3) of patches or lines (n, c, 2)."""
        ring, tube = self.radii
        d, e = (parts[:, -1] - parts[:, 0]).T
        widest = ring + tube
        arm = widest + np.hypot(widest, np.minimum(e, 2.0 * tube) if ring > 0.0 else e)
        off = [d**2, d**2 * arm, d**2]
        more = [d, d * arm, d]
        if ring > 0.0:
            off = [off[0] + e**2, off[1] + 2.0 * e**2 * tube + e**2 * widest * d, off[2] + e**2]
            more = [more[0] + e, more[1] + e * (2.0 * tube + widest * d), more[2] + e]
        else:
            off[1], more[1] = off[1] + d**2 * e, more[1] + e
        return np.stack([np.stack(off, axis=1) / 8.0, np.stack(more, axis=1)], axis=1)

    def halved(self, parts: FloatArray) -> FloatArray:
        """Return four patches for each (n, 4, 2), two lines for each (n, 2, 2)."""
        made = []
        for part in parts:
            low, high = part[0], part[-1]
            ends = [np.unique([a, 0.5 * (a + b), b]) for a, b in zip(low, high, strict=True)]
            made.append(_patches(*ends))
        return np.concatenate(made)


def _steps(interval: FloatArray, straight: bool) -> FloatArray:
    """Return the initial grid of an interval."""
    low, high = interval.tolist()
    if high == low:
        return np.array([low])
    count = 1 if straight else min(max(int(np.ceil((high - low) / SPACING)), 1), MOST)
    return np.linspace(low, high, count + 1)


def _patches(phi: FloatArray, t: FloatArray) -> FloatArray:
    """Return the rectangles between grid lines; lines where one coordinate is constant."""
    sides = [np.stack([x[:-1], x[1:]], axis=1) if len(x) > 1 else x[:, None] for x in (phi, t)]
    return np.array([list(product(a, b)) for a, b in product(*sides)])


@dataclass(frozen=True)
class Sector:
    """Annular sector ``r_0 <= r <= r_1``, ``phi_0 <= phi <= phi_1`` of a horizontal disc.

    Parameters
    ----------
    data : mapping
        ``radii`` and ``height``, metres; ``angles``, radians, less than half a turn apart; ``normal``.
    """

    data: Json

    @property
    def radii(self) -> FloatArray:
        """Inner and outer radius, (2,), metres."""
        return increasing("radii", array("radii", self.data["radii"], (2,)))

    @property
    def angles(self) -> FloatArray:
        """Both angles, (2,), radians."""
        return increasing("angles", array("angles", self.data["angles"], (2,)), 3.0)

    def rows(self) -> Rows:
        """Return the corners, and the intersection of the tangents at the ends of the outer arc."""
        (inner, outer), (low, high) = self.radii.tolist(), self.angles.tolist()
        places = [(inner, low), (inner, high), (outer, low), (outer, high)]
        if high > low:
            places.append((outer / np.cos(0.5 * (high - low)), 0.5 * (low + high)))
        height = number("height", self.data["height"])
        points = [(r * np.cos(phi), r * np.sin(phi), height) for r, phi in places]
        return Rows.flat(np.array(points), array("normal", self.data["normal"], (3,)))

    def sheets(self) -> list[Sheet]:
        """Return no curved parts."""
        return []

    def parts(self, cut: Cut) -> tuple[Sector, Sector]:
        """Return the halves of the radii, for cut 0, or of the angles, for cut 1."""
        key, interval = (("radii", self.radii), ("angles", self.angles))[one_of(cut, 2)]
        low, high = halves(interval)
        return Sector({**self.data, key: low.tolist()}), Sector({**self.data, key: high.tolist()})

    def hull(self) -> tuple[FloatArray, float]:
        """Return the vertex contacts' points."""
        return self.rows().points, 0.0

    def anchors(self) -> FloatArray:
        """Return the vertex contacts' points."""
        return self.rows().points


@dataclass(frozen=True)
class Revolved:
    """Patch ``phi_0 <= phi <= phi_1``, ``t_0 <= t <= t_1`` of a cylinder's side (t height) or a torus (t angle).

    Parameters
    ----------
    data : mapping
        ``radii``: that of the tube's centre line, 0 for a cylinder, and that of tube or cylinder, metres; ``angles``,
        radians; ``along``, t.
    """

    data: Json

    @property
    def radii(self) -> tuple[float, float]:
        """Radii of the centre line and of the tube or cylinder, metres."""
        ring, tube = array("radii", self.data["radii"], (2,)).tolist()
        return ring, tube

    @property
    def angles(self) -> FloatArray:
        """Both angles about the axis, radians."""
        return increasing("angles", array("angles", self.data["angles"], (2,)), 3.0)

    @property
    def along(self) -> FloatArray:
        """Both ends of t, metres or radians."""
        return increasing("along", array("along", self.data["along"], (2,)), 3.0 if self.radii[0] > 0.0 else np.inf)

    def rows(self) -> Rows:
        """Return the point itself for a cell of one point."""
        return Rows.none() if self.sheets() else Rows(*self._sheet.contacts(self._sheet.start()[:, 0]))

    @property
    def _sheet(self) -> TurnedSheet:
        return TurnedSheet(self.radii, self.angles, self.along)

    def sheets(self) -> list[Sheet]:
        """Return the patch, or the line, as a curved part."""
        return [self._sheet] if np.ptp(self.angles) > 0.0 or np.ptp(self.along) > 0.0 else []

    def parts(self, cut: Cut) -> tuple[Revolved, Revolved]:
        """Return the halves of phi, for cut 0, or of t, for cut 1."""
        key, interval = (("angles", self.angles), ("along", self.along))[one_of(cut, 2)]
        low, high = halves(interval)
        return Revolved({**self.data, key: low.tolist()}), Revolved({**self.data, key: high.tolist()})

    def hull(self) -> tuple[FloatArray, float]:
        """Return the middle point and the longest path on the surface to a corner."""
        ring, tube = self.radii
        middle = self._sheet.contacts(np.array([[self.angles.mean(), self.along.mean()]]))[0]
        beside = float(np.ptp(self.along)) * (tube if ring > 0.0 else 1.0)
        return middle, 0.5 * ((ring + tube) * float(np.ptp(self.angles)) + beside)

    def anchors(self) -> FloatArray:
        """Return the corners and the middles of all sides."""
        three = [np.linspace(float(ends[0]), float(ends[1]), 3) for ends in (self.angles, self.along)]
        return self._sheet.contacts(np.array(list(product(*three))))[0]
