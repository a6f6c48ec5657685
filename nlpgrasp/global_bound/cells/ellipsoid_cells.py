"""Cells of ellipsoids and spheres: spherical triangles, arcs and points, mapped onto the surface.

``Spherical`` bounds how far a contact's work in a small part is off that at the part's corners.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from itertools import product
from typing import ClassVar

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.global_bound.cells.cell import CellFace, IntArray, RepresentativeContacts, SmallCurvedParts, SurfaceCell

FINE = 0.2  # radians between rows
LEVELS = (1, 4)  # times that the sides of a cell are halved for its rows


class EllipsoidCell(SurfaceCell):
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

    def rows(self) -> RepresentativeContacts:
        """Return the corners of small triangles, or arcs, and these."""
        longest = float(np.max(angles_along(self.corners, np.roll(self.corners, -1, axis=0))))
        levels = int(np.clip(np.ceil(np.log2(max(longest / FINE, 1e-9))), *LEVELS)) if longest > 0.0 else 0
        pairs, parts = grid(len(self.corners), levels)
        u = self.corners
        for first, second in pairs:
            middle = u[first] + u[second]
            u = np.concatenate([u, middle / np.linalg.norm(middle, axis=1, keepdims=True)])
        curved = SmallCurvedParts(self.patches, u[parts], parts)
        return RepresentativeContacts(*self.patches.contacts(u), curved=(curved,) if len(self.corners) > 1 else ())

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
        return middle * self.a, float(np.max(self.a) * np.max(angles_along(self.corners, middle[None])))

    def anchors(self) -> FloatArray:
        """Return the corners."""
        return self.corners * self.a

    def to_dict(self) -> Json:
        """Return the corners and the semi-axes."""
        return {"kind": self.kind, "corners": self.corners.tolist(), "semi_axes": self.a.tolist()}


class EllipsoidFace(CellFace):
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

    def cells(self) -> Sequence[SurfaceCell]:
        """Return the eight octants."""
        return [EllipsoidCell(np.diag(signs).astype(float), self.patches) for signs in product((1, -1), repeat=3)]

    def half_plane(self, axis: FloatArray, side: FloatArray) -> Sequence[SurfaceCell]:
        """Return arcs over the half-plane through an axis, unit, on the side of another unit vector across it."""
        return [EllipsoidCell(np.stack([end, side]), self.patches) for end in (axis, -axis)]


class Spherical:
    """Parts of an ellipsoid about the origin: triangles, arcs and points u of the unit sphere, ``p = A u``.

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
    semi_axes : (3,) array
        a, metres.
    """

    def __init__(self, semi_axes: FloatArray) -> None:
        self.a = semi_axes

    def contacts(self, coordinates: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return points and inward normals at unit vectors (m, 3)."""
        points = coordinates * self.a
        return points, ellipsoid_inward_normals(points, self.a)

    def bends(self, parts: FloatArray) -> FloatArray:
        """Return the bends of small triangles or arcs (n, c, 3), (n, 2, 3)."""
        large, small = float(np.max(self.a)), float(np.min(self.a))
        a = self.a[:, None]
        corners = np.ascontiguousarray(parts.transpose(1, 2, 0))  # (c, 3, n): rows of n run fast
        sides = angles_along(corners, np.roll(corners, -1, axis=0), axis=1)
        side = np.max(sides, axis=0)
        steps = _circumradius(sides) ** 2 / 2.0
        middle = np.mean(corners, axis=0)
        middle /= _vector_lengths(middle)
        radius = np.max(angles_along(corners, middle, axis=1), axis=0)
        g = np.maximum(_vector_lengths(middle / a) - radius / small, 1.0 / large)
        turn = 1.0 / (small * g)
        stretched = middle / a**2
        off = _vector_lengths(stretched - np.sum(stretched * middle, axis=0) * middle)
        half = 0.5 * (1.0 / small**2 - 1.0 / large**2)
        rate = turn**2 + 2.0 * turn * np.minimum(half, off + 3.0 * half * radius) / g**2
        reach = np.minimum(large, _vector_lengths(middle * a) + large * radius)
        swept = np.full(len(parts), 2.0 * large) if large == small else reach + (large / small + small / large) / g
        apart = large * side  # from a corner to anywhere in the part
        second = np.stack([rate, swept + rate * apart, rate], axis=1)
        first = np.stack([turn, large + turn * apart, turn], axis=1)
        return np.stack([steps[:, None] * second, side[:, None] * first], axis=1)

    def subdivide(self, parts: FloatArray) -> tuple[FloatArray, IntArray]:
        """Return the quarters of triangles (n, 3, 3), the halves of arcs (n, 2, 3), as corners and which."""
        pairs, into = grid(parts.shape[1], 1)
        (first, second), *_ = pairs
        middle = parts[:, first] + parts[:, second]
        middle /= np.linalg.norm(middle, axis=2, keepdims=True)
        return np.concatenate([parts, middle], axis=1), into


