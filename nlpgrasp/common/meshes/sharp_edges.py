"""Definition of the sharp edges of a triangle mesh."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from nlpgrasp.common.validation import FloatArray, IntArray

SHARP = np.radians(30.0)  # radians: least angle between the normals on both sides of a sharp edge
SHORT = 1e-5  # share of the bounding box's diagonal: a side that is not longer counts as a point
FLAT = 1e-12  # share of the squared diagonal: area up to which a triangle's normal is unreliable


def sharp_edges(vertices: FloatArray, faces: IntArray) -> IntArray:
    """Return the sharp edges of a mesh as vertex indices, (m, 2).

    An edge is sharp where the normals of its two triangles differ by more than 30 degrees. Slivers have no direction:
    the ends of a side up to ``SHORT`` are one point, so that a triangle with such a side is a line and the triangles
    beside it are neighbours; triangles up to ``FLAT`` are left out.

    Parameters
    ----------
    vertices : (n, 3) array
        Metres.
    faces : (f, 3) array of int
        Counter-clockwise, seen from outside.
    """
    diagonal = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    merged = _merge_short_sides(vertices, faces, SHORT * diagonal)[faces]
    is_triangle = np.all(merged != np.roll(merged, 1, axis=1), axis=1)
    merged, corners = merged[is_triangle], vertices[faces[is_triangle]]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    doubled_areas = np.linalg.norm(normals, axis=1)
    normals /= np.maximum(doubled_areas, np.finfo(float).tiny)[:, None]
    edges = np.sort(merged[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    order = np.lexsort((edges[:, 1], edges[:, 0]))
    edges, owners = edges[order], order // 3
    is_shared = np.all(edges[1:] == edges[:-1], axis=1)
    left, right = owners[:-1][is_shared], owners[1:][is_shared]
    has_area = np.minimum(doubled_areas[left], doubled_areas[right]) > 2.0 * FLAT * diagonal**2
    is_sharp = has_area & (np.sum(normals[left] * normals[right], axis=1) < np.cos(SHARP))
    return np.unique(edges[1:][is_shared][is_sharp], axis=0)


def _merge_short_sides(vertices: FloatArray, faces: IntArray, length: float) -> IntArray:
    """Return for each vertex the index, (n,), of the vertex that stands for it and those joined by short sides."""
    sides = faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    sides = sides[np.linalg.norm(vertices[sides[:, 0]] - vertices[sides[:, 1]], axis=1) <= length]
    count = len(vertices)
    _, groups = connected_components(coo_array((np.ones(len(sides)), sides.T), shape=(count, count)), directed=False)
    return np.asarray(np.unique(groups, return_index=True)[1][groups])
