"""Angles between stated normals at points of a mesh and the mesh's own normals there."""

from __future__ import annotations

import numpy as np

from nlpgrasp.common.meshes.crossings import covered, normals_of
from nlpgrasp.common.validation import FloatArray

TOUCHING = 1e-6  # of the size: triangles so close to a point hold it


def angles_off_normals(
    corners: FloatArray, points: FloatArray, normals: FloatArray, size: float, on_edges: bool
) -> FloatArray:
    """Return the angles (m,), radians, between outward unit normals (m, 3) and those of the triangles at points (m, 3).

    Parameters
    ----------
    corners : (f, 3, 3) array
        Of the triangles, metres, counter-clockwise from outside.
    points : (m, 3) array
        On the mesh, metres.
    normals : (m, 3) array
    size : float
        Of the mesh, metres.
    on_edges : bool
        Whether edges and vertices have all directions of the convex cone of their triangles' normals, as they have for
        a fingertip that touches them; else each of their triangles' normals alone.
    """
    slack = TOUCHING * size
    lower, upper = corners.min(axis=1) - slack, corners.max(axis=1) + slack
    result = np.full(len(points), np.pi)
    for i, (point, normal) in enumerate(zip(points, normals, strict=True)):
        near = corners[np.all((lower <= point) & (point <= upper), axis=1)]
        near = near[covered(np.broadcast_to(point, near.shape), near, slack)]
        if len(near):
            result[i] = _angle_off(normals_of(near), normal, on_edges)
    return result


def _angle_off(own: FloatArray, normal: FloatArray, in_cone: bool) -> float:
    """Return the angle between a unit vector (3,) and the nearest of unit vectors (n, 3), or their convex cone."""
    from scipy.optimize import nnls

    least = float(np.min(2.0 * np.arcsin(np.clip(np.linalg.norm(own - normal, axis=1) / 2.0, 0.0, 1.0))))
    if not in_cone or len(own) == 1:
        return least
    weights, off = nnls(np.unique(own, axis=0).T, normal)
    return min(least, float(np.arcsin(min(off, 1.0)))) if np.any(weights) else least
