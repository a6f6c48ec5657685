"""Cells of an ellipsoid about the origin: images of spherical triangles, arcs and points."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array
from nlpgrasp.verify.bodies.smooth import positive
from nlpgrasp.verify.bound.cells.cell import Cut, Rows, Sheet, one_of

SPACING = 0.3  # radians: largest side of the initial parts
MOST = 3  # most halvings of sides to get there
UNIT = 1e-9


@dataclass(frozen=True)
class EllipsoidSheet:
    """The image under ``diag(axes)`` of a spherical triangle, arc or point.

    Parameters
    ----------
    corners : (c, 3) array
        Unit vectors; the coordinates of a point are its unit vector.
    axes : (3,) array
        Metres.
    """

    corners: FloatArray
    axes: FloatArray

    def start(self) -> FloatArray:
        """Return the initial triangles or arcs."""
        found = self.corners[None]
        for _ in range(MOST):
            if float(np.max(_sides(found))) <= SPACING:
                break
            found = self.halved(found)
        return found

    def contacts(self, places: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return points and inward normals at unit vectors (m, 3)."""
        inward = -places / self.axes
        return places * self.axes, inward / np.linalg.norm(inward, axis=1, keepdims=True)

    def bends(self, parts: FloatArray) -> FloatArray:
        """Return the interpolation coefficients (m, 2, 3) of small parts (m, c, 3).

        On a great circle of unit speed, the normal ``A^-1 u / g``, ``g = |A^-1 u|``, turns at ``w <= |A^-1| / g``, and
        its rate of turning changes by at most ``2 w |u'^T A^-2 u| / g^2``.
        """
        long, short = float(self.axes.max()), float(self.axes.min())
        side = _sides(parts)
        centre = np.sum(parts, axis=1)
        centre /= np.linalg.norm(centre, axis=1, keepdims=True)
        reach = np.max(between(parts, centre[:, None]), axis=1)
        g = np.maximum(np.linalg.norm(centre / self.axes, axis=1) - reach / short, 1.0 / long)
        w = 1.0 / (short * g)
        squared = centre / self.axes**2
        slope = np.linalg.norm(squared - centre * np.sum(centre * squared, axis=1, keepdims=True), axis=1)
        steepest = 0.5 * (1.0 / short**2 - 1.0 / long**2)
        quick = w**2 + 2.0 * w * np.minimum(steepest, slope + 3.0 * steepest * reach) / g**2
        if long == short:
            arm = np.full(len(parts), 2.0 * long)
        else:
            farthest = np.minimum(long, np.linalg.norm(centre * self.axes, axis=1) + long * reach)
            arm = farthest + (long / short + short / long) / g
        bowed = 0.5 * _radius(parts) ** 2
        off = np.column_stack([quick, arm + quick * long * side, quick]) * bowed[:, None]
        more = np.column_stack([w, long + w * long * side, w]) * side[:, None]
        return np.stack([off, more], axis=1)

    def halved(self, parts: FloatArray) -> FloatArray:
        """Return four triangles for each (n, 3, 3), two arcs for each (n, 2, 3)."""
        middles = parts + np.roll(parts, -1, axis=1)
        middles /= np.linalg.norm(middles, axis=2, keepdims=True)
        if parts.shape[1] == 2:
            ends = [(parts[:, 0], middles[:, 0]), (middles[:, 0], parts[:, 1])]
            made = [np.stack(pair, axis=1) for pair in ends]
        else:
            made = [np.stack([parts[:, i], middles[:, i], middles[:, (i + 2) % 3]], axis=1) for i in range(3)]
            made.append(middles)
        return np.stack(made, axis=1).reshape(-1, *parts.shape[1:])


def _sides(parts: FloatArray) -> FloatArray:
    """Return the longest side of each part, radians, (n,)."""
    return np.asarray(np.max(between(parts, np.roll(parts, -1, axis=1)), axis=1))


def _radius(parts: FloatArray) -> FloatArray:
    """Return the circumradius of each part, developed into the plane from any of its points, (m,).

    Developed along great circles from one of its points, a part has sides at most ``t / sin t`` times as long, t the
    longest: the radius is then that of the circumcircle for an acute triangle, half the longest side for others.
    """
    ends = between(parts, np.roll(parts, -1, axis=1))
    long = np.max(ends, axis=1)
    if parts.shape[1] < 3:
        return np.asarray(0.5 * long)
    c, b, a = np.sort(ends * (long / np.sin(long))[:, None], axis=1).T
    cosine = (b**2 + c**2 - a**2) / (2.0 * b * c)  # cosine of the largest angle
    sine = np.sqrt(np.maximum(1.0 - cosine**2, 0.0))
    return np.asarray(np.where((cosine > 0.0) & (sine > 0.0), 0.5 * a / np.where(sine > 0.0, sine, 1.0), 0.5 * a))


def between(u: FloatArray, v: FloatArray) -> FloatArray:
    """Return the angles between unit vectors, radians."""
    return np.asarray(2.0 * np.arcsin(np.minimum(1.0, 0.5 * np.linalg.norm(u - v, axis=-1))))


@dataclass(frozen=True)
class Ellipsoid:
    """The image under ``diag(semi_axes)`` of the spherical convex hull of one to three corners.

    Parameters
    ----------
    data : mapping
        ``corners`` (1 to 3, 3), unit, and ``semi_axes`` (3,), metres.
    """

    data: Json

    @cached_property
    def corners(self) -> FloatArray:
        """Unit vectors (c, 3)."""
        found = array("corners", self.data["corners"], (None, 3))
        good = 1 <= len(found) <= 3 and np.all(np.abs(np.linalg.norm(found, axis=1) - 1.0) <= UNIT)
        if not good or np.min(found @ found.T) < -UNIT:
            raise ValueError("corners that are not one to three unit vectors within a right angle of each other")
        return found

    @cached_property
    def axes(self) -> FloatArray:
        """Semi-axes (3,), metres."""
        return positive("semi_axes", self.data["semi_axes"], 3)

    def rows(self) -> Rows:
        """Return the point itself for a cell of one point."""
        if len(self.corners) > 1:
            return Rows.none()
        return Rows(*EllipsoidSheet(self.corners, self.axes).contacts(self.corners))

    def sheets(self) -> list[Sheet]:
        """Return the triangle or arc as a curved part."""
        return [EllipsoidSheet(self.corners, self.axes)] if len(self.corners) > 1 else []

    def parts(self, cut: Cut) -> tuple[Ellipsoid, Ellipsoid]:
        """Return both halves of a cut from the middle of a side to the opposite corner."""
        first = one_of(cut, len(self.corners))
        second = (first + 1) % len(self.corners)
        middle = self.corners[first] + self.corners[second]
        middle = middle / np.linalg.norm(middle)
        return self._with(second, middle), self._with(first, middle)

    def _with(self, corner: int, place: FloatArray) -> Ellipsoid:
        corners = self.corners.tolist()
        corners[corner] = place.tolist()
        return Ellipsoid({**self.data, "corners": corners})

    def hull(self) -> tuple[FloatArray, float]:
        """Return the cell's middle point, and the largest semi-axis times the angle to the farthest corner."""
        middle = np.sum(self.corners, axis=0)
        middle /= np.linalg.norm(middle)
        return (middle * self.axes)[None], float(self.axes.max() * np.max(between(self.corners, middle[None])))

    def anchors(self) -> FloatArray:
        """Return the corners on the ellipsoid."""
        return self.corners * self.axes