def ellipsoid_inward_normals(points: FloatArray, semi_axes: FloatArray) -> FloatArray:
    """Return the unit inward normals at points of an ellipsoid about the origin, (m, 3)."""
    outward = points / semi_axes**2
    return np.asarray(-outward / np.linalg.norm(outward, axis=1, keepdims=True))


@cache
def grid(corners: int, levels: int) -> tuple[tuple[tuple[IntArray, IntArray], ...], IntArray]:
    """Return how a triangle, an arc or a point is cut into quarters, or halves, time and again.

    Returns
    -------
    pairs : tuple of pairs of (s,) arrays
        Of each level, the vertices between which new ones are; vertices are numbered in the order in which they appear.
    parts : (n, corners) array
        The vertices of each part of the last level.
    """
    parts = [tuple(range(corners))]
    pairs, count = [], corners
    for _ in range(levels if corners > 1 else 0):
        new: dict[tuple[int, int], int] = {}
        finer: list[tuple[int, ...]] = []
        for part in parts:
            sides = [tuple(sorted((a, b))) for a, b in zip(part, (*part[1:], part[0]), strict=True)]
            middles = [new.setdefault((a, b), count + len(new)) for a, b in sides]
            if corners == 2:
                finer += [(part[0], middles[0]), (middles[0], part[1])]
            else:
                finer += [(part[i], middles[i], middles[i - 1]) for i in range(3)]
                finer.append(tuple(middles))
        ends = np.array(list(new))
        pairs.append((ends[:, 0], ends[:, 1]))
        parts, count = finer, count + len(new)
    return tuple(pairs), np.array(parts)


def angles_along(u: FloatArray, v: FloatArray, axis: int = -1) -> FloatArray:
    """Return angles between unit vectors along an axis, exact for small ones, radians."""
    apart = np.sqrt(np.sum((u - v) ** 2, axis=axis))
    return np.asarray(2.0 * np.arcsin(np.minimum(0.5 * apart, 1.0)))


def _vector_lengths(v: FloatArray) -> FloatArray:
    """Return the lengths of vectors (3, n), (n,)."""
    return np.asarray(np.sqrt(np.sum(v**2, axis=0)))


def _circumradius(sides: FloatArray) -> FloatArray:
    """Return the radius of the smallest circle around arcs, or plane triangles, with these side lengths, (m,).

    Sides (c, m) are angles on the sphere; in the plane that touches it they are longer, by ``t / sin t`` at most.
    """
    longest = np.max(sides, axis=0)
    if len(sides) < 3:
        return np.asarray(0.5 * longest)
    a, b, c = sides * (longest / np.sin(longest))
    squares = a**2 + b**2 + c**2 - 2.0 * np.maximum(np.maximum(a, b), c) ** 2
    area = 0.25 * np.sqrt(np.maximum((a + b + c) * (b + c - a) * (a + c - b) * (a + b - c), 0.0))
    acute = (squares > 0.0) & (area > 0.0)
    round_ = a * b * c / (4.0 * np.where(acute, area, 1.0))
    return np.asarray(np.where(acute, round_, 0.5 * np.maximum(np.maximum(a, b), c)))
