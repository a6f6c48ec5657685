"""Clusters of a mesh's triangles: cells of the mesh itself, with its own normals."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import ClassVar

import numpy as np

from nlpgrasp.best.cells.base import Cell, Rows, Surface
from nlpgrasp.best.cells.clusters import Clusters
from nlpgrasp.bodies import Mesh
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray

SMALLEST = 1e-300  # twice the area of a triangle that has a normal


class MeshCell(Cell):
    """A cluster of triangles, or of pieces of them.

    Parameters
    ----------
    clusters : Clusters
    node : int
        Of the tree.
    """

    kind: ClassVar[str] = "mesh"

    def __init__(self, clusters: Clusters, node: int) -> None:
        self.clusters, self.node = clusters, node

    def rows(self) -> Rows:
        """Return the corners of all pieces with the normal of each."""
        own = self.clusters.rows_of(self.node)
        return Rows(self.clusters.rows.points[own], self.clusters.rows.normals[own])

    def split(self) -> tuple[Cell, ...]:
        """Return both halves of the cluster; of one of the last level itself."""
        if self.node >= self.clusters.last:
            return (self,)
        return tuple(MeshCell(self.clusters, 2 * self.node + i) for i in (0, 1))

    def cut(self) -> int:
        """Return how many pieces, in the order in which they are stated, are in the first part."""
        return len(self.clusters.members(2 * self.node))

    def ball(self) -> tuple[FloatArray, float]:
        """Return the middle of the cluster's box and the distance to the farthest corner of a piece."""
        corners = self.anchors()
        middle = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
        return middle, float(np.max(np.linalg.norm(corners - middle, axis=1)))

    def anchors(self) -> FloatArray:
        """Return the corners of all pieces."""
        return self.clusters.pieces[self.clusters.members(self.node)].reshape(-1, 3)

    def to_dict(self) -> Json:
        """Return how the mesh's triangles are halved, and the numbers of the cell's pieces in order."""
        order = self.clusters.members(self.node).tolist()
        return {"kind": self.kind, "halved": list(self.clusters.halved), "order": order}

    def uncut(self) -> Json:
        """Return the data of the whole mesh, whose triangles stay as they are."""
        return {"kind": self.kind, "halved": [], "order": None}


class MeshFace(Surface):
    """The surface of a mesh: its triangles, with their own normals.

    Parameters
    ----------
    name : str
    body : Mesh
    """

    def __init__(self, name: str, body: Mesh) -> None:
        super().__init__(name)
        self.body = body

    @cached_property
    def clusters(self) -> Clusters:
        """The triangles, halved until they are small."""
        corners = np.asarray(self.body.mesh.triangles, dtype=float)
        sides = corners[:, 1:] - corners[:, :1]
        inward = np.cross(sides[:, 1], sides[:, 0])
        inward /= np.maximum(np.linalg.norm(inward, axis=1, keepdims=True), SMALLEST)
        return Clusters(corners, inward, self.body.size)

    def cells(self) -> Sequence[Cell]:
        """Return the whole surface as one cell."""
        return [MeshCell(self.clusters, 1)]
