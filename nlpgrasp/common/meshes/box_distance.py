"""Signed distance of triangles from an axis-aligned box, by branch and bound over the triangles.

The signed distance of a point from a box is convex, negative inside. Its least value over a triangle is therefore at
least that of any supporting plane: of the box's six sides, and of the tangent at the triangle's centroid. Triangles
that may contain a lesser value are divided into four.
"""

from __future__ import annotations

import numpy as np

from nlpgrasp.common.validation import FloatArray

PARTS = 0.5 * np.array(  # barycentric corners of the four parts of a triangle
    [
        [[2, 0, 0], [1, 1, 0], [1, 0, 1]],
        [[1, 1, 0], [0, 2, 0], [0, 1, 1]],
        [[1, 0, 1], [0, 1, 1], [0, 0, 2]],
        [[1, 1, 0], [0, 1, 1], [1, 0, 1]],
    ]
)
ACCURACY = 2e-5  # metres: accuracy of a least distance
DEPTH_ACCURACY = 0.05  # share of a penetration's depth: its accuracy
MOST_LEVELS = 14  # divisions of a triangle, at most


def box_distance(points: FloatArray, lower: FloatArray, upper: FloatArray) -> FloatArray:
    """Return the signed distances of points (..., 3) from a box, (...,), metres, negative inside.

    Parameters
    ----------
    points : (..., 3) array
    lower, upper : (3,) array
        Corners of the box, metres.
    """
    excess = np.maximum(lower - points, points - upper)
    outside = np.linalg.norm(np.maximum(excess, 0.0), axis=-1)
    return np.asarray(outside + np.minimum(np.max(excess, axis=-1), 0.0))


def least_box_distance(
    triangles: FloatArray, lower: FloatArray, upper: FloatArray, farthest: float = np.inf, accuracy: float = ACCURACY
) -> float:
    """Return the least signed distance of triangles (n, 3, 3) from a box, metres, negative inside.

    The result is at most ``accuracy``, or 5 % of a depth, above the least distance, unless ``MOST_LEVELS`` divisions do
    not suffice; ``farthest`` where all triangles are farther away.
    """
    best = farthest
    for _ in range(MOST_LEVELS):
        if not len(triangles):
            break
        centroids = triangles.mean(axis=1)
        values = box_distance(centroids, lower, upper)
        best = min(best, float(values.min()), float(box_distance(triangles, lower, upper).min()))
        tolerance = max(accuracy, DEPTH_ACCURACY * -best)
        is_open = _lower_bounds(triangles, centroids, values, lower, upper) < best - tolerance
        triangles = np.einsum("pij,njk->npik", PARTS, triangles[is_open]).reshape(-1, 3, 3)
    return best


def _lower_bounds(
    triangles: FloatArray, centroids: FloatArray, values: FloatArray, lower: FloatArray, upper: FloatArray
) -> FloatArray:
    """Return lower bounds (n,) on the signed distances of triangles from a box."""
    by_sides = np.maximum(lower - triangles.max(axis=1), triangles.min(axis=1) - upper).max(axis=1)
    excess = np.maximum(lower - centroids, centroids - upper)
    sign = np.where(centroids > 0.5 * (lower + upper), 1.0, -1.0)
    outside = np.maximum(excess, 0.0)
    length = np.linalg.norm(outside, axis=1, keepdims=True)
    deepest = np.eye(3)[np.argmax(excess, axis=1)]
    slopes = sign * np.where(length > 0.0, outside / np.where(length > 0.0, length, 1.0), deepest)
    arms = triangles - centroids[:, None]
    by_tangent = values + np.min(np.einsum("nij,nj->ni", arms, slopes), axis=1)
    return np.asarray(np.maximum(by_sides, by_tangent))
