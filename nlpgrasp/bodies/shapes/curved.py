"""Triangulations of spheres, tori and superquadrics, with all vertices on the surface."""

from __future__ import annotations

import numpy as np

from nlpgrasp.bodies.shapes.extruded import IntArray
from nlpgrasp.common.validation import FloatArray

FINE = 4000  # points for a curve's arc length and turning angle


def sphere(rows: int) -> tuple[FloatArray, IntArray]:
    """Return the unit sphere as ``8 rows^2`` triangles of nearly equal size, counter-clockwise from outside.

    An octahedron with edges divided into ``rows`` parts: row i from a pole has ``4 i`` points.
    """
    polar = np.pi / 2.0 * np.concatenate([np.repeat(i, max(4 * i, 1)) for i in range(rows + 1)]) / rows
    turn = np.concatenate([np.arange(max(4 * i, 1)) * (np.pi / 2.0 / max(i, 1)) for i in range(rows + 1)])
    north = np.stack([np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar)], axis=1)
    begin = [0, *np.cumsum([max(4 * i, 1) for i in range(rows + 1)]).tolist()]
    faces = []
    for i in range(rows):
        here, below = max(4 * i, 1), 4 * (i + 1)
        for quarter in range(4):
            for j in range(i + 1):
                a = begin[i] + (quarter * i + j) % here
                b, c = (begin[i + 1] + (quarter * (i + 1) + j + s) % below for s in (0, 1))
                faces.append([a, b, c])
                if j < i:
                    faces.append([a, c, begin[i] + (quarter * i + j + 1) % here])
    equator = begin[rows]
    to_south = np.concatenate([len(north) + np.arange(equator), np.arange(equator, len(north))])
    upper = np.array(faces, dtype=np.int64)
    return np.concatenate([north, north[:equator] * [1.0, 1.0, -1.0]]), np.concatenate(
        [upper, to_south[upper][:, ::-1]]
    )


def torus(major: float, minor: float, around: int, across: int) -> tuple[FloatArray, IntArray]:
    """Return a torus about z of ``2 around across`` triangles, counter-clockwise from outside; radii in metres."""
    u = np.repeat(np.linspace(0.0, 2.0 * np.pi, around, endpoint=False), across)
    v = np.tile(np.linspace(0.0, 2.0 * np.pi, across, endpoint=False), around)
    ring = major + minor * np.cos(v)
    here = np.arange(around * across).reshape(around, across)
    right, up = np.roll(here, -1, axis=0), np.roll(here, -1, axis=1)
    return np.stack([ring * np.cos(u), ring * np.sin(u), minor * np.sin(v)], axis=1), _halves(
        here, right, np.roll(right, -1, axis=1), up
    )


def superquadric(semi_axes: FloatArray, exponents: FloatArray, quarter: int) -> tuple[FloatArray, IntArray]:
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
    rise, round_ = quarter_of(float(exponents[0]), quarter), quarter_of(float(exponents[1]), quarter)
    ways = [[1, 1], [-1, 1], [-1, -1], [1, -1]]
    turns = np.concatenate([(round_ if k % 2 == 0 else round_[::-1])[:-1] * way for k, way in enumerate(ways)])
    climb = np.concatenate([rise[:0:-1] * [1, -1], rise])[1:-1]  # from pole to pole, without the poles
    points = np.stack([np.append(cut * turns, np.full((len(turns), 1), z), axis=1) for cut, z in climb])
    poles = np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]])
    here = np.arange(points.shape[0] * len(turns)).reshape(points.shape[0], -1)
    right, low = np.roll(here, -1, axis=1), np.full(len(turns), here.size)
    sides = _halves(here[:-1], right[:-1], right[1:], here[1:])
    ends = [np.stack([low, right[0], here[0]], axis=1), np.stack([low + 1, here[-1], right[-1]], axis=1)]
    return np.concatenate([points.reshape(-1, 3), poles]) * semi_axes, np.concatenate([sides, *ends])


def quarter_of(exponent: float, count: int) -> FloatArray:
    """Return points (count + 1, 2) of ``x^(2/e) + y^(2/e) = 1`` from (1, 0) to (0, 1).

    Half of them are spread by arc length and half by turning angle, to resolve both flat sides and tight corners.
    """
    angle = np.linspace(0.0, np.pi / 2.0, FINE)
    both = np.stack([np.cos(angle), np.sin(angle)], axis=1).clip(0.0)
    curve = both / np.sum(both ** (2.0 / exponent), axis=1, keepdims=True) ** (exponent / 2.0)
    steps = np.diff(curve, axis=0)
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(steps, axis=1))])
    headings = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    turned = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(headings))), [0.0]])
    turned[-1] = turned[-2]
    share = length / length[-1] + turned / max(float(turned[-1]), 1e-12)
    at = np.searchsorted(share, np.linspace(0.0, share[-1], count + 1)[1:-1])
    return np.concatenate([[[1.0, 0.0]], curve[at], [[0.0, 1.0]]])


def _halves(a: IntArray, b: IntArray, c: IntArray, d: IntArray) -> IntArray:
    """Return the triangles (m, 3) of quadrilaterals a, b, c, d, counter-clockwise from outside."""
    corners = [x.ravel() for x in (a, b, c, d)]
    return np.concatenate([np.stack([corners[i] for i in half], axis=1) for half in ((0, 1, 2), (0, 2, 3))])
