"""Triangulations of round surfaces and of polygons extruded along z."""

from __future__ import annotations

import numpy as np

from nlpgrasp.common.validation import FloatArray, IntArray

PLATE = 0.08  # of a planar body's size: thickness of the plate that represents it
STRAIGHT = 1e-12  # of the outline's squared size: area that counts as zero
FINE = 4000  # points for a curve's arc length and turning angle


def extrude(outline: FloatArray, low: float, high: float) -> tuple[FloatArray, IntArray]:
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
    indices = np.arange(m)
    successors = np.roll(indices, -1)
    sides = [
        np.stack([indices, successors, m + successors], axis=1),
        np.stack([indices, m + successors, m + indices], axis=1),
    ]
    if _is_convex(outline):
        middle = np.tile(outline.mean(axis=0), (2, 1))
        ends.append(np.column_stack([middle, [low, high]]))
        bottom = np.stack([successors, indices, np.full(m, 2 * m)], axis=1)
        top = np.stack([m + indices, m + successors, np.full(m, 2 * m + 1)], axis=1)
    else:
        top = m + clip_ears(outline)
        bottom = (top - m)[:, ::-1]
    return np.concatenate(ends), np.concatenate([*sides, bottom, top])


def circle_points(radius: float, count: int) -> FloatArray:
    """Return points (count, 2) spread evenly on a circle about the origin, counter-clockwise, metres."""
    angles = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    return radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)


def clip_ears(outline: FloatArray) -> IntArray:
    """Return the triangles (m - 2, 3), counter-clockwise, of a simple polygon (m, 2), by ear clipping.

    Parameters
    ----------
    outline : (m, 2) array
        Counter-clockwise. Meisters, "Polygons have ears" (1975, doi:10.1080/00029890.1975.11993898).
    """
    remaining, triangles = list(range(len(outline))), []
    while len(remaining) > 3:
        corner = next((i for i in range(len(remaining)) if _is_ear(outline, remaining, i)), None)
        if corner is None:  # rounding has closed the last ones: what is left is flat
            corner = int(
                np.argmax(
                    [
                        _twice_signed_area(
                            *outline[[remaining[i - 1], remaining[i], remaining[(i + 1) % len(remaining)]]]
                        )
                        for i in range(len(remaining))
                    ]
                )
            )
        triangles.append([remaining[corner - 1], remaining[corner], remaining[(corner + 1) % len(remaining)]])
        del remaining[corner]
    return np.array([*triangles, remaining], dtype=np.int64)


def _is_ear(outline: FloatArray, remaining: list[int], i: int) -> bool:
    """Return whether a corner of a polygon is an ear: convex, with no other vertex in its triangle."""
    corners = [remaining[i - 1], remaining[i], remaining[(i + 1) % len(remaining)]]
    a, b, c = outline[corners]
    if _twice_signed_area(a, b, c) <= STRAIGHT * float(np.max(np.ptp(outline, axis=0))) ** 2:
        return False
    points = outline[[v for v in remaining if v not in corners]]
    is_inside = (
        (_twice_signed_area(a, b, points) >= 0.0)
        & (_twice_signed_area(b, c, points) >= 0.0)
        & (_twice_signed_area(c, a, points) >= 0.0)
    )
    return not np.any(is_inside)


def _twice_signed_area(a: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray:
    """Return twice the signed area of triangles a, b, c, for points c (..., 2)."""
    return np.asarray((b[0] - a[0]) * (c[..., 1] - a[1]) - (b[1] - a[1]) * (c[..., 0] - a[0]))


def _is_convex(outline: FloatArray) -> bool:
    """Return whether a counter-clockwise outline (m, 2) has no reflex vertex."""
    forward, backward = np.roll(outline, -1, axis=0) - outline, outline - np.roll(outline, 1, axis=0)
    return bool(np.all(backward[:, 0] * forward[:, 1] - backward[:, 1] * forward[:, 0] >= 0.0))


def triangulate_sphere(rows: int) -> tuple[FloatArray, IntArray]:
    """Return the unit sphere as ``8 rows^2`` triangles of nearly equal size, counter-clockwise from outside.

    An octahedron with edges divided into ``rows`` parts: row i from a pole has ``4 i`` points.
    """
    polar = np.pi / 2.0 * np.concatenate([np.repeat(i, max(4 * i, 1)) for i in range(rows + 1)]) / rows
    turn = np.concatenate([np.arange(max(4 * i, 1)) * (np.pi / 2.0 / max(i, 1)) for i in range(rows + 1)])
    north = np.stack([np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar)], axis=1)
    starts = [0, *np.cumsum([max(4 * i, 1) for i in range(rows + 1)]).tolist()]
    faces = []
    for i in range(rows):
        count, next_count = max(4 * i, 1), 4 * (i + 1)
        for quarter in range(4):
            for j in range(i + 1):
                a = starts[i] + (quarter * i + j) % count
                b, c = (starts[i + 1] + (quarter * (i + 1) + j + s) % next_count for s in (0, 1))
                faces.append([a, b, c])
                if j < i:
                    faces.append([a, c, starts[i] + (quarter * i + j + 1) % count])
    equator = starts[rows]
    to_south = np.concatenate([len(north) + np.arange(equator), np.arange(equator, len(north))])
    upper = np.array(faces, dtype=np.int64)
    return np.concatenate([north, north[:equator] * [1.0, 1.0, -1.0]]), np.concatenate(
        [upper, to_south[upper][:, ::-1]]
    )


