"""How the work of a contact bends over patches of surfaces that turn about the z axis."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from nlpgrasp.common.validation import FloatArray

SPACING = 0.3  # radians: of the parts to begin with
MOST = 8  # of them, either way


@dataclass(frozen=True)
class TurnedSheet:
    """``phi_0 <= phi <= phi_1``, ``t_0 <= t <= t_1`` of a cylinder's side (t the height) or of a torus (t an angle).

    Turning by phi turns point and normal alike: ``|z''| <= |f_c| + |tau| |p_0|`` about any point c of the axis, and the
    same around the tube about its middle; along a cylinder the work is linear.

    Parameters
    ----------
    radii : (ring, tube)
        Of a torus; 0 and the radius of a cylinder, metres.
    angles, along : (2,) arrays
        phi and t: coordinates of a place.
    """

    radii: tuple[float, float]
    angles: FloatArray
    along: FloatArray

    def start(self) -> FloatArray:
        """Return patches, corners (low, low), (low, high), (high, low), (high, high); lines with both ends."""
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
        """Return the bends of patches or lines (n, c, 2), (n, 2, 3)."""
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
    """Return where an interval is cut to begin with."""
    low, high = interval.tolist()
    if high == low:
        return np.array([low])
    count = 1 if straight else min(max(int(np.ceil((high - low) / SPACING)), 1), MOST)
    return np.linspace(low, high, count + 1)


def _patches(phi: FloatArray, t: FloatArray) -> FloatArray:
    """Return the rectangles between grid lines; lines where one coordinate has a single value."""
    sides = [np.stack([x[:-1], x[1:]], axis=1) if len(x) > 1 else x[:, None] for x in (phi, t)]
    return np.array([list(product(a, b)) for a, b in product(*sides)])
