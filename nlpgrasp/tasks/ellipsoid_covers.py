"""Ellipsoidal covers of discarded wrenches, and the minimum-volume ellipsoid around wrenches and covers.

A ``Cover`` stands for wrenches that are no longer kept one by one: an intersection of ellipsoids that contains them
all. ``least_around`` starts the search for dual weights (``nlpgrasp.tasks.enclosing_ellipsoid``) with the points on and
outside the previous ellipsoid. Covers are added like cutting planes: where one extends beyond the ellipsoid, its
farthest point joins the points. The remaining excess is removed by scaling the ellipsoid about its centre.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array
from nlpgrasp.errors import InputError
from nlpgrasp.tasks.enclosing_ellipsoid import FLAT, NEAR, MinVolume, NormalisedWrenches, levels, min_volume_ellipsoid

HALVINGS = 60  # bisection steps for the multiplier
GAP = 1e-5  # relative excess of volume at which the search for weights stops
TOUCHING, BEGINNING = 1e-4, 60  # warm-start points: relative distance from the boundary, most points
SLACK, CUTS = 1e-4, 60  # relative excess of covers that needs no cut; most rounds of cuts
ROUNDING = 1e-12  # relative enlargement against rounding


def least_around(kept: FloatArray, covers: Sequence[Cover], before: Around | None) -> Around:
    """Return the minimum-volume ellipsoid around wrenches and covers, or the previous one if it contains all.

    Parameters
    ----------
    kept : (n, d) array
    covers : sequence of Cover
        With the wrenches, at least two different points.
    before : Around, optional
        The minimum-volume ellipsoid around some of them.

    Raises
    ------
    InputError
        When there is only one point.
    """
    local = NormalisedWrenches.of(np.concatenate([kept, *(cover.ends() for cover in covers)]))
    known = None if before is None else before.within(local)
    points, inner = local.inward(kept), [cover.within(local) for cover in covers]
    if before is not None and known is not None and _reach(known, points, inner) <= 1.0 + NEAR:
        return before  # its gap still holds, since the minimum has not decreased
    asked = np.concatenate([points, *(cover.ends() for cover in inner if cover.given)])
    spanning = _spans(asked)
    if not spanning:
        asked = np.concatenate([points, *(cover.ends() for cover in inner)])
    found = min_volume_ellipsoid(asked, GAP, first=_beginning(known, asked))
    found, asked = _cut(found, asked, [cover for cover in inner if cover.given])
    least = _volume(found) / (1.0 + found.gap)
    found, _ = _cut(found, asked, inner)
    grown = found.axes * max(1.0, _reach(found, points, inner)) * (1.0 + ROUNDING)
    gap = _volume(MinVolume(found.center, grown, 0.0)) / least - 1.0 if spanning else None
    return Around(local.outward(found.center), local.outward_axes(grown), gap)


@dataclass(frozen=True)
class Around:
    """Ellipsoid ``{center + sum_j u_j axes_j, |u| <= 1}`` around wrenches and covers.

    Parameters
    ----------
    center : (d,) array
    axes : (r, d) array
        Fewer than d rows for a flat ellipsoid.
    gap : float or None
        Certified relative excess of its volume over the minimum around the wrenches and the given covers; ``None``
        where these span fewer directions than all covers.
    """

    center: FloatArray
    axes: FloatArray
    gap: float | None

    def within(self, local: NormalisedWrenches) -> MinVolume | None:
        """Return the ellipsoid in normalised coordinates, ``None`` if it is flat in them."""
        _, sizes, vectors = np.linalg.svd(local.inward_axes(self.axes), full_matrices=False)
        r = len(local.basis)
        if len(sizes) < r or sizes[-1] <= FLAT * sizes[0]:
            return None
        return MinVolume(local.inward(self.center[None])[0], sizes[:, None] * vectors, 0.0)


def _cut(found: MinVolume, points: FloatArray, covers: Sequence[Cover]) -> tuple[MinVolume, FloatArray]:
    """Return the minimum-volume ellipsoid around points and, up to the slack, covers, and the enlarged points."""
    for _ in range(CUTS):
        reached = [cover.farthest(found) for cover in covers]
        out = [point for level, point in reached if level > 1.0 + SLACK]
        if not out:
            break
        points = np.concatenate([points, out])
        found = min_volume_ellipsoid(points, GAP, first=_beginning(found, points))
    return found, points


def _reach(ellipsoid: MinVolume, points: FloatArray, covers: Sequence[Cover]) -> float:
    """Return the largest level of points and covers relative to an ellipsoid (1: its boundary)."""
    most = float(np.max(levels(points, ellipsoid.center, ellipsoid.axes), initial=0.0))
    return max([most, *(cover.farthest(ellipsoid)[0] for cover in covers)])


def _beginning(known: MinVolume | None, points: FloatArray) -> NDArray[np.intp] | None:
    """Return the indices of points on or outside an ellipsoid, ``None`` without one."""
    if known is None:
        return None
    level = levels(points, known.center, known.axes)
    outermost = np.argpartition(-level, min(BEGINNING, len(level)) - 1)[:BEGINNING]
    return np.asarray(outermost[level[outermost] >= min(1.0, level.max()) * (1.0 - TOUCHING)])


def _spans(points: FloatArray) -> bool:
    """Return whether points affinely span their space."""
    if len(points) <= points.shape[1]:
        return False
    sizes = np.linalg.svd(np.linalg.qr(points - points.mean(axis=0), mode="r"))[1]
    return bool(sizes[-1] > FLAT * sizes[0])


def _volume(ellipsoid: MinVolume) -> float:
    """Return the product of the semi-axes."""
    return float(np.prod(np.linalg.norm(ellipsoid.axes, axis=1)))


@dataclass(frozen=True)
class Cover:
    """Cover of discarded wrenches: an intersection of ellipsoids that contains all of them.

    Parameters
    ----------
    shapes : tuple of Shape
        At least one.
    given : bool
        Whether it is a task given as an ellipsoid, all of which has to be enclosed; it is then the only one.
    """

    shapes: tuple[Shape, ...]
    given: bool = False

    def ends(self) -> FloatArray:
        """Return the end points of the first ellipsoid's semi-axes, (2 m, d)."""
        return self.shapes[0].ends()

    def within(self, local: NormalisedWrenches) -> Cover:
        """Return the cover in normalised coordinates."""
        return Cover(tuple(shape.within(local) for shape in self.shapes), self.given)

    def farthest(self, ellipsoid: MinVolume) -> tuple[float, FloatArray]:
        """Return an upper bound of its level in an ellipsoid, and the farthest point (r,) of the decisive shape."""
        return min((farthest(shape, ellipsoid) for shape in self.shapes), key=lambda found: found[0])

    def to_dict(self) -> Json:
        """Return the cover as JSON data."""
        return {"in": [shape.to_dict() for shape in self.shapes], "given": self.given}

    @classmethod
    def from_dict(cls, data: Json, dimension: int, field: str) -> Cover:
        """Return the cover from the data of its ``to_dict``, checked against the dimension."""
        shapes = [Shape.from_dict(one, dimension, f"{field}.in.{i}") for i, one in enumerate(data["in"])]
        return cls(tuple(shapes), data["given"])


