"""Angles between given normals and the normal cones of a mesh."""

from __future__ import annotations

import numpy as np

from nlpgrasp.common.meshes.crossings import covered, normals_of
from nlpgrasp.common.validation import FloatArray

TOUCHING = 1e-6  # of the size: distance within which a triangle contains a point


def angles_off_normals(
    corners: FloatArray, points: FloatArray, normals: FloatArray, size: float, on_edges: bool
) -> FloatArray:
    """Return the angles (m,), radians, between unit normals (m, 3) and the mesh's normals at points (m, 3).

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
        Whether edges and vertices have the convex cone of their triangles' normals, as for a fingertip that touches
        them; else only the normals themselves.
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
    """Return the angle, radians, between a unit vector (3,) and the nearest of (n, 3), or their convex cone."""
    from scipy.optimize import nnls

    least = float(np.min(2.0 * np.arcsin(np.clip(np.linalg.norm(own - normal, axis=1) / 2.0, 0.0, 1.0))))
    if not in_cone or len(own) == 1:
        return least
    weights, off = nnls(np.unique(own, axis=0).T, normal)
    return min(least, float(np.arcsin(min(off, 1.0)))) if np.any(weights) else least
