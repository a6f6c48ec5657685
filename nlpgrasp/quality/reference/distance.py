"""Distance of a point from a polytope, [14] and [15] of the paper (Section 3.4).

Wolfe's method (Finding the nearest point in a polytope, 1976, doi:10.1007/BF01580381) with vertices from a support
function, as in Gilbert, Johnson and Keerthi (1988, doi:10.1109/56.2083).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from nlpgrasp.common.validation import FloatArray, array, integer
from nlpgrasp.errors import InputError

GAP = 1e-14  # of distance times the polytope's size: tolerance of stationarity
NOTHING = 1e-12  # weight below which a vertex is dropped
MOST = 10_000

Vertex = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True)
class PolytopeDistance:
    """Distance of a point from a polytope, with a certified lower bound.

    Parameters
    ----------
    distance : float
        From the point to ``nearest``, an upper bound of the true distance, in the unit of the points.
    lower : float
        Lower bound of the true distance, by a separating plane; 0 if none was found.
    nearest : (d,) array
        The nearest point of the polytope.
    direction : (d,) array
        From the nearest point to the point; unit length, zero where they are the same.
    """

    distance: float
    lower: float
    nearest: FloatArray
    direction: FloatArray

    @property
    def outside(self) -> bool:
        """Whether a separating plane proves that the point is outside."""
        return self.lower > 0.0


def polytope_distance(polytope: ArrayLike | Vertex, point: ArrayLike, most: int = MOST) -> PolytopeDistance:
    """Return the distance of a point from a polytope, given by vertices or a support function.

    Parameters
    ----------
    polytope : (m, d) array or callable
        Its vertices, or a function that maps a direction y (d,) to the farthest point (d,) along y. That may also be of
        any other closed convex set: the method then ends at rounding, or after ``most`` steps.
    point : (d,) array
        The point.
    most : int
        Most steps, at least 1.

    Returns
    -------
    PolytopeDistance
        In the unit of the points.

    Raises
    ------
    InputError
        On shapes that do not match, NaN, or no vertices.
    """
    p = array("point", point, (None,))
    most = integer("most", most, at_least=1)
    vertex = polytope if callable(polytope) else _of_points(polytope, len(p))
    V = np.array([_found(vertex, p) - p])  # the vertices in use, from the point; the nearest point is a mean of them
    weights = np.ones(1)
    x, lower, extent, first = V[0], 0.0, 0.0, V[0]
    for _ in range(most):
        size = float(np.linalg.norm(x))
        if size <= NOTHING * extent:
            break
        new = _found(vertex, -x) - p
        lower, extent = max(lower, float(x @ new) / size), max(extent, float(np.linalg.norm(new - first)))
        if x @ (x - new) <= GAP * size * extent:
            break
        if np.any(np.all(new == V, axis=1)):
            break
        V, weights = _nearest_of(np.concatenate([V, new[None]]), np.append(weights, 0.0))
        closer = weights @ V
        if not closer @ closer < x @ x:  # rounding: no step gets any nearer
            break
        x = closer
    size = float(np.linalg.norm(x))
    return PolytopeDistance(size, min(max(lower, 0.0), size), p + x, -x / size if size > 0.0 else np.zeros_like(x))


def _of_points(points: ArrayLike, d: int) -> Vertex:
    """Return the support-vertex function of the hull of points."""
    rows = array("polytope", points, (None, d))
    if not len(rows):
        raise InputError("polytope", "no points", "at least one vertex")
    return lambda y: rows[int(np.argmax(rows @ y))]


def _found(vertex: Vertex, y: FloatArray) -> FloatArray:
    """Return the validated farthest vertex along a direction."""
    return array("polytope", vertex(y), y.shape)


def _nearest_of(V: FloatArray, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the vertices and weights of the point of their hull nearest to the origin (Wolfe's minor cycle)."""
    while True:
        steps = np.linalg.lstsq((V[1:] - V[0]).T, -V[0], rcond=None)[0]
        flat = np.concatenate([[1.0 - steps.sum()], steps])  # nearest of their flat
        if np.all(flat > NOTHING):
            return V, flat / flat.sum()
        falling = flat <= NOTHING
        drop = weights[falling] - flat[falling]
        share = np.min(np.where(drop > 0.0, weights[falling] / np.where(drop > 0.0, drop, 1.0), 0.0))
        weights = (1.0 - min(share, 1.0)) * weights + min(share, 1.0) * flat
        keep = weights > NOTHING
        if keep.all():
            keep[int(np.argmin(weights))] = False
        V, weights = V[keep], weights[keep] / weights[keep].sum()