@dataclass(frozen=True)
class Shape:
    """Ellipsoid ``{center + sum_j v_j axes_j, |v| <= 1}``.

    Parameters
    ----------
    center : (d,) array
    axes : (m, d) array
    """

    center: FloatArray
    axes: FloatArray

    def ends(self) -> FloatArray:
        """Return the end points of its semi-axes, (2 m, d)."""
        return np.concatenate([self.center + self.axes, self.center - self.axes])

    def within(self, local: NormalisedWrenches) -> Shape:
        """Return the ellipsoid in normalised coordinates."""
        return Shape(local.inward(self.center[None])[0], local.inward_axes(self.axes))

    def to_dict(self) -> Json:
        """Return centre and semi-axes as JSON data."""
        return {"center": self.center.tolist(), "axes": self.axes.tolist()}

    @classmethod
    def from_dict(cls, data: Json, dimension: int, field: str) -> Shape:
        """Return the ellipsoid from the data of its ``to_dict``, checked against the dimension."""
        axes = array(f"{field}.axes", data["axes"], (None, dimension))
        if not np.any(axes):
            raise InputError(f"{field}.axes", "nothing but zeros", "at least one semi-axis")
        return cls(array(f"{field}.center", data["center"], (dimension,)), axes)


def farthest(shape: Shape, ellipsoid: MinVolume) -> tuple[float, FloatArray]:
    """Return a tight upper bound of one ellipsoid's level in another, and the farthest point (r,).

    In the other ellipsoid's coordinates it is the largest ``|b + B v|`` over ``|v| <= 1``, a trust-region subproblem:
    for every ``lam`` above the eigenvalues s of ``S = B^T B``, with ``g = B^T b``,

        ``|b + B v|^2 <= |b|^2 + lam + sum_i g_i^2 / (lam - s_i)``,

    since ``v^T S v + 2 g^T v - lam |v|^2`` is concave in v. The least of these bounds is attained (More and Sorensen
    1983, doi:10.1137/0904038): where ``sum_i g_i^2 / (lam - s_i)^2 = 1``, or at the largest eigenvalue.
    """
    out = np.linalg.solve(ellipsoid.axes.T, np.column_stack([shape.center - ellipsoid.center, shape.axes.T]))
    b, B = out[:, 0], out[:, 1:]
    s, vectors = np.linalg.eigh(B.T @ B)
    g = vectors.T @ (B.T @ b)

    def point(lam: float) -> FloatArray:
        return np.asarray(np.divide(g, lam - s, out=np.zeros_like(g), where=(g != 0.0) & (lam > s)))

    low, high = s[-1] + abs(g[-1]), s[-1] + float(np.linalg.norm(g))
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        if float(np.sum(point(middle) ** 2)) > 1.0:
            low = middle
        else:
            high = middle
    v = point(high)
    bound = float(b @ b + high + g @ v)
    v[-1] += np.copysign(max(0.0, 1.0 - float(v @ v)) ** 0.5, g[-1])  # hard case: along the last eigenvector
    v /= max(1.0, float(np.linalg.norm(v)))
    return max(bound, 0.0) ** 0.5, shape.center + (vectors @ v) @ shape.axes
