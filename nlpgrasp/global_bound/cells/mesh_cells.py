"""Cells of a mesh: the nodes of a binary tree of triangle clusters (``ClusterTree``)."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import ClassVar

import numpy as np

from nlpgrasp.bodies import Mesh
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, IntArray
from nlpgrasp.global_bound.cells.cell import CellFace, RepresentativeContacts, SurfaceCell

LEVELS = 12  # levels of the cluster tree below the root
ENOUGH, MOST = 4096, 40_000  # number of pieces that sets their largest size, and largest number
LONGEST = 2.2  # longest side of a piece, relative to the square root of its share of the surface
TURN = 0.5  # weight of one radian between normals, in sizes of the body
SMALLEST = 1e-300  # least twice the area of a triangle with a normal


class TriangleCluster(SurfaceCell):
    """Cell of a mesh: a cluster of triangles and of pieces of triangles.

    Parameters
    ----------
    clusters : ClusterTree
    node : int
        Index of the node in the tree.
    """

    kind: ClassVar[str] = "mesh"

    def __init__(self, clusters: ClusterTree, node: int) -> None:
        self.clusters, self.node = clusters, node

    def representative_contacts(self) -> RepresentativeContacts:
        """Return the corners of all pieces, each with the normal of its piece."""
        rows = self.clusters.rows_of(self.node)
        return RepresentativeContacts(self.clusters.rows.points[rows], self.clusters.rows.normals[rows])

    def split(self) -> tuple[SurfaceCell, ...]:
        """Return both halves of the cluster; the cluster itself at the last level."""
        if self.node >= self.clusters.first_leaf:
            return (self,)
        return tuple(TriangleCluster(self.clusters, 2 * self.node + i) for i in (0, 1))

    def cut(self) -> int:
        """Return the number of pieces in the first half, in the tree's order."""
        return len(self.clusters.members(2 * self.node))

    def ball(self) -> tuple[FloatArray, float]:
        """Return the centre of the bounding box, and the distance to the farthest corner as radius."""
        corners = self.anchors()
        centre = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
        return centre, float(np.max(np.linalg.norm(corners - centre, axis=1)))

    def anchors(self) -> FloatArray:
        """Return the corners of all pieces of the cluster."""
        return self.clusters.pieces[self.clusters.members(self.node)].reshape(-1, 3)

    def to_dict(self) -> Json:
        """Return the halvings of the mesh's triangles, and the indices of the cell's pieces in order."""
        order = self.clusters.members(self.node).tolist()
        return {"kind": self.kind, "halved": list(self.clusters.halved), "order": order}

    def unsplit_data(self) -> Json:
        """Return the data of the whole mesh, without halvings of its triangles."""
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
        """Cluster tree of the triangles, halved until they are small."""
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
        Halvings of triangles into pieces, round by round: one character per piece, ``-`` if it was not halved, else the
        first corner 0, 1 or 2 of the side that was cut at its midpoint. The half with that corner keeps the piece's
        number, the other halves get the next numbers in order.
    pieces : (m, 3, 3) array
        Corners, metres.
    normals : (m, 3) array
    order : (m,) array
        Order of the pieces in which all clusters are ranges.
    rows : RepresentativeContacts
        Rows of all clusters of the last level in order.
    row_offsets : (2^levels + 1,) array
        First row of each of these clusters, and the number of rows.
    """

    def __init__(self, corners: FloatArray, normals: FloatArray, size: float) -> None:
        self.halved, self.pieces, owner = _halve_triangles(corners)
        self.normals = normals[owner]
        self.levels = min(int(np.log2(len(self.pieces))), LEVELS)
        features = np.concatenate([self.pieces.mean(axis=1) / size, TURN * self.normals], axis=1)
        self.order = _cluster_order(features, self.levels)
        self.rows, self.row_offsets = self._rows()

    @property
    def node_limit(self) -> int:
        """Number of clusters plus one, as there is no node 0."""
        return int(2 ** (self.levels + 1))

    @property
    def first_leaf(self) -> int:
        """Index of the first cluster of the last level."""
        return int(2**self.levels)

    def members(self, node: int) -> IntArray:
        """Return the indices of the pieces of a cluster."""
        level, count = node.bit_length() - 1, len(self.order)
        first = node - 2**level
        return self.order[first * count // 2**level : (first + 1) * count // 2**level]

    def rows_of(self, node: int) -> slice:
        """Return the index range of a cluster's representative contacts."""
        below = self.levels - node.bit_length() + 1
        first = (node << below) - self.first_leaf
        return slice(int(self.row_offsets[first]), int(self.row_offsets[first + 2**below]))

    def _rows(self) -> tuple[RepresentativeContacts, IntArray]:
        """Return the distinct corners of each last-level cluster, in order, and the offset of each cluster."""
        points = self.pieces[self.order].reshape(-1, 3)
        normals = np.repeat(self.normals[self.order], 3, axis=0)
        offsets = 3 * _level_ranges(len(self.order), self.levels)
        cluster = np.repeat(np.arange(self.first_leaf), np.diff(offsets))
        rows = np.concatenate([points, normals], axis=1)
        order = np.lexsort((rows @ np.random.default_rng(0).random(6), cluster))  # equal rows become neighbours
        rows, owner = rows[order], cluster[order]
        is_new = np.append(True, np.any(rows[1:] != rows[:-1], axis=1) | (owner[1:] != owner[:-1]))
        distinct = np.sort(order[is_new])
        row_offsets = np.searchsorted(cluster[distinct], np.arange(self.first_leaf + 1))
        return RepresentativeContacts(points[distinct], normals[distinct]), row_offsets


