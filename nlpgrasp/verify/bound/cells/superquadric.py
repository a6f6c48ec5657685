"""Rectangles of angles on an octant of a superquadric."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise, product

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array
from nlpgrasp.verify.bodies.smooth import positive
from nlpgrasp.verify.bound.cells.cell import Cut, Rows, Sheet, halves, increasing, one_of

ROUNDED = 1e-7  # of the largest semi-axis: the body is rounded at its planes of symmetry
PARTS = 4  # to begin with, either way


@dataclass(frozen=True)
class Superquadric:
    """A rectangle of two angles, which stand for t and w, on the octant with given signs.

    An angle u stands for t by ``tan t = (tan u)^(1 / m)``, m the smaller of e and 2 - e.
    A point is ``(a cos(t)^e1 cos(w)^e2, b cos(t)^e1 sin(w)^e2, c sin(t)^e1)``, its outward normal along
    ``(cos(t)^(2 - e1) cos(w)^(2 - e2) / a, cos(t)^(2 - e1) sin(w)^(2 - e2) / b, sin(t)^(2 - e1) / c)``.

    Parameters
    ----------
    data : mapping
        ``semi_axes`` (3,), metres; ``exponents`` (2,); ``signs`` (3,); ``angles`` and ``along``,
        radians.
    """

    data: Json

    @cached_property
    def axes(self) -> FloatArray:
        """Semi-axes, (3,), metres."""
        return positive("semi_axes", self.data["semi_axes"], 3)

    @cached_property
    def exponents(self) -> FloatArray:
        """e1 and e2."""
        found = positive("exponents", self.data["exponents"], 2)
        if np.any(found >= 2.0):
            raise ValueError("an exponent that is 2 or more")
        return found

    @cached_property
    def signs(self) -> FloatArray:
        """1 or -1 for each coordinate, (3,)."""
        found = array("signs", self.data["signs"], (3,))
        if not np.all(np.abs(found) == 1.0):
            raise ValueError("signs that are not 1 or -1")
        return found

    @cached_property
    def angles(self) -> FloatArray:
        """Both ends of the angle for t."""
        return _quarter("angles", self.data["angles"])

    @cached_property
    def along(self) -> FloatArray:
        """Both ends of the angle for w."""
        return _quarter("along", self.data["along"])

    def rows(self) -> Rows:
        """Return none."""
        return Rows.none()

    def sheets(self) -> list[Sheet]:
        """Return the rectangle."""
        return [self]

    def places(self, count: int) -> FloatArray:
        """Return rectangles (n, 4, 2), so many either way: (low, low), (low, high), (high, low), (high, high)."""
        grids = [np.linspace(float(ends[0]), float(ends[1]), count + 1) for ends in (self.angles, self.along)]
        sides = [list(pairwise(grid)) for grid in grids]
        return np.array([list(product(a, b)) for a, b in product(*sides)])

    def start(self) -> FloatArray:
        """Return the rectangles to begin with."""
        return self.places(PARTS)

    def contacts(self, places: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return points and inward normals at two angles, (m, 2)."""
        outward = _unit(places, 2.0 - self.exponents) / self.axes
        length = np.linalg.norm(outward, axis=1, keepdims=True)
        return self.signs * self.axes * _unit(places, self.exponents), -self.signs * outward / length

    def bends(self, parts: FloatArray) -> FloatArray:
        """Return ``[turn, apart, turn]`` twice for each rectangle: how far normals and points in it are apart.

        Their coordinates rise or fall with each angle, so that those of the corners enclose all: two vectors of a box
        about m with the half diagonal h are no further apart than ``2 asin(|h| / |m|)``.
        """
        n, c, _ = parts.shape
        places = _unit(parts.reshape(n * c, 2), self.exponents).reshape(n, c, 3) * self.axes
        apart = np.linalg.norm(places.max(axis=1) - places.min(axis=1), axis=1) + ROUNDED * self.axes.max()
        normals = _unit(parts.reshape(n * c, 2), 2.0 - self.exponents).reshape(n, c, 3) / self.axes
        upper, lower = normals.max(axis=1), normals.min(axis=1)
        ratio = np.linalg.norm(upper - lower, axis=1) / np.linalg.norm(upper + lower, axis=1)
        turn = 2.0 * np.arcsin(np.minimum(ratio, 1.0))
        own = np.stack([turn, apart, turn], axis=1)
        return np.stack([own, own], axis=1)

    def halved(self, parts: FloatArray) -> FloatArray:
        """Return four rectangles for each."""
        made = []
        for part in parts:
            ends = [(a, 0.5 * (a + b), b) for a, b in zip(part[0], part[-1], strict=True)]
            sides = [[(e[0], e[1]), (e[1], e[2])] for e in ends]
            made += [list(product(a, b)) for a, b in product(*sides)]
        return np.array(made)

    def parts(self, cut: Cut) -> tuple[Superquadric, Superquadric]:
        """Return the halves of the first angle, 0, or of the second, 1."""
        key, interval = (("angles", self.angles), ("along", self.along))[one_of(cut, 2)]
        low, high = halves(interval)
        return Superquadric({**self.data, key: low.tolist()}), Superquadric({**self.data, key: high.tolist()})

    def hull(self) -> tuple[FloatArray, float]:
        """Return the middle of the box of the corners, and half its diagonal."""
        corners = self.contacts(self.places(1)[0])[0]
        low, high = corners.min(axis=0), corners.max(axis=0)
        return 0.5 * (low + high)[None], 0.5 * float(np.linalg.norm(high - low))

    def anchors(self) -> FloatArray:
        """Return the corners, the middles of the sides and the middle."""
        corners = self.places(2).reshape(-1, 2)
        return self.contacts(np.unique(corners, axis=0))[0]


def _quarter(name: str, data: list[float]) -> FloatArray:
    """Return an interval of angles within a quarter turn."""
    found = increasing(name, array(name, data, (2,)))
    if found[0] < 0.0 or found[1] > 0.5 * np.pi:
        raise ValueError(f"{name} beyond a quarter turn")
    return found


def _unit(places: FloatArray, exponents: FloatArray) -> FloatArray:
    """Return the octant of unit size at two angles, (m, 2), (m, 3)."""
    (first, second), (e, f) = places.T, exponents
    (cos_t, sin_t), (cos_w, sin_w) = _steep(first, e), _steep(second, f)
    return np.column_stack([cos_t**e * cos_w**f, cos_t**e * sin_w**f, sin_t**e])


def _steep(angle: FloatArray, exponent: float) -> tuple[FloatArray, FloatArray]:
    """Return cosine and sine of the t that an angle stands for."""
    m = min(exponent, 2.0 - exponent)
    from_zero = angle <= 0.25 * np.pi
    near = np.tan(np.clip(np.where(from_zero, angle, 0.5 * np.pi - angle), 0.0, 0.25 * np.pi)) ** (1.0 / m)
    one, other = 1.0 / np.sqrt(1.0 + near**2), near / np.sqrt(1.0 + near**2)
    return np.where(from_zero, one, other), np.where(from_zero, other, one)
