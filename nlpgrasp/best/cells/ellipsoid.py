"""Spherical triangles, arcs and points: cells of ellipsoids and spheres."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import ClassVar

import numpy as np

from nlpgrasp.best.cells.base import Cell, Rows, Surface
from nlpgrasp.common.spatial import tangents
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray

FINE = 0.1  # radians between rows
LEVELS = (1, 4)  # times that the sides of a cell are halved for its rows


class EllipsoidCell(Cell):
    """A triangle, an arc or a point u of the unit sphere, mapped onto an ellipsoid about the origin by ``p = A u``.

    With ``A = diag(a)`` the outward normal is ``A^-1 u / g`` with ``g = |A^-1 u|``. Along a great circle of unit speed
    it turns at ``w = |n'| <= |A^-1| / g``, and in a frame that does not turn about it ``w' <= 2 w |g'| / g`` with
    ``|g'| = |u'^T A^-2 u| / g``. The work ``z = R^T v``, ``v = f + tau x p``, has ``v' = tau x A u'`` and
    ``v'' = -tau x A u``, so

        |z''|  <=  |tau| |p| + 2 |tau| w |A u'| + (w^2 + w') |v| ,

    with ``w |A u'| <= (k + 1/k) / (2 g)``, k the largest over the smallest semi-axis. On a sphere of radius r it is
    ``|z''| <= |v| + 2 r |tau|``. Let x_i lead from a point of a triangle along great circles to its corners: there are
    weights with ``sum l_i x_i = 0``, so that z is the corners' mean with these weights up to
    ``|z''| sum l_i |x_i|^2 / 2 <= |z''| R^2 / 2``, where a circle of radius R holds the x_i. Their distances are at
    most ``t / sin t`` times those of the corners on the sphere, t the longest side: that gives R.

    Parameters
    ----------
    corners : (m, 3) array
        Unit; three of a triangle, two of an arc, one of a point.
    semi_axes : (3,) array
        a, metres.
    """

    kind: ClassVar[str] = "ellipsoid"

    def __init__(self, corners: FloatArray, semi_axes: FloatArray) -> None:
        self.corners, self.a = corners, semi_axes

    def rows(self) -> Rows:
        """Return the corners of small triangles, each with the largest bend of those that meet there."""
        longest = _longest(self.corners)
        levels = int(np.clip(np.ceil(np.log2(max(longest / FINE, 1e-9))), *LEVELS)) if longest > 0.0 else 0
        parts = subdivided(self.corners[None], levels)
        bends = np.repeat(self._bends(parts), parts.shape[1], axis=0)
        u, where = np.unique(np.round(parts.reshape(-1, 3), 12), axis=0, return_inverse=True)
        u /= np.linalg.norm(u, axis=1, keepdims=True)
        most = np.zeros((len(u), 2, 3))
        np.maximum.at(most, np.ravel(where), bends)
        return Rows(u * self.a, inward_normals(u * self.a, self.a), most)

    def _bends(self, parts: FloatArray) -> FloatArray:
        """Return the bend of each small triangle or arc, (m, 4), with the work v at any of its corners."""
        large, small = float(np.max(self.a)), float(np.min(self.a))
        sides = _angles(parts, np.roll(parts, -1, axis=1))
        side = np.max(sides, axis=1)
        steps = _enclosing(sides) ** 2 / 2.0
        middle = parts.mean(axis=1)
        middle /= np.linalg.norm(middle, axis=1, keepdims=True)
        radius = np.max(_angles(parts, middle[:, None]), axis=1)
        g = np.maximum(np.linalg.norm(middle / self.a, axis=1) - radius / small, 1.0 / large)
        turn = 1.0 / (small * g)
        stretched = middle / self.a**2
        off = np.linalg.norm(stretched - np.sum(stretched * middle, axis=1, keepdims=True) * middle, axis=1)
        half = 0.5 * (1.0 / small**2 - 1.0 / large**2)
        rate = turn**2 + 2.0 * turn * np.minimum(half, off + 3.0 * half * radius) / g**2
        reach = np.minimum(large, np.linalg.norm(middle * self.a, axis=1) + large * radius)
        swept = 2.0 * large if large == small else reach + (large / small + small / large) / g
        apart = large * side  # from a corner to anywhere in the part
        second = [rate, swept + rate * apart, rate]
        first = [turn, large + turn * apart, turn]
        both = [
            np.stack([size * weight for weight in weights], axis=1)
            for size, weights in ((steps, second), (side, first))
        ]
        return np.stack(both, axis=1)

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
        return EllipsoidCell(first, self.a), EllipsoidCell(second, self.a)

    def cut(self) -> int:
        """Return the number i of the side from corner i to the next; the part with corner i comes first."""
        following = np.roll(self.corners, -1, axis=0)
        longest = np.round(np.linalg.norm((self.corners - following) * self.a, axis=1) / np.max(self.a), 9)
        return int(np.argmax(longest))

    def ball(self) -> tuple[FloatArray, float]:
        """Return the point in the middle, and the largest semi-axis times the angle to the farthest corner."""
        middle = self.corners.mean(axis=0)
        middle /= np.linalg.norm(middle)
        return middle * self.a, float(np.max(self.a) * np.max(_angles(self.corners, middle[None])))

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
        self.a = semi_axes

    def cells(self) -> Sequence[Cell]:
        """Return the eight octants."""
        return [EllipsoidCell(np.diag(signs).astype(float), self.a) for signs in product((1, -1), repeat=3)]

    def half_plane(self, axis: FloatArray, side: FloatArray) -> Sequence[Cell]:
        """Return arcs over the half-plane through an axis, unit, on the side of another unit vector across it."""
        return [EllipsoidCell(np.stack([end, side]), self.a) for end in (axis, -axis)]

    def moved(self, point: FloatArray, steps: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the points moved along the tangents and drawn back to the surface from the centre."""
        u = (point + steps @ tangents(inward_normals(point[None], self.a))[0]) / self.a
        points = u / np.linalg.norm(u, axis=1, keepdims=True) * self.a
        return points, inward_normals(points, self.a)