def triangulate_torus(major: float, minor: float, around: int, across: int) -> tuple[FloatArray, IntArray]:
    """Return a torus about z as ``2 around across`` triangles, counter-clockwise from outside."""
    u = np.repeat(np.linspace(0.0, 2.0 * np.pi, around, endpoint=False), across)
    v = np.tile(np.linspace(0.0, 2.0 * np.pi, across, endpoint=False), around)
    ring = major + minor * np.cos(v)
    indices = np.arange(around * across).reshape(around, across)
    right, up = np.roll(indices, -1, axis=0), np.roll(indices, -1, axis=1)
    return np.stack([ring * np.cos(u), ring * np.sin(u), minor * np.sin(v)], axis=1), _split_quadrilaterals(
        indices, right, np.roll(right, -1, axis=1), up
    )


def triangulate_superquadric(semi_axes: FloatArray, exponents: FloatArray, quarter: int) -> tuple[FloatArray, IntArray]:
    """Return a superquadric as about ``16 quarter^2`` triangles, counter-clockwise from outside.

    Parameters
    ----------
    semi_axes : (3,) array
        Metres.
    exponents : (2,) array
        ``(e1, e2)`` of ``ng.Superquadric``.
    quarter : int
        Parts of a quarter of each curve.
    """
    meridian, parallel = (
        superellipse_quarter(float(exponents[0]), quarter),
        superellipse_quarter(float(exponents[1]), quarter),
    )
    signs = [[1, 1], [-1, 1], [-1, -1], [1, -1]]
    turns = np.concatenate([(parallel if k % 2 == 0 else parallel[::-1])[:-1] * sign for k, sign in enumerate(signs)])
    profile = np.concatenate([meridian[:0:-1] * [1, -1], meridian])[1:-1]  # from pole to pole, without the poles
    points = np.stack([np.append(cut * turns, np.full((len(turns), 1), z), axis=1) for cut, z in profile])
    poles = np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]])
    indices = np.arange(points.shape[0] * len(turns)).reshape(points.shape[0], -1)
    right, low = np.roll(indices, -1, axis=1), np.full(len(turns), indices.size)
    sides = _split_quadrilaterals(indices[:-1], right[:-1], right[1:], indices[1:])
    ends = [np.stack([low, right[0], indices[0]], axis=1), np.stack([low + 1, indices[-1], right[-1]], axis=1)]
    return np.concatenate([points.reshape(-1, 3), poles]) * semi_axes, np.concatenate([sides, *ends])


def superellipse_quarter(exponent: float, count: int) -> FloatArray:
    """Return points (count + 1, 2) of ``x^(2/e) + y^(2/e) = 1`` from (1, 0) to (0, 1).

    Half of them are spread by arc length and half by turning angle, to resolve both flat sides and tight corners.
    """
    angle = np.linspace(0.0, np.pi / 2.0, FINE)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1).clip(0.0)
    curve = circle / np.sum(circle ** (2.0 / exponent), axis=1, keepdims=True) ** (exponent / 2.0)
    steps = np.diff(curve, axis=0)
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(steps, axis=1))])
    headings = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    turning = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(headings))), [0.0]])
    turning[-1] = turning[-2]
    progress = length / length[-1] + turning / max(float(turning[-1]), 1e-12)
    chosen = np.searchsorted(progress, np.linspace(0.0, progress[-1], count + 1)[1:-1])
    return np.concatenate([[[1.0, 0.0]], curve[chosen], [[0.0, 1.0]]])


def _split_quadrilaterals(a: IntArray, b: IntArray, c: IntArray, d: IntArray) -> IntArray:
    """Return the triangles (m, 3) of quadrilaterals a, b, c, d, counter-clockwise from outside."""
    corners = [x.ravel() for x in (a, b, c, d)]
    return np.concatenate([np.stack([corners[i] for i in half], axis=1) for half in ((0, 1, 2), (0, 2, 3))])