def _halve_triangles(corners: FloatArray) -> tuple[tuple[str, ...], FloatArray, IntArray]:
    """Halve large triangles across their longest sides; return the halvings, pieces, and triangle of each piece."""
    owner, pieces, rounds = np.arange(len(corners)), corners, list[str]()
    sides = corners[:, 1:] - corners[:, :1]
    area = 0.5 * float(np.sum(np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)))
    longest = LONGEST * float(np.sqrt(area / ENOUGH))
    while len(pieces) < MOST:
        sides = np.linalg.norm(np.roll(pieces, -1, axis=1) - pieces, axis=2)
        long_pieces = np.flatnonzero(np.max(sides, axis=1) > longest)
        if not len(long_pieces):
            break
        side = np.argmax(sides[long_pieces], axis=1)
        characters = np.full(len(pieces), "-")
        characters[long_pieces] = side.astype(str)
        rounds.append("".join(characters))
        start, end = pieces[long_pieces, side], pieces[long_pieces, (side + 1) % 3]
        opposite, midpoint = pieces[long_pieces, (side + 2) % 3], 0.5 * (start + end)
        pieces = np.concatenate([pieces, np.stack([midpoint, end, opposite], axis=1)])
        pieces[long_pieces] = np.stack([start, midpoint, opposite], axis=1)
        owner = np.concatenate([owner, owner[long_pieces]])
    return tuple(rounds), pieces, owner


def _cluster_order(features: FloatArray, levels: int) -> IntArray:
    """Return an order of the pieces in which each cluster is a contiguous range.

    Clusters are halved repeatedly across the largest spread of the features.
    """
    order = np.arange(len(features))
    for level in range(levels):
        offsets = _level_ranges(len(order), level)
        owner = np.repeat(np.arange(2**level), np.diff(offsets))
        sorted_features = features[order]
        counts = np.diff(offsets)[:, None]
        means = np.add.reduceat(sorted_features, offsets[:-1]) / counts
        spread = np.add.reduceat((sorted_features - means[owner]) ** 2, offsets[:-1])
        axis = np.argmax(spread, axis=1)
        values = sorted_features[np.arange(len(order)), axis[owner]]
        shares = (values - values.min()) / max(float(np.ptp(values)), SMALLEST)
        order = order[np.argsort(owner + 0.5 * shares, kind="stable")]
    return order


def _level_ranges(count: int, level: int) -> IntArray:
    """Return the offsets of a level's clusters in the order of pieces, (2^level + 1,)."""
    return np.asarray(np.arange(2**level + 1) * count // 2**level)
