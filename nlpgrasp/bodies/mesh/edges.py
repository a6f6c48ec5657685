"""Sharp edges of a triangle mesh and distances from them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from nlpgrasp.bodies.face import SHARP
from nlpgrasp.common.meshes.search_tree import IntArray, SearchTree
from nlpgrasp.common.validation import FloatArray

if TYPE_CHECKING:
    import trimesh

FLAT = 1e-12  # of the squared size: area below which a triangle's normal is unreliable


class SharpEdges:
    """Edges with more than 30 degrees between adjacent triangle normals, convex or concave.

    Parameters
    ----------
    mesh : trimesh.Trimesh
        Vertices in metres.
    """

    def __init__(self, mesh: trimesh.Trimesh) -> None:
        areas = np.asarray(mesh.area_faces)[np.asarray(mesh.face_adjacency)]
        solid = np.min(areas, axis=1, initial=np.inf) > FLAT * float(np.sum(np.ptp(mesh.bounds, axis=0) ** 2))
        turned = np.asarray(mesh.face_adjacency_angles) > SHARP
        self._edges: IntArray = np.asarray(mesh.face_adjacency_edges, dtype=np.int64)[solid & turned]
        self._vertices = np.asarray(mesh.vertices, dtype=float)
        self._tree = SearchTree(self._vertices, self._edges)

    @property
    def ends(self) -> IntArray:
        """Vertex indices of each edge, (m, 2)."""
        return self._edges

    def __len__(self) -> int:
        """Return the number of edges."""
        return len(self._edges)

    def distance(self, points: FloatArray) -> FloatArray:
        """Return the distances (m,), metres, of points (m, 3) from the nearest sharp edge; inf without any."""
        if not len(self._edges) or not len(points):
            return np.full(len(points), np.inf)
        return np.asarray(np.sqrt(self._tree.nearest(points)[0]))

    def nearest(self, point: FloatArray, count: int) -> FloatArray:
        """Return the end points (m, 2, 3) of up to ``count`` sharp edges nearest to a point (3,)."""
        ends = self._vertices[self._edges]
        along = ends[:, 1] - ends[:, 0]
        share = np.sum((point - ends[:, 0]) * along, axis=1) / np.maximum(np.sum(along**2, axis=1), 1e-300)
        foot = ends[:, 0] + np.clip(share, 0.0, 1.0)[:, None] * along
        return np.asarray(ends[np.argsort(np.linalg.norm(foot - point, axis=1), kind="stable")[:count]])
