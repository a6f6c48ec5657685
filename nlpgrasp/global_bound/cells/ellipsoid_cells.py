"""Cells of ellipsoids and spheres: spherical triangles, arcs and points, mapped onto the surface.

``EllipsoidSurface`` bounds the deviation of a contact's work inside a small part from that at its corners.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from itertools import product
from typing import ClassVar

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, IntArray
from nlpgrasp.global_bound.cells.cell import CellFace, CurvedParts, RepresentativeContacts, SurfaceCell

FINE = 0.2  # radians, largest angle between rows
LEVELS = (1, 4)  # least and largest number of halvings of a cell's sides for its rows


class EllipsoidCell(SurfaceCell):
    """Cell of an ellipsoid: a triangle, an arc or a point u of the unit sphere, mapped by ``p = A u``.

    Parameters
    ----------
    corners : (m, 3) array
        Unit vectors: three of a triangle, two of an arc, one of a point.
    surface : EllipsoidSurface
    """

    kind: ClassVar[str] = "ellipsoid"

    def __init__(self, corners: FloatArray, surface: EllipsoidSurface) -> None:
        self.corners, self.surface, self.a = corners, surface, surface.a

    def representative_contacts(self) -> RepresentativeContacts:
        """Return the corners of small triangles or arcs that cover the cell."""
        longest_side = float(np.max(angles_along(self.corners, np.roll(self.corners, -1, axis=0))))
        levels = int(np.clip(np.ceil(np.log2(max(longest_side / FINE, 1e-9))), *LEVELS)) if longest_side > 0.0 else 0
        pairs, parts = subdivision_grid(len(self.corners), levels)
        u = self.corners
        for first, second in pairs:
            midpoints = u[first] + u[second]
            u = np.concatenate([u, midpoints / np.linalg.norm(midpoints, axis=1, keepdims=True)])
        curved = CurvedParts(self.surface, u[parts], parts)
        return RepresentativeContacts(*self.surface.contacts(u), curved=(curved,) if len(self.corners) > 1 else ())

    def split(self) -> tuple[EllipsoidCell, ...]:
        """Return both halves, cut at the middle of the longest side; a point returns itself alone.

        The longest side is that on the ellipsoid.
        """
        if len(self.corners) == 1:
            return (self,)
        i = self.cut()
        j = (i + 1) % len(self.corners)
        midpoint = self.corners[i] + self.corners[j]
        midpoint /= np.linalg.norm(midpoint)
        first, second = self.corners.copy(), self.corners.copy()
        first[j], second[i] = midpoint, midpoint
        return EllipsoidCell(first, self.surface), EllipsoidCell(second, self.surface)

    def cut(self) -> int:
        """Return the index i of the side that is cut, from corner i to the next.

        The half with corner i comes first.
        """
        next_corners = np.roll(self.corners, -1, axis=0)
        lengths = np.round(np.linalg.norm((self.corners - next_corners) * self.a, axis=1) / np.max(self.a), 9)
        return int(np.argmax(lengths))

    def ball(self) -> tuple[FloatArray, float]:
        """Return a ball about the central point; its radius is the largest semi-axis times the largest angle.

        The angle is that from the central point to a corner.
        """
        centre = self.corners.mean(axis=0)
        centre /= np.linalg.norm(centre)
        return centre * self.a, float(np.max(self.a) * np.max(angles_along(self.corners, centre[None])))

    def anchors(self) -> FloatArray:
        """Return the corners of the cell on the ellipsoid."""
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
        self.a, self.surface = semi_axes, EllipsoidSurface(semi_axes)

    def cells(self) -> Sequence[SurfaceCell]:
        """Return the eight octants of the ellipsoid."""
        return [EllipsoidCell(np.diag(signs).astype(float), self.surface) for signs in product((1, -1), repeat=3)]

    def half_plane(self, axis: FloatArray, side: FloatArray) -> Sequence[SurfaceCell]:
        """Return the cells of the ellipsoid's meridian in one half-plane about an axis.

        ``axis`` and ``side`` are orthogonal unit vectors. The two arcs lead from ``side``, in the half-plane, to the
        ends of the axis.
        """
        return [EllipsoidCell(np.stack([end, side]), self.surface) for end in (axis, -axis)]


class EllipsoidSurface:
    """Surface of an ellipsoid about the origin: triangles, arcs and points u of the unit sphere, ``p = A u``.

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

    def deviations(self, parts: FloatArray) -> FloatArray:
        """Return the coefficients (n, 2, 3) of ``CurvedSurface.deviations`` for triangles or arcs (n, c, 3)."""
        longest_axis = float(np.max(self.a))
        corners = np.ascontiguousarray(parts.transpose(1, 2, 0))  # (c, 3, n): rows of n run fast
        sides = angles_along(corners, np.roll(corners, -1, axis=0), axis=1)
        longest_side, half_squared_radius = np.max(sides, axis=0), _circumradius(sides) ** 2 / 2.0
        centre = np.mean(corners, axis=0)
        centre /= _vector_lengths(centre)
        radius = np.max(angles_along(corners, centre, axis=1), axis=0)
        turn_rate, normal_acceleration, torque_acceleration = self._derivative_bounds(centre, radius)
        # from a corner to any point of the part, where |v| is larger by |tau| distance at most
        distance = longest_axis * longest_side
        # columns: of |v| and of |tau| in the force part of z, of |tau| in its moment part
        second_derivative = np.stack(
            [normal_acceleration, torque_acceleration + normal_acceleration * distance, normal_acceleration], axis=1
        )
        first_derivative = np.stack([turn_rate, longest_axis + turn_rate * distance, turn_rate], axis=1)
        from_interpolation = half_squared_radius[:, None] * second_derivative
        return np.stack([from_interpolation, longest_side[:, None] * first_derivative], axis=1)

    def _derivative_bounds(self, centre: FloatArray, radius: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return upper bounds in parts on the normal's turn rate, its acceleration and the torque's, (n,) each.

        Along unit-speed arcs u of the sphere, these bound the turn rate w, ``w^2 + w'`` and ``|p| + 2 w |A u'|``. Every
        point u of a part is within ``radius`` (n,), radians, of its ``centre`` (3, n).
        """
        large, small = float(np.max(self.a)), float(np.min(self.a))
        a = self.a[:, None]
        g = np.maximum(_vector_lengths(centre / a) - radius / small, 1.0 / large)  # lower bound
        turn_rate = 1.0 / (small * g)  # w <= |A^-1| / g
        # |u'^T A^-2 u|: at the centre the length of the tangential part of A^-2 u, which changes at a limited rate
        stretched = centre / a**2
        tangential = _vector_lengths(stretched - np.sum(stretched * centre, axis=0) * centre)
        largest_tangential = 0.5 * (1.0 / small**2 - 1.0 / large**2)
        tangential = np.minimum(largest_tangential, tangential + 3.0 * largest_tangential * radius)
        # w' <= 2 w |g'| / g, |g'| <= tangential / g
        normal_acceleration = turn_rate**2 + 2.0 * turn_rate * tangential / g**2
        largest_distance = np.minimum(large, _vector_lengths(centre * a) + large * radius)  # |p|
        ratio = large / small + small / large  # k + 1 / k, with 2 w |A u'| <= (k + 1 / k) / g
        torque_acceleration = np.full(len(radius), 2.0 * large) if large == small else largest_distance + ratio / g
        return turn_rate, normal_acceleration, torque_acceleration

    def subdivide(self, parts: FloatArray) -> tuple[FloatArray, IntArray]:
        """Return quarters of triangles (n, 3, 3), or halves of arcs (n, 2, 3), as vertices and vertex indices."""
        pairs, corner_indices = subdivision_grid(parts.shape[1], 1)
        (first, second), *_ = pairs
        midpoints = parts[:, first] + parts[:, second]
        midpoints /= np.linalg.norm(midpoints, axis=2, keepdims=True)
        return np.concatenate([parts, midpoints], axis=1), corner_indices


def ellipsoid_inward_normals(points: FloatArray, semi_axes: FloatArray) -> FloatArray:
    """Return the unit inward normals at points of an ellipsoid about the origin, (m, 3)."""
    outward = points / semi_axes**2
    return np.asarray(-outward / np.linalg.norm(outward, axis=1, keepdims=True))


@cache
def subdivision_grid(corners: int, levels: int) -> tuple[tuple[tuple[IntArray, IntArray], ...], IntArray]:
    """Return the repeated subdivision of a triangle into quarters, or of an arc into halves.

    Returns
    -------
    pairs : tuple of pairs of (s,) arrays
        For each level, the vertices whose midpoints are the new vertices, numbered in order of appearance.
    parts : (n, corners) array
        The vertices of each part of the last level.
    """
    parts = [tuple(range(corners))]
    pairs, vertex_count = [], corners
    for _ in range(levels if corners > 1 else 0):
        midpoints: dict[tuple[int, int], int] = {}
        smaller_parts: list[tuple[int, ...]] = []
        for part in parts:
            sides = [tuple(sorted((a, b))) for a, b in zip(part, (*part[1:], part[0]), strict=True)]
            indices = [midpoints.setdefault((a, b), vertex_count + len(midpoints)) for a, b in sides]
            if corners == 2:
                smaller_parts += [(part[0], indices[0]), (indices[0], part[1])]
            else:
                smaller_parts += [(part[i], indices[i], indices[i - 1]) for i in range(3)]
                smaller_parts.append(tuple(indices))
        pair_array = np.array(list(midpoints))
        pairs.append((pair_array[:, 0], pair_array[:, 1]))
        parts, vertex_count = smaller_parts, vertex_count + len(midpoints)
    return tuple(pairs), np.array(parts)


def angles_along(u: FloatArray, v: FloatArray, axis: int = -1) -> FloatArray:
    """Return angles between unit vectors, radians, accurate for small angles.

    The vectors' components are along an array ``axis``.
    """
    chords = np.sqrt(np.sum((u - v) ** 2, axis=axis))
    return np.asarray(2.0 * np.arcsin(np.minimum(0.5 * chords, 1.0)))


def _vector_lengths(v: FloatArray) -> FloatArray:
    """Return the lengths of vectors (3, n), (n,)."""
    return np.asarray(np.sqrt(np.sum(v**2, axis=0)))


def _circumradius(sides: FloatArray) -> FloatArray:
    """Return the radius of the smallest circle around arcs, or plane triangles, of given side lengths, (m,).

    Sides (c, m) are angles on the sphere; in the plane that touches it they are longer, by ``t / sin t`` at most.
    """
    longest = np.max(sides, axis=0)
    if len(sides) < 3:
        return np.asarray(0.5 * longest)
    a, b, c = sides * (longest / np.sin(longest))
    squares = a**2 + b**2 + c**2 - 2.0 * np.maximum(np.maximum(a, b), c) ** 2
    area = 0.25 * np.sqrt(np.maximum((a + b + c) * (b + c - a) * (a + c - b) * (a + b - c), 0.0))
    is_acute = (squares > 0.0) & (area > 0.0)
    circumradius = a * b * c / (4.0 * np.where(is_acute, area, 1.0))
    return np.asarray(np.where(is_acute, circumradius, 0.5 * np.maximum(np.maximum(a, b), c)))
