"""Minimum-volume ellipsoid around wrenches and ellipsoids, by cutting planes.

Where an inner ellipsoid extends beyond the ellipsoid around the points, its farthest point joins the points. The
remaining excess is removed by scaling the ellipsoid about its centre.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array
from nlpgrasp.errors import InputError
from nlpgrasp.tasks.enclosing_ellipsoid import (
    FLAT,
    INSIDE,
    ROUNDING,
    MinVolumeEllipsoid,
    NormalisedWrenches,
    ellipsoid_norms,
    min_volume_ellipsoid,
)

GAP = 1e-5  # relative excess of volume at which the search for weights stops
SLACK, CUTS = 1e-4, 60  # relative excess of inner ellipsoids that needs no cut; most rounds of cuts
HALVINGS = 60  # bisection steps for the multiplier


@dataclass(frozen=True)
class InnerEllipsoid:
    """Ellipsoid ``{center + sum_j v_j axes_j, |v| <= 1}`` that has to be enclosed.

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

    def normalised(self, local: NormalisedWrenches) -> InnerEllipsoid:
        """Return the ellipsoid in normalised coordinates."""
        return InnerEllipsoid(local.normalise(self.center[None])[0], local.normalise_axes(self.axes))

    def to_dict(self) -> Json:
        """Return centre and semi-axes as JSON data."""
        return {"center": self.center.tolist(), "axes": self.axes.tolist()}

    @classmethod
    def from_dict(cls, data: Json, dimension: int, field: str) -> InnerEllipsoid:
        """Return the ellipsoid from the data of its ``to_dict``, checked against the dimension."""
        axes = array(f"{field}.axes", data["axes"], (None, dimension))
        if not np.any(axes):
            raise InputError(f"{field}.axes", "nothing but zeros", "at least one semi-axis")
        return cls(array(f"{field}.center", data["center"], (dimension,)), axes)


@dataclass(frozen=True)
class OuterEllipsoid:
    """Ellipsoid ``{center + sum_j u_j axes_j, |u| <= 1}`` around wrenches and inner ellipsoids.

    Parameters
    ----------
    center : (d,) array
    axes : (r, d) array
        Fewer than d rows for a flat ellipsoid.
    gap : float or None
        Certified relative excess of its volume over the minimum; ``None`` if unknown.
    """

    center: FloatArray
    axes: FloatArray
    gap: float | None

    def normalised(self, local: NormalisedWrenches) -> MinVolumeEllipsoid | None:
        """Return the ellipsoid in normalised coordinates, or ``None`` if it is flat."""
        _, sizes, vectors = np.linalg.svd(local.normalise_axes(self.axes), full_matrices=False)
        if len(sizes) < len(local.basis) or sizes[-1] <= FLAT * sizes[0]:
            return None
        return MinVolumeEllipsoid(local.normalise(self.center[None])[0], sizes[:, None] * vectors, 0.0)


def enclose_wrenches(
    wrenches: FloatArray, inner: Sequence[InnerEllipsoid], previous: OuterEllipsoid | None = None
) -> OuterEllipsoid:
    """Return the minimum-volume ellipsoid around wrenches and ellipsoids, or the previous one if it contains them all.

    Parameters
    ----------
    wrenches : (n, d) array
    inner : sequence of InnerEllipsoid
        With the wrenches, at least two different points.
    previous : OuterEllipsoid, optional
        The minimum-volume ellipsoid around some of them.

    Raises
    ------
    InputError
        When there is only one point.
    """
    local = NormalisedWrenches.of(np.concatenate([wrenches, *(ellipsoid.ends() for ellipsoid in inner)]))
    points, inner = local.points[: len(wrenches)], [ellipsoid.normalised(local) for ellipsoid in inner]
    if previous is not None:
        ellipsoid = previous.normalised(local)
        if ellipsoid is not None and _largest_norm(ellipsoid, points, inner) <= 1.0 + INSIDE:
            return previous  # its gap still holds, since the minimum has not decreased
    result = _enclose_by_cutting_planes(local.points, inner)
    scale = max(1.0, _largest_norm(result, points, inner)) * (1.0 + ROUNDING)
    gap = (1.0 + result.gap) * scale ** len(result.axes) - 1.0
    return OuterEllipsoid(local.denormalise(result.center), local.denormalise_axes(scale * result.axes), gap)


def _enclose_by_cutting_planes(points: FloatArray, inner: Sequence[InnerEllipsoid]) -> MinVolumeEllipsoid:
    """Return the minimum-volume ellipsoid around points and ellipsoids by cutting planes.

    Ellipsoids may stick out by the relative excess ``SLACK``.
    """
    result = min_volume_ellipsoid(points, GAP)
    for _ in range(CUTS):
        farthest = [farthest_point(ellipsoid, result) for ellipsoid in inner]
        outside = [point for norm, point in farthest if norm > 1.0 + SLACK]
        if not outside:
            break
        points = np.concatenate([points, outside])
        result = min_volume_ellipsoid(points, GAP)
    return result


def _largest_norm(ellipsoid: MinVolumeEllipsoid, points: FloatArray, inner: Sequence[InnerEllipsoid]) -> float:
    """Return a tight upper bound on the norms of points and inner ellipsoids.

    The norm is 1 on the surface of ``ellipsoid``.
    """
    largest = float(np.max(ellipsoid_norms(points, ellipsoid.center, ellipsoid.axes), initial=0.0))
    return max([largest, *(farthest_point(item, ellipsoid)[0] for item in inner)])


def farthest_point(inner: InnerEllipsoid, ellipsoid: MinVolumeEllipsoid) -> tuple[float, FloatArray]:
    """Return an upper bound on the norm of the inner ellipsoid's farthest point, and that point, (r,).

    The outer ellipsoid is the unit ball of the norm; the bound is tight.

    In the other ellipsoid's coordinates it is the largest ``|b + B v|`` over ``|v| <= 1``, a trust-region subproblem:
    for every ``lam`` above the eigenvalues s of ``S = B^T B``, with ``g = B^T b``,

        ``|b + B v|^2 <= |b|^2 + lam + sum_i g_i^2 / (lam - s_i)``,

    since ``v^T S v + 2 g^T v - lam |v|^2`` is concave in v. The least of these bounds is attained (More and Sorensen
    1983, doi:10.1137/0904038): where ``sum_i g_i^2 / (lam - s_i)^2 = 1``, or at the largest eigenvalue.
    """
    local = np.linalg.solve(ellipsoid.axes.T, np.column_stack([inner.center - ellipsoid.center, inner.axes.T]))
    b, B = local[:, 0], local[:, 1:]
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
    return max(bound, 0.0) ** 0.5, inner.center + (vectors @ v) @ inner.axes
