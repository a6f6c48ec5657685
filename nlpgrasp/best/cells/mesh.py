"""Clusters of a mesh's triangles: cells of the mesh itself, with its own normals."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from trimesh.remesh import subdivide_to_size

from nlpgrasp.best.cells.base import Cell, IntArray, Rows, Surface
from nlpgrasp.best.cells.bundle import BundleCell
from nlpgrasp.best.cells.clusters import Clusters
from nlpgrasp.best.cells.polygon import PolygonCell
from nlpgrasp.bodies import Mesh
from nlpgrasp.common.spatial import tangents
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray

EVEN = 3.0  # longest side of a triangle over the root of its share of the surface
LEVELS = 7  # below a cluster, of the rows that stand for it to begin with


class MeshCell(Cell):
    """A cluster of triangles.

    Its rows are those of smaller clusters, of the triangles' corners where these are few; finer ones replace them where
    a bound needs it. What it claims is never below what the corners with their triangles' normals give.

    Parameters
    ----------
    clusters : Clusters
    node : int
        Of the tree.
    size : float
        Of the body, metres.
    """

    kind: ClassVar[str] = "mesh"

    def __init__(self, clusters: Clusters, node: int, size: float) -> None:
        self.clusters, self.node, self.size = clusters, node, size

    def rows(self) -> Rows:
        """Return the rows of smaller clusters."""
        table, numbers = self.part_of()
        return Rows(table.points[numbers], table.normals[numbers], self.clusters.cones[numbers])

    def part_of(self) -> tuple[Rows, IntArray]:
        """Return the table of the mesh, and which rows are this cell's."""
        return self.clusters.table, self.clusters.below(self.node, LEVELS)

    def split(self) -> tuple[Cell, ...]:
        """Return both halves of the cluster; of a triangle its own."""
        if self.node < self.clusters.count // 2:
            return tuple(MeshCell(self.clusters, 2 * self.node + i, self.size) for i in (0, 1))
        members = self._triangles()
        if len(members) == 1:
            return members[0].split()
        first = self.cut()
        return tuple(p[0] if len(p) == 1 else BundleCell(p, self.size) for p in (members[:first], members[first:]))

    def cut(self) -> int:
        """Return how many triangles, in the order in which they are stated, are in the first part; of one, its cut."""
        if self.node < self.clusters.count // 2:
            return len(self.clusters.members(2 * self.node))
        members = self._triangles()
        return members[0].cut() if len(members) == 1 else len(members) // 2

    def _triangles(self) -> list[PolygonCell]:
        normals, corners = self.clusters.normals, self.clusters.corners
        members = self.clusters.members(self.node)
        return [PolygonCell(corners[i], normals[i], tangents(normals[i][None])[0]) for i in members]

    def ball(self) -> tuple[FloatArray, float]:
        """Return the middle of the cluster's box and the distance to the farthest corner of a triangle."""
        return self.clusters.centres[self.node], float(self.clusters.radii[self.node])

    def anchors(self) -> FloatArray:
        """Return the corners of all triangles."""
        return self.clusters.corners[self.clusters.members(self.node)].reshape(-1, 3)

    def to_dict(self) -> Json:
        """Return the numbers of the triangles: their corners, with the normal of each, bound the cell exactly."""
        return {"kind": self.kind, "triangles": self.clusters.members(self.node).tolist()}


class MeshFace(Surface):
    """The surface of a mesh: its triangles, with their own normals.

    Parameters
    ----------
    name : str
    body : Mesh
    """

    rough: ClassVar[bool] = True

    def __init__(self, name: str, body: Mesh) -> None:
        super().__init__(name)
        self.body = body
        corners = np.asarray(body.mesh.triangles, dtype=float)
        normals = np.asarray(body.mesh.face_normals, dtype=float)
        self.clusters = Clusters(corners, -normals, body.size)

    def cells(self) -> Sequence[Cell]:
        """Return the whole surface as one cell."""
        return [MeshCell(self.clusters, 1, self.body.size)]

    def moved(self, point: FloatArray, steps: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the points of the mesh that are nearest to steps along the tangents of the point's triangle."""
        first, outward, _ = self.body.closest(point[None])
        points, normals, _ = self.body.closest(first + steps @ tangents(-outward)[0])
        return points, -normals

    def places(self, count: int) -> tuple[FloatArray, FloatArray]:
        """Return the middles of triangles, of large ones cut into even parts; of too many, some from all clusters."""
        mesh = self.body.mesh
        side = EVEN * float(np.sqrt(mesh.area / count))
        vertices, faces, owner = subdivide_to_size(mesh.vertices, mesh.faces, side, max_iter=20, return_index=True)
        rank = np.empty(len(self.clusters.order), dtype=np.int64)
        rank[self.clusters.order] = np.arange(len(rank))
        some = np.argsort(rank[owner], kind="stable")[:: max(1, len(owner) // count)]
        return np.asarray(vertices)[faces[some]].mean(axis=1), self.clusters.normals[owner[some]]
