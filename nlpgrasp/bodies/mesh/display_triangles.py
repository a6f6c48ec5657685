"""Triangulations of bodies with a limited number of triangles, for display."""

from __future__ import annotations

import numpy as np

from nlpgrasp.bodies.base import Body
from nlpgrasp.bodies.mesh.mesh import Mesh
from nlpgrasp.bodies.triangulation import PLATE
from nlpgrasp.common.meshes.intersections import normals_of
from nlpgrasp.common.validation import FloatArray, IntArray

CELLS = 48  # most grid cells of marching cubes along the longest side
MARGIN = 0.04  # of the size: grid beyond the body
FINEST_CLUSTERS = 2**19  # clusters along the longest side: an index of a cell of such a grid fits into 64 bits
FLATTEST = 1e-2  # of a quadric's trace: weight of the mean vertex, which decides along directions without curvature


def triangles(body: Body, most: int = 2000) -> tuple[FloatArray, IntArray]:
    """Return a body's surface for display: vertices (n, 3), metres, and at most ``most`` triangles (m, 3).

    A mesh, or a body's own triangulation, is simplified; a body without one is triangulated by marching cubes of its
    signed distance.
    """
    if isinstance(body, Mesh):
        return simplify(np.asarray(body.mesh.vertices, dtype=float), np.asarray(body.mesh.faces), most)
    known = body.triangles()
    return _march_cubes(body, most) if known is None else simplify(*known, most)


def simplify(vertices: FloatArray, faces: IntArray, most: int) -> tuple[FloatArray, IntArray]:
    """Return a triangle mesh simplified to at most ``most`` triangles, whatever its topology.

    Vertices in one cell of a grid, the finest that leaves so few triangles, become the point of least squared distance
    from the planes of their triangles (Lindstrom 2000, doi:10.1145/344779.344912).
    """
    if len(faces) <= most:
        return vertices, faces.astype(np.int64)
    lower, longest = vertices.min(axis=0), max(float(np.max(np.ptp(vertices, axis=0))), float(np.finfo(float).tiny))

    def clustered(cells: int) -> tuple[IntArray, IntArray]:
        cell = np.minimum((cells * ((vertices - lower) / longest)).astype(np.int64), cells - 1)
        labels = np.unique(cell @ np.array([cells**2, cells, 1]), return_inverse=True)[1].ravel()
        return labels, _distinct_triangles(labels[faces])

    fine = 2
    while fine < FINEST_CLUSTERS and len(clustered(fine)[1]) <= most:
        fine *= 2
    coarse = fine // 2
    while fine - coarse > 1:
        middle = (coarse + fine) // 2
        coarse, fine = (middle, fine) if len(clustered(middle)[1]) <= most else (coarse, middle)
    labels, kept = clustered(coarse)
    return _quadric_minima(vertices - lower, faces, labels, longest / coarse) + lower, kept


def _distinct_triangles(faces: IntArray) -> IntArray:
    """Return the triangles (m, 3) that have three distinct vertices, each once."""
    proper = faces[np.all(faces != np.roll(faces, 1, axis=1), axis=1)]
    first = np.argmin(proper, axis=1)[:, None]
    return np.unique(np.take_along_axis(proper, (first + np.arange(3)) % 3, axis=1), axis=0)


def _quadric_minima(vertices: FloatArray, faces: IntArray, labels: IntArray, reach: float) -> FloatArray:
    """Return the representative (n, 3) of each cluster of vertices, at most ``reach`` from their mean on each axis."""
    count = int(labels.max()) + 1
    sizes = np.bincount(labels)
    means = np.stack([np.bincount(labels, vertices[:, i], count) / sizes for i in range(3)], axis=1)
    corners = vertices[faces]
    normals = normals_of(corners)
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    clusters = labels[faces].T.ravel()  # of each triangle's first corner, then of the second ones, ...
    heights = np.einsum("cfi,fi->cf", corners[None, :, 0] - means[labels[faces].T], normals).ravel()
    quadrics, slopes = np.zeros((count, 3, 3)), np.zeros((count, 3))
    for i in range(3):
        weighted = np.tile(areas * normals[:, i], 3)
        slopes[:, i] = np.bincount(clusters, weighted * heights, count)
        for j in range(3):
            quadrics[:, i, j] = np.bincount(clusters, weighted * np.tile(normals[:, j], 3), count)
    trace = np.maximum(np.trace(quadrics, axis1=1, axis2=2), np.finfo(float).tiny)
    shifts = np.linalg.solve(quadrics + FLATTEST * trace[:, None, None] * np.eye(3), slopes[:, :, None])[:, :, 0]
    return np.asarray(means + np.clip(shifts, -reach, reach))


def _march_cubes(body: Body, most: int) -> tuple[FloatArray, IntArray]:
    """Triangulate a body's surface by marching cubes of its signed distance, on a grid of so few triangles."""
    import igl

    lower, upper = (np.asarray(b, dtype=float) for b in body.bounds)
    half = PLATE / 2.0 * body.size
    if body.space == 2:
        lower, upper = np.append(lower, -half), np.append(upper, half)
    lower, upper = lower - MARGIN * body.size, upper + MARGIN * body.size
    cells = CELLS
    while True:
        step = float(np.max(upper - lower)) / cells
        counts = np.maximum(np.ceil((upper - lower) / step).astype(int), 6) + 1
        axes = [np.linspace(a, b, n) for a, b, n in zip(lower, upper, counts, strict=True)]
        z, y, x = np.meshgrid(*axes[::-1], indexing="ij")  # x runs fastest, as igl wants it
        grid = np.stack([x, y, z], axis=-1).reshape(-1, 3)
        values = body.signed_distance(grid[:, : body.space])
        if body.space == 2:
            values = np.maximum(values, np.abs(grid[:, 2]) - half)
        vertices, faces, _ = igl.marching_cubes(values, grid, *(int(n) for n in counts), 0.0)
        if len(faces) <= most or np.all(counts == 7):
            return np.asarray(vertices), np.asarray(faces, dtype=np.int64)
        cells = max(1, min(cells - 1, int(cells * np.sqrt(most / len(faces)))))