def inward_normals(points: FloatArray, semi_axes: FloatArray) -> FloatArray:
    """Return the unit inward normals at points of an ellipsoid about the origin, (m, 3)."""
    outward = points / semi_axes**2
    return np.asarray(-outward / np.linalg.norm(outward, axis=1, keepdims=True))


def subdivided(parts: FloatArray, levels: int) -> FloatArray:
    """Return the quarters of spherical triangles, the halves of arcs, time and again: (m, c, 3) to (m', c, 3)."""
    for _ in range(levels if parts.shape[1] > 1 else 0):
        middle = parts + np.roll(parts, -1, axis=1)
        middle /= np.linalg.norm(middle, axis=2, keepdims=True)
        if parts.shape[1] == 2:
            halves = [(parts[:, 0], middle[:, 0]), (middle[:, 0], parts[:, 1])]
            parts = np.concatenate([np.stack(h, axis=1) for h in halves])
        else:
            corners = [np.stack([parts[:, i], middle[:, i], middle[:, i - 1]], axis=1) for i in range(3)]
            parts = np.concatenate([*corners, middle])
    return parts


def _angles(u: FloatArray, v: FloatArray) -> FloatArray:
    """Return angles between unit vectors, exact for small ones, radians."""
    return np.asarray(2.0 * np.arcsin(np.minimum(0.5 * np.linalg.norm(u - v, axis=-1), 1.0)))


def _longest(corners: FloatArray) -> float:
    return float(np.max(_angles(corners, np.roll(corners, -1, axis=0))))


def _enclosing(sides: FloatArray) -> FloatArray:
    """Return the radius of the smallest circle around arcs, or triangles, with these sides as drawn in a plane, (m,).

    Sides (m, c) are angles on the sphere; in the plane that touches it they are longer, by ``t / sin t`` at most.
    """
    longest = np.max(sides, axis=1)
    if sides.shape[1] < 3:
        return np.asarray(0.5 * longest)
    a, b, c = (sides * (longest / np.sin(longest))[:, None]).T
    squares = a**2 + b**2 + c**2 - 2.0 * np.maximum(np.maximum(a, b), c) ** 2
    area = 0.25 * np.sqrt(np.maximum((a + b + c) * (b + c - a) * (a + c - b) * (a + b - c), 0.0))
    acute = (squares > 0.0) & (area > 0.0)
    round_ = a * b * c / (4.0 * np.where(acute, area, 1.0))
    return np.asarray(np.where(acute, round_, 0.5 * np.maximum(np.maximum(a, b), c)))
