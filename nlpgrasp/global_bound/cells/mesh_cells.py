"""Cells of a mesh: a binary tree of triangle clusters (``ClusterTree``), each node of which is a cell."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import ClassVar

import numpy as np

from nlpgrasp.bodies import Mesh
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.global_bound.cells.cell import CellFace, IntArray, RepresentativeContacts, SurfaceCell

LEVELS = 12  # of clusters below the whole surface
ENOUGH, MOST = 4096, 40_000  # pieces: so many that large triangles are halved, and where that ends
LONGEST = 2.2  # longest side of a piece, over the root of its share of the surface
TURN = 0.5  # what a turn of the normal by a radian weighs, in sizes of the body
SMALLEST = 1e-300  # twice the area of a triangle that has a normal


class TriangleCluster(SurfaceCell):
    """A cluster of triangles, or of pieces of them.

    Parameters
    ----------
    clusters : ClusterTree
    node : int
        Of the tree.
    """

    kind: ClassVar[str] = "mesh"

    def __init__(self, clusters: ClusterTree, node: int) -> None:
        self.clusters, self.node = clusters, node

    def rows(self) -> RepresentativeContacts:
        """Return the corners of all pieces with the normal of each."""
        own = self.clusters.rows_of(self.node)
        return RepresentativeContacts(self.clusters.rows.points[own], self.clusters.rows.normals[own])

    def split(self) -> tuple[SurfaceCell, ...]:
        """Return both halves of the cluster; of one of the last level itself."""
        if self.node >= self.clusters.last:
            return (self,)
        return tuple(TriangleCluster(self.clusters, 2 * self.node + i) for i in (0, 1))

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

    def whole_data(self) -> Json:
        """Return the data of the whole mesh, whose triangles stay as they are."""
        return {"kind": self.kind, "halved": [], "order": None}


class MeshFace(CellFace):
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
    def clusters(self) -> ClusterTree:
        """The triangles, halved until they are small."""
        corners = np.asarray(self.body.mesh.triangles, dtype=float)
        sides = corners[:, 1:] - corners[:, :1]
        inward = np.cross(sides[:, 1], sides[:, 0])
        inward /= np.maximum(np.linalg.norm(inward, axis=1, keepdims=True), SMALLEST)
        return ClusterTree(corners, inward, self.body.size)

    def cells(self) -> Sequence[SurfaceCell]:
        """Return the whole surface as one cell."""
        return [TriangleCluster(self.clusters, 1)]


class ClusterTree:
    """Balanced binary tree of triangle pieces: node i has the children 2 i and 2 i + 1, the root is 1.

    A piece is flat, so that convex functions of a contact's work are largest at one of its corners: the rows of a
    cluster are the corners of its pieces with the normal of each.

    Parameters
    ----------
    corners : (t, 3, 3) array
        Of each triangle, metres, body frame.
    normals : (t, 3) array
        Unit, into the body.
    size : float
        Of the body, metres.

    Attributes
    ----------
    halved : tuple of str
        How triangles became pieces: each a character for every piece so far, ``-`` where it stayed as it was and else
        the side, from corner 0, 1 or 2 on, across whose middle it was halved. The half with that corner takes the
        piece's number, the others get the next ones in order.
    pieces : (m, 3, 3) array
        Corners, metres.
    normals : (m, 3) array
    order : (m,) array
        In which all clusters are ranges.
    rows : RepresentativeContacts
        Of all clusters of the last level, one after another.
    begin : (2^levels + 1,) array
        Where the rows of each of these begin, and the end.
    """

    def __init__(self, corners: FloatArray, normals: FloatArray, size: float) -> None:
        self.halved, self.pieces, owner = _halve_triangles(corners)
        self.normals = normals[owner]
        self.levels = min(int(np.log2(len(self.pieces))), LEVELS)
        features = np.concatenate([self.pieces.mean(axis=1) / size, TURN * self.normals], axis=1)
        self.order = _ordered(features, self.levels)
        self.rows, self.begin = self._rows()

    @property
    def count(self) -> int:
        """Clusters, and one that is none."""
        return int(2 ** (self.levels + 1))

    @property
    def last(self) -> int:
        """The first cluster of the last level."""
        return int(2**self.levels)

    def range(self, node: int) -> tuple[int, int]:
        """Return where in the order a cluster's pieces begin and end."""
        level = node.bit_length() - 1
        ends = (i * len(self.order) // 2**level for i in (node - 2**level, node - 2**level + 1))
        low, high = ends
        return low, high

    def members(self, node: int) -> IntArray:
        """Return the numbers of a cluster's pieces."""
        return self.order[slice(*self.range(node))]

    def rows_of(self, node: int) -> slice:
        """Return which rows are a cluster's."""
        below = self.levels - node.bit_length() + 1
        first = (node << below) - self.last
        return slice(int(self.begin[first]), int(self.begin[first + 2**below]))

    def _rows(self) -> tuple[RepresentativeContacts, IntArray]:
        """Return the corners of all pieces in order, within each last cluster once, and where clusters begin."""
        points = self.pieces[self.order].reshape(-1, 3)
        normals = np.repeat(self.normals[self.order], 3, axis=0)
        ends = 3 * _level_ranges(len(self.order), self.levels)
        cluster = np.repeat(np.arange(self.last), np.diff(ends))
        once = np.unique(np.column_stack([cluster, points, normals]), axis=0, return_index=True)[1]
        begin = np.searchsorted(cluster[np.sort(once)], np.arange(self.last + 1))
        return RepresentativeContacts(points[np.sort(once)], normals[np.sort(once)]), begin


def _halve_triangles(corners: FloatArray) -> tuple[tuple[str, ...], FloatArray, IntArray]:
    """Return how triangles are halved across their longest sides, the pieces, and the triangle each is part of."""
    owner, pieces, rounds = np.arange(len(corners)), corners, list[str]()
    sides = corners[:, 1:] - corners[:, :1]
    area = 0.5 * float(np.sum(np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)))
    longest = LONGEST * float(np.sqrt(area / ENOUGH))
    while len(pieces) < MOST:
        sides = np.linalg.norm(np.roll(pieces, -1, axis=1) - pieces, axis=2)
        long = np.flatnonzero(np.max(sides, axis=1) > longest)
        if not len(long):
            break
        side = np.argmax(sides[long], axis=1)
        characters = np.full(len(pieces), "-")
        characters[long] = side.astype(str)
        rounds.append("".join(characters))
        start, end = pieces[long, side], pieces[long, (side + 1) % 3]
        across, middle = pieces[long, (side + 2) % 3], 0.5 * (start + end)
        pieces = np.concatenate([pieces, np.stack([middle, end, across], axis=1)])
        pieces[long] = np.stack([start, middle, across], axis=1)
        owner = np.concatenate([owner, owner[long]])
    return tuple(rounds), pieces, owner


def _ordered(features: FloatArray, levels: int) -> IntArray:
    """Return an order in which all clusters are ranges: halved again and again where they are most spread."""
    order = np.arange(len(features))
    for level in range(levels):
        ends = _level_ranges(len(order), level)
        owner = np.repeat(np.arange(2**level), np.diff(ends))
        own = features[order]
        number = np.diff(ends)[:, None]
        mean = np.add.reduceat(own, ends[:-1]) / number
        spread = np.add.reduceat((own - mean[owner]) ** 2, ends[:-1])
        axis = np.argmax(spread, axis=1)
        order = order[np.lexsort((own[np.arange(len(own)), axis[owner]], owner))]
    return order


def _level_ranges(count: int, level: int) -> IntArray:
    """Return where the clusters of a level begin and end in the order, (2^level + 1,)."""
    return np.asarray(np.arange(2**level + 1) * count // 2**level)
