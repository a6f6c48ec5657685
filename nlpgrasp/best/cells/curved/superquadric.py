"""Rectangles of angles on an octant of a superquadric: cells with bounds from its monotone coordinates."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import ClassVar

import numpy as np

from nlpgrasp.best.cells.base import Cell, IntArray, Rows, Surface
from nlpgrasp.best.cells.curved.patches import Curved
from nlpgrasp.best.cells.curved.turned import quarters, rectangles
from nlpgrasp.best.cells.disc import halves
from nlpgrasp.common.spatial import tangents
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray

STEPS = 4  # parts of a cell either way
ROUNDED = 1e-7  # of the largest semi-axis: how far the body, which is rounded at its planes of symmetry, may be off


class Octant:
    """An octant of a superquadric about the origin in two angles, each from 0 to pi / 2, that stand for t and w.

    With ``c(t, e) = cos(t)^e`` and s for sines, a point is ``(a c(t, e1) c(w, e2), b c(t, e1) s(w, e2), c s(t, e1))``
    and its outward normal along ``(c(t, 2 - e1) c(w, 2 - e2) / a, c(t, 2 - e1) s(w, 2 - e2) / b, s(t, 2 - e1) / c)``
    (Barr 1981, doi:10.1109/MCG.1981.1673799), times the octant's signs. Each coordinate of both rises or falls with
    each angle, so those of a rectangle of angles are between those of its corners. Points are then as far apart as the
    diagonal of a box at most, and normals by ``2 asin(|h| / |m|)`` for a box about m with the half diagonal h:
    the work of a contact differs from another's by no more than ``turn |v| + apart |tau|``.

    An angle u stands for t by ``tan t = (tan u)^(1/m)``, ``m = min(e, 2 - e)``: near the planes of symmetry points move
    with t to the power e and normals with t to the power 2 - e, of which one is below 1, and neither faster than u.

    Parameters
    ----------
    semi_axes : (3,) array
        Metres.
    exponents : (2,) array
        e1 and e2.
    signs : (3,) array
        Of the octant.
    """

    def __init__(self, semi_axes: FloatArray, exponents: FloatArray, signs: FloatArray) -> None:
        self.a, self.exponents, self.signs = semi_axes, exponents, signs

    def contacts(self, coordinates: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return points and inward normals at angles (m, 2)."""
        outward = self._shape(coordinates, 2.0 - self.exponents) / self.a
        outward /= np.linalg.norm(outward, axis=1, keepdims=True)
        return self.signs * self.a * self._shape(coordinates, self.exponents), -self.signs * outward

    def _shape(self, angles: FloatArray, exponents: FloatArray) -> FloatArray:
        """Return the coordinates of a superquadric of unit size at angles (..., 2), (..., 3)."""
        cos, sin = np.maximum(np.cos(angles), 0.0), np.maximum(np.sin(angles), 0.0)
        power, larger = 1.0 / np.minimum(self.exponents, 2.0 - self.exponents), np.maximum(cos, sin)
        cos, sin = (cos / larger) ** power, (sin / larger) ** power
        length = np.hypot(cos, sin)
        cos, sin = cos / length, sin / length
        ring = cos[..., 0] ** exponents[0]
        flat = [ring * cos[..., 1] ** exponents[1], ring * sin[..., 1] ** exponents[1]]
        return np.stack([*flat, sin[..., 0] ** exponents[0]], axis=-1)

    def bends(self, parts: FloatArray) -> FloatArray:
        """Return the bends of rectangles of angles (n, c, 2), (n, 2, 3)."""
        turn, apart = self.spread(parts)
        weights = np.stack([turn, apart, turn], axis=1)
        return np.stack([weights, weights], axis=1)

    def spread(self, parts: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return how far normals, radians, and points, metres, in rectangles (n, c, 2) are apart at most, (n,) each."""
        points = self.a * self._shape(parts, self.exponents)
        apart = np.linalg.norm(np.ptp(points, axis=1), axis=1) + ROUNDED * float(np.max(self.a))
        outward = self._shape(parts, 2.0 - self.exponents) / self.a
        low, high = np.min(outward, axis=1), np.max(outward, axis=1)
        share = np.linalg.norm(high - low, axis=1) / np.linalg.norm(high + low, axis=1)
        return 2.0 * np.arcsin(np.minimum(share, 1.0)), apart

    def finer(self, parts: FloatArray) -> tuple[FloatArray, IntArray]:
        """Return the quarters of rectangles (n, 4, 2), as corners and which."""
        return quarters(parts)


class SuperquadricCell(Cell):
    """A rectangle of angles on an octant.

    Parameters
    ----------
    octant : Octant
    angles, along : (2,) arrays
        Those for t and for w, radians, from 0 to pi / 2.
    """

    kind: ClassVar[str] = "superquadric"

    def __init__(self, octant: Octant, angles: FloatArray, along: FloatArray) -> None:
        self.octant, self.angles, self.along = octant, angles, along

    def rows(self) -> Rows:
        """Return a grid of points and the rectangles between them."""
        corners, parts = rectangles(_grid(self.angles, STEPS), _grid(self.along, STEPS))
        return Rows(*self.octant.contacts(corners), curved=(Curved(self.octant, corners[parts], parts),))

    def split(self) -> tuple[SuperquadricCell, SuperquadricCell]:
        """Return both halves across the angle whose halves are less spread."""
        first, second = self._cut(self.cut())
        return first, second

    def _cut(self, axis: int) -> tuple[SuperquadricCell, SuperquadricCell]:
        if axis == 0:
            low, high = halves(self.angles)
            return SuperquadricCell(self.octant, low, self.along), SuperquadricCell(self.octant, high, self.along)
        low, high = halves(self.along)
        return SuperquadricCell(self.octant, self.angles, low), SuperquadricCell(self.octant, self.angles, high)

    def cut(self) -> int:
        """Return 0 for a cut of the first angle, 1 for one of the second, each in the middle, the lower part first."""
        spread = [max(cell.width() for cell in self._cut(axis)) for axis in (0, 1)]
        return int(np.round(spread[1] / spread[0], 9) < 1.0)

    def width(self) -> float:
        """Return how far points are apart, and normals as if on a ball of the largest semi-axis, metres."""
        turn, apart = self.octant.spread(rectangles(self.angles, self.along)[0][None])
        return float(apart[0] + turn[0] * np.max(self.octant.a))

    def ball(self) -> tuple[FloatArray, float]:
        """Return the middle of the box of the corners and half its diagonal."""
        points = self.octant.contacts(rectangles(self.angles, self.along)[0])[0]
        low, high = points.min(axis=0), points.max(axis=0)
        return 0.5 * (low + high), 0.5 * float(np.linalg.norm(high - low))

    def anchors(self) -> FloatArray:
        """Return the corners, the middles of the sides and the middle."""
        return self.octant.contacts(rectangles(_grid(self.angles, 2), _grid(self.along, 2))[0])[0]

    def to_dict(self) -> Json:
        """Return the octant's numbers and both intervals."""
        octant, values = self.octant, {"angles": self.angles.tolist(), "along": self.along.tolist()}
        axes, exponents, signs = (v.tolist() for v in (octant.a, octant.exponents, octant.signs))
        return {"kind": self.kind, "semi_axes": axes, "exponents": exponents, "signs": signs, **values}


class SuperquadricFace(Surface):
    """The surface of a superquadric about the origin.

    Parameters
    ----------
    name : str
    semi_axes : (3,) array
        Metres.
    exponents : (2,) array
    """

    def __init__(self, name: str, semi_axes: FloatArray, exponents: FloatArray) -> None:
        super().__init__(name)
        self.a, self.exponents = semi_axes, exponents

    def cells(self) -> Sequence[Cell]:
        """Return the eight octants."""
        every = [Octant(self.a, self.exponents, np.array(signs)) for signs in product((1.0, -1.0), repeat=3)]
        return [SuperquadricCell(octant, *np.array([[0.0, 0.5 * np.pi]] * 2)) for octant in every]

    def moved(self, point: FloatArray, steps: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the points moved along the tangents and drawn back to the surface from the centre."""
        target = point + steps @ tangents(self._inward(point[None]))[0]
        e1, e2 = self.exponents
        x, y, z = (np.abs(target) / self.a).T
        level = ((x ** (2.0 / e2) + y ** (2.0 / e2)) ** (e2 / e1) + z ** (2.0 / e1)) ** (0.5 * e1)
        points = target / level[:, None]
        return points, self._inward(points)

    def _inward(self, points: FloatArray) -> FloatArray:
        """Return the inward unit normals at points (m, 3) of the surface, (m, 3)."""
        e1, e2 = self.exponents
        x, y, z = (np.abs(points) / self.a).T
        ring = x ** (2.0 / e2) + y ** (2.0 / e2)
        flat = np.maximum(ring, 1e-300) ** (e2 / e1 - 1.0)
        outward = np.stack([flat * x ** (2.0 / e2 - 1.0), flat * y ** (2.0 / e2 - 1.0), z ** (2.0 / e1 - 1.0)], axis=1)
        outward *= np.where(points < 0.0, -1.0, 1.0) / self.a
        return np.asarray(-outward / np.linalg.norm(outward, axis=1, keepdims=True))


def _grid(interval: FloatArray, steps: int) -> FloatArray:
    return np.linspace(float(interval[0]), float(interval[1]), steps + 1)
