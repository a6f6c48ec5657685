"""Simplified triangulations of bodies for display."""

from __future__ import annotations

import numpy as np

from nlpgrasp.bodies.base import Body
from nlpgrasp.bodies.mesh.mesh import Mesh
from nlpgrasp.bodies.triangulation import PLATE
from nlpgrasp.common.cache import cached_arrays
from nlpgrasp.common.meshes.search_tree import local_origin, relative_to
from nlpgrasp.common.validation import FloatArray, IntArray

CELLS = 48  # grid cells along the longest side
MARGIN = 0.04  # of the size: grid beyond the body


def triangles(body: Body, most: int = 2000) -> tuple[FloatArray, IntArray]:
    """Return a body's surface for display: vertices (n, 3), metres, and at most ``most`` triangles (m, 3).

    A mesh, or a body's own triangulation, is simplified; a body without one, and a mesh that cannot be simplified, is
    first triangulated by marching cubes of its signed distance.
    """
    if isinstance(body, Mesh):
        vertices, faces = simplify(np.asarray(body.mesh.vertices, dtype=float), np.asarray(body.mesh.faces), most)
        if len(faces) <= most:
            return vertices, faces
    return simplify(*(body.triangles() or _march_cubes(body)), most)


def simplify(vertices: FloatArray, faces: IntArray, most: int) -> tuple[FloatArray, IntArray]:
    """Return a triangle mesh simplified to at most ``most`` triangles, or unchanged if that fails."""
    if len(faces) > most:
        simple = cached_arrays(
            "triangles", [vertices, faces, str(most).encode()], lambda: _decimate(vertices, faces, most)
        )
        if len(simple["faces"]):
            return simple["vertices"], simple["faces"].astype(np.int64)
    return vertices, faces.astype(np.int64)


def _decimate(vertices: FloatArray, faces: IntArray, most: int) -> dict[str, FloatArray]:
    """Simplify a triangle mesh by quadric error metrics."""
    import igl

    origin = local_origin(vertices)  # a quadric holds squares of coordinates
    local = np.asfortranarray(relative_to(vertices, origin))
    simplified = igl.qslim(local, np.asfortranarray(faces.astype(np.int32)), most)
    return {"vertices": relative_to(np.asarray(simplified[0]), -origin), "faces": np.asarray(simplified[1])}


def _march_cubes(body: Body) -> tuple[FloatArray, IntArray]:
    """Triangulate a body's surface by marching cubes of its signed distance."""
    import igl

    lower, upper = (np.asarray(b, dtype=float) for b in body.bounds)
    half = PLATE / 2.0 * body.size
    if body.space == 2:
        lower, upper = np.append(lower, -half), np.append(upper, half)
    lower, upper = lower - MARGIN * body.size, upper + MARGIN * body.size
    step = float(np.max(upper - lower)) / CELLS
    counts = np.maximum(np.ceil((upper - lower) / step).astype(int), 6) + 1
    axes = [np.linspace(a, b, n) for a, b, n in zip(lower, upper, counts, strict=True)]
    z, y, x = np.meshgrid(*axes[::-1], indexing="ij")  # x runs fastest, as igl wants it
    grid = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    values = body.signed_distance(grid[:, : body.space])
    if body.space == 2:
        values = np.maximum(values, np.abs(grid[:, 2]) - half)
    vertices, faces, _ = igl.marching_cubes(values, grid, *(int(n) for n in counts), 0.0)
    return np.asarray(vertices), np.asarray(faces)
