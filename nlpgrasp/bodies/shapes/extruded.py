"""Triangulation of polygons extruded along z."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.common.validation import FloatArray

IntArray = NDArray[np.int64]
PLATE = 0.08  # of a planar body's size: thickness of the plate that represents it
STRAIGHT = 1e-12  # of the outline's squared size: area that counts as zero


def extruded(outline: FloatArray, low: float, high: float) -> tuple[FloatArray, IntArray]:
    """Return the closed surface of an extruded polygon, its triangles counter-clockwise from outside.

    Parameters
    ----------
    outline : (m, 2) array
        Vertices of a simple polygon, counter-clockwise, metres.
    low, high : float
        Ends along z, metres.

    Returns
    -------
    vertices : (n, 3) array
        The outline at both ends, and the centres of the ends if the outline is convex.
    faces : (k, 3) array
    """
    m = len(outline)
    ends = [np.column_stack([outline, np.full(m, z)]) for z in (low, high)]
    here = np.arange(m)
    following = np.roll(here, -1)
    sides = [np.stack([here, following, m + following], axis=1), np.stack([here, m + following, m + here], axis=1)]
    if _is_convex(outline):
        middle = np.tile(outline.mean(axis=0), (2, 1))
        ends.append(np.column_stack([middle, [low, high]]))
        bottom = np.stack([following, here, np.full(m, 2 * m)], axis=1)
        top = np.stack([m + here, m + following, np.full(m, 2 * m + 1)], axis=1)
    else:
        top = m + ears(outline)
        bottom = (top - m)[:, ::-1]
    return np.concatenate(ends), np.concatenate([*sides, bottom, top])


def circle(radius: float, count: int) -> FloatArray:
    """Return points (count, 2) spread evenly on a circle about the origin, counter-clockwise, metres."""
    angles = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    return radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)


def ears(outline: FloatArray) -> IntArray:
    """Triangulate a simple polygon by ear clipping, and return the triangles (m - 2, 3), counter-clockwise.

    Parameters
    ----------
    outline : (m, 2) array
        Counter-clockwise. Meisters, "Polygons have ears" (1975, doi:10.1080/00029890.1975.11993898).
    """
    left, found = list(range(len(outline))), []
    while len(left) > 3:
        corner = next((i for i in range(len(left)) if _is_ear(outline, left, i)), None)
        if corner is None:  # rounding has closed the last ones: what is left is flat
            corner = int(
                np.argmax(
                    [_turn(*outline[[left[i - 1], left[i], left[(i + 1) % len(left)]]]) for i in range(len(left))]
                )
            )
        found.append([left[corner - 1], left[corner], left[(corner + 1) % len(left)]])
        del left[corner]
    return np.array([*found, left], dtype=np.int64)


def _is_ear(outline: FloatArray, left: list[int], i: int) -> bool:
    """Return whether a corner is an ear: convex, with no other vertex in its triangle."""
    names = [left[i - 1], left[i], left[(i + 1) % len(left)]]
    a, b, c = outline[names]
    if _turn(a, b, c) <= STRAIGHT * float(np.max(np.ptp(outline, axis=0))) ** 2:
        return False
    others = outline[[v for v in left if v not in names]]
    inside = (_turn(a, b, others) >= 0.0) & (_turn(b, c, others) >= 0.0) & (_turn(c, a, others) >= 0.0)
    return not np.any(inside)


def _turn(a: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray:
    """Return twice the signed area of triangles a, b, c, for points c (..., 2)."""
    return np.asarray((b[0] - a[0]) * (c[..., 1] - a[1]) - (b[1] - a[1]) * (c[..., 0] - a[0]))


def _is_convex(outline: FloatArray) -> bool:
    ahead, back = np.roll(outline, -1, axis=0) - outline, outline - np.roll(outline, 1, axis=0)
    return bool(np.all(back[:, 0] * ahead[:, 1] - back[:, 1] * ahead[:, 0] >= 0.0))
