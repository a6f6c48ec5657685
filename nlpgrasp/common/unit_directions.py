"""Well-spread unit directions, for sampling of support functions and task boundaries.

A polytope with vertices ``y_j`` on the unit sphere and inradius ``r`` certifies ``mu >= r beta`` for the
vertex transcription. Root systems of Lie algebras are far better spread than random directions: in dimension 6 the 72
roots of E6 have inradius 0.612, and together with the 54 minimal vectors of the dual lattice 0.787
(Conway and Sloane, "Sphere packings, lattices and groups", chapter 4, doi:10.1007/978-1-4757-6568-7).
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from functools import cache, lru_cache

import numpy as np
from scipy.spatial import ConvexHull

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import InputError


def directions(dimension: int, shells: int = 1) -> FloatArray:
    """Return well-spread unit directions in the given dimension.

    Parameters
    ----------
    dimension : int
        From 1 to 6.
    shells : {0, 1, 2}
        The axes only; one shell; or two for a rounder polytope with about twice the vertices. Dimension 6: the
        E6 roots, then the dual lattice's minimal vectors. Dimension 3: the icosahedron, then the dodecahedron.

    Returns
    -------
    (m, dimension) array
        Symmetric under ``y -> -y``.
    """
    if dimension not in range(1, 7) or shells not in (0, 1, 2):
        raise InputError("directions", (dimension, shells), "a dimension from 1 to 6 and 0 to 2 shells")
    if shells == 0:
        return np.concatenate([np.eye(dimension), -np.eye(dimension)])
    parts = _FAMILIES[dimension]()[:shells]
    result = np.concatenate(parts)
    return np.asarray(result / np.linalg.norm(result, axis=1, keepdims=True))


def directions_around(first: FloatArray, count: int) -> FloatArray:
    """Return directions on a golden-angle spiral over the sphere that starts at a given direction.

    Parameters
    ----------
    first : (3,) array
        Unit.
    count : int

    Returns
    -------
    (count, 3) array
    """
    i = np.arange(count)
    return _polar_directions(first, np.arccos(1.0 - 2.0 * i / max(count - 1, 1)), i * np.pi * (3.0 - np.sqrt(5.0)))


def directions_beside(first: FloatArray, angle: float, count: int) -> FloatArray:
    """Return evenly spaced directions on a cone about a given direction.

    Parameters
    ----------
    first : (3,) array
        Unit.
    angle : float
        Radians.
    count : int

    Returns
    -------
    (count, 3) array
    """
    return _polar_directions(first, np.full(count, angle), 2.0 * np.pi * np.arange(count) / count)


def _polar_directions(first: FloatArray, polar: FloatArray, azimuth: FloatArray) -> FloatArray:
    """Return directions (m, 3) at polar angles (m,) and azimuths (m,) about a given direction."""
    least = np.eye(3)[int(np.argmin(np.abs(first)))]
    u = np.cross(first, least) / np.linalg.norm(np.cross(first, least))
    v = np.cross(first, u)
    radial = np.cos(azimuth)[:, None] * u + np.sin(azimuth)[:, None] * v
    return np.asarray(np.cos(polar)[:, None] * first + np.sin(polar)[:, None] * radial)


@lru_cache
def directions_inradius(dimension: int, shells: int = 1) -> float:
    """Return the radius of the largest ball about the origin in the convex hull of ``directions``."""
    points = directions(dimension, shells)
    if dimension == 1:
        return 1.0
    return float(np.min(-ConvexHull(points).equations[:, -1]))


@cache
def e6_shells() -> tuple[FloatArray, FloatArray]:
    """Return the 72 roots of E6 and the 54 minimal vectors of its dual lattice, (72, 6) and (54, 6).

    The E6 roots are the E8 roots orthogonal to an A2 subsystem; projecting the other E8 roots onto that complement
    gives the dual lattice's minimal vectors.
    """
    roots = _e8_roots()
    first = roots[0]
    second = next(r for r in roots if abs(r @ first + 1.0) < 1e-9)
    a2 = np.stack([first, second])
    complement = np.linalg.svd(a2)[2][2:]  # (6, 8), orthonormal rows
    orthogonal = np.all(np.abs(roots @ a2.T) < 1e-9, axis=1)
    projected = roots[~orthogonal] @ complement.T
    length = np.linalg.norm(projected, axis=1)
    dual = np.unique(np.round(projected[length > 1e-6], 9), axis=0)
    return roots[orthogonal] @ complement.T, dual


def _e8_roots() -> FloatArray:
    """Return the 240 roots of E8, (240, 8)."""
    halves = [s for s in itertools.product((0.5, -0.5), repeat=8) if sum(x < 0 for x in s) % 2 == 0]
    return np.concatenate([_d_roots(8), np.array(halves)])


def _d_roots(n: int) -> FloatArray:
    """Return the roots of D_n: all ``+-e_i +- e_j``."""
    rows = []
    for i, j in itertools.combinations(range(n), 2):
        for a, b in itertools.product((1.0, -1.0), repeat=2):
            row = np.zeros(n)
            row[i], row[j] = a, b
            rows.append(row)
    return np.array(rows)


def _cube(n: int) -> FloatArray:
    """Return the corners of the cube, (2^n, n)."""
    return np.array(list(itertools.product((1.0, -1.0), repeat=n)))


def _signed_axes(n: int) -> FloatArray:
    """Return the positive and negative unit vectors, (2 n, n)."""
    return np.concatenate([np.eye(n), -np.eye(n)])


def _directions_on_line() -> list[FloatArray]:
    """Return two shells of directions on a line; the second is empty."""
    return [np.array([[1.0], [-1.0]]), np.zeros((0, 1))]


def _circle() -> list[FloatArray]:
    """Return two shells (12, 2) of evenly spaced unit directions in the plane, the second turned by 15 degrees."""
    angles = np.arange(12) * np.pi / 6.0
    first = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    offset = angles + np.pi / 12.0
    return [first, np.stack([np.cos(offset), np.sin(offset)], axis=1)]


def _icosahedral() -> list[FloatArray]:
    """Return the vertices of an icosahedron and of a dodecahedron as two shells."""
    golden = (1.0 + 5.0**0.5) / 2.0

    def cyclic(a: float, b: float, c: float) -> list[tuple[float, float, float]]:
        signs = {(s * a, t * b, u * c) for s in (1, -1) for t in (1, -1) for u in (1, -1)}
        return sorted({p for x, y, z in signs for p in ((x, y, z), (y, z, x), (z, x, y))})

    icosahedron = np.array(cyclic(0.0, 1.0, golden))
    dodecahedron = np.array(sorted(set(cyclic(0.0, 1.0 / golden, golden)) | set(cyclic(1.0, 1.0, 1.0))))
    return [icosahedron, dodecahedron]


_FAMILIES: dict[int, Callable[[], Sequence[FloatArray]]] = {
    1: _directions_on_line,
    2: _circle,
    3: _icosahedral,
    4: lambda: [_d_roots(4), np.concatenate([_signed_axes(4), _cube(4) / 2.0])],
    5: lambda: [_d_roots(5), np.concatenate([_signed_axes(5), _cube(5)])],
    6: e6_shells,
}
