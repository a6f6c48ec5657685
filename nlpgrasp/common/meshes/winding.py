"""Mesh diagnostics by winding numbers: ambiguous inside and buried surface."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.common.meshes.search_tree import IntArray, SearchTree
from nlpgrasp.common.validation import FloatArray

BESIDE = 1e-6  # of the size: offset of test points from a triangle (STL files round to about a tenth of it)
SAMPLES = 4000  # sample points in the bounding box
SPREAD = 2000  # sample points on the surface
UNCLEAR = 0.2  # distance of a winding number from an integer above which the inside is ambiguous
OPEN_SHARE = 0.01  # of the bounding box: largest accepted share with an ambiguous inside


def unclear_share(vertices: FloatArray, faces: IntArray) -> float:
    """Return the share of the bounding box where the winding number is far from an integer."""
    rng = np.random.default_rng(0)
    points = rng.uniform(vertices.min(axis=0), vertices.max(axis=0), (SAMPLES, 3))
    winding = SearchTree(vertices, faces).winding_numbers(points)
    return float(np.mean(np.abs(winding - np.round(winding)) > UNCLEAR))


def buried(vertices: FloatArray, faces: IntArray, points: FloatArray, normals: FloatArray) -> NDArray[np.bool_]:
    """Return which surface points (m, 3) with outward unit normals (m, 3) have the inside on both sides, (m,)."""
    step = BESIDE * float(np.linalg.norm(np.ptp(vertices, axis=0))) * normals
    tree = SearchTree(vertices, faces)
    result = tree.winding_numbers(points + step) > 0.5
    behind = np.flatnonzero(result)
    result[behind] = tree.winding_numbers(points[behind] - step[behind]) > 0.5
    return result


def buried_share(vertices: FloatArray, faces: IntArray) -> float:
    """Return the buried share of the mesh's area, from points uniform by area."""
    corners = vertices[faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(across, axis=1)
    total = np.cumsum(area)
    which = np.searchsorted(total, (np.arange(SPREAD) + 0.5) / SPREAD * total[-1])
    shares = np.random.default_rng(0).dirichlet(np.ones(3), SPREAD)
    points = np.einsum("ij,ijk->ik", shares, corners[which])
    return float(np.mean(buried(vertices, faces, points, across[which] / area[which, None])))
