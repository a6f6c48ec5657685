"""Sectors of a cylinder's ends, and patches of surfaces that turn about the z axis."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array, number
from nlpgrasp.verify.bound.cells.cell import Cut, Rows, halves, increasing, one_of

SPACING = 0.1  # radians between rows
MOST_STEPS = 16


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
        """Return a grid, all with the same bends.

        Turning by phi turns point and normal alike: ``|z''| <= |f_c| + |tau| |p_0|`` about any point c of the axis,
        and the same around the tube about its middle; along a cylinder the work is linear.
        """
        (ring, tube), angles, along = self.radii, self.angles, self.along
        torus = ring > 0.0
        turns = _steps(angles)
        steps = _steps(along) if torus else int(along[1] > along[0])
        points, normals = self._at(_grid(angles, turns), _grid(along, steps))
        d = float(angles[1] - angles[0]) / max(turns, 1)
        e = float(along[1] - along[0]) / max(steps, 1)
        widest = ring + tube
        arm = widest + float(np.hypot(widest, min(e, 2.0 * tube) if torus else e))
        off = np.array([d**2, d**2 * arm, d**2])
        more = np.array([d, d * arm, d])
        if torus:
            swept = 2.0 * tube + widest * d
            off += np.array([e**2, e * (2.0 * e * tube) + e**2 * widest * d, e**2])
            more += np.array([e, e * swept, e])
        else:
            off[1] += d**2 * e
            more[1] += e
        return Rows(points, normals, np.tile(np.stack([off / 8.0, more]), (len(points), 1, 1)))

    def _at(self, phi: FloatArray, t: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return points and inward normals at all pairs of angles and t, (m, 3) each."""
        ring, tube = self.radii
        phi, t = np.repeat(phi, len(t)), np.tile(t, len(phi))
        out, up = np.stack([np.cos(phi), np.sin(phi), 0.0 * phi], axis=1), np.array([0.0, 0.0, 1.0])
        if ring == 0.0:
            return tube * out + t[:, None] * up, -out
        around = np.cos(t)[:, None] * out + np.sin(t)[:, None] * up
        return ring * out + tube * around, -around

    def parts(self, cut: Cut) -> tuple[Revolved, Revolved]:
        """Return the halves of phi, 0, or of t, 1."""
        key, interval = (("angles", self.angles), ("along", self.along))[one_of(cut, 2)]
        low, high = halves(interval)
        return Revolved({**self.data, key: low.tolist()}), Revolved({**self.data, key: high.tolist()})

    def hull(self) -> tuple[FloatArray, float]:
        """Return the point in the middle and the longest way over the surface to a corner."""
        ring, tube = self.radii
        middle = self._at(self.angles.mean(keepdims=True), self.along.mean(keepdims=True))[0]
        beside = float(np.ptp(self.along)) * (tube if ring > 0.0 else 1.0)
        return middle, 0.5 * ((ring + tube) * float(np.ptp(self.angles)) + beside)

    def anchors(self) -> FloatArray:
        """Return the corners and the middles of all sides."""
        return self._at(_grid(self.angles, 2), _grid(self.along, 2))[0]


def _steps(interval: FloatArray) -> int:
    size = float(interval[1] - interval[0])
    return min(max(int(np.ceil(size / SPACING)), 2), MOST_STEPS) if size > 0.0 else 0


def _grid(interval: FloatArray, steps: int) -> FloatArray:
    return np.linspace(float(interval[0]), float(interval[1]), steps + 1)
