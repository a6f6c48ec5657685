"""Minimum-volume ellipsoid around wrenches and covers, with warm start.

Points on and outside the previous ellipsoid start the search for dual weights
(``nlpgrasp.tasks.learnt.min_volume``). Covers are added like cutting planes: where one extends beyond the ellipsoid,
its farthest point joins the points. The remaining excess is removed by scaling the ellipsoid about its centre.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.tasks.learnt.enclosing import NEAR
from nlpgrasp.tasks.learnt.growing.cover import Cover
from nlpgrasp.tasks.learnt.local import FLAT, Local
from nlpgrasp.tasks.learnt.min_volume import MinVolume, levels, min_volume_ellipsoid

GAP = 1e-5  # relative excess of volume at which the search for weights stops
TOUCHING, BEGINNING = 1e-4, 60  # warm-start points: relative distance from the boundary, most points
SLACK, CUTS = 1e-4, 60  # relative excess of covers that needs no cut; most rounds of cuts
ROUNDING = 1e-12  # relative enlargement against rounding


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

    def within(self, local: Local) -> MinVolume | None:
        """Return the ellipsoid in normalised coordinates, ``None`` if it is flat in them."""
        _, sizes, vectors = np.linalg.svd(local.inward_axes(self.axes), full_matrices=False)
        r = len(local.basis)
        if len(sizes) < r or sizes[-1] <= FLAT * sizes[0]:
            return None
        return MinVolume(local.inward(self.center[None])[0], sizes[:, None] * vectors, 0.0)


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
    local = Local.of(np.concatenate([kept, *(cover.ends() for cover in covers)]))
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
