"""A mesh's triangles as a tree of clusters, and the rows of all of them in one table."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from nlpgrasp.best.cells.base import IntArray, Rows
from nlpgrasp.common.validation import FloatArray

DEEPEST = 15  # levels: of meshes with more triangles than this allows, clusters of the last have several
STEP = 3  # levels from a row to the finer ones that stand for it
TURN = 0.5  # what a turn of the normal by a radian weighs, in sizes of the body


class Clusters:
    """A balanced tree over triangles: node i has the children 2 i and 2 i + 1, the root is 1.

    A cluster's row is its box's middle with the triangles' mean normal; its cone holds all their normals, its radius
    all their points (``best.bound.wide`` says what that bounds). Triangles themselves have three exact rows.

    Parameters
    ----------
    corners : (t, 3, 3) array
        Of each triangle, metres, body frame.
    normals : (t, 3) array
        Unit, into the body.
    size : float
        Of the body, metres.
    """

    def __init__(self, corners: FloatArray, normals: FloatArray, size: float) -> None:
        self.corners, self.normals = corners, normals
        self.levels = min(int(np.log2(len(corners))), DEEPEST)
        self.exact = len(corners) < 2 ** (self.levels + 1)
        self.order = _ordered(np.concatenate([corners.mean(axis=1) / size, TURN * normals], axis=1), self.levels)
        self.centres = np.zeros((self.count, 3))
        self.radii = np.zeros(self.count)
        self.cones = np.zeros((0, 2))
        self.table = self._table()

    @property
    def count(self) -> int:
        """Clusters, and one that is none."""
        return int(2 ** (self.levels + 1))

    def members(self, node: int) -> IntArray:
        """Return the numbers of a cluster's triangles."""
        level = node.bit_length() - 1
        ends = _ends(len(self.order), level)
        return self.order[ends[node - 2**level] : ends[node - 2**level + 1]]

    def below(self, node: int, levels: int) -> IntArray:
        """Return the rows that stand for a cluster some levels further down: exact ones where there are no clusters."""
        deeper = min(levels, self.levels - node.bit_length() + 1)
        nodes = np.arange(node * 2**deeper, (node + 1) * 2**deeper)
        return nodes if deeper == levels or not self.exact else np.unique(self._finer[nodes])

    def _table(self) -> Rows:
        corners, normals = self.corners[self.order], self.normals[self.order]
        means, turns = np.zeros((self.count, 3)), np.zeros(self.count)
        means[0, 2] = 1.0
        for level in range(self.levels + 1):
            ends = _ends(len(corners), level)
            owner = np.repeat(np.arange(2**level), np.diff(ends))
            here = slice(2**level, 2 ** (level + 1))
            low = np.minimum.reduceat(corners.min(axis=1), ends[:-1])
            middle = 0.5 * (low + np.maximum.reduceat(corners.max(axis=1), ends[:-1]))
            apart = np.linalg.norm(corners - middle[owner, None], axis=2).max(axis=1)
            total = np.add.reduceat(normals, ends[:-1])
            total[:, 2] += 1e-9  # a cluster that is all around has no mean: any unit vector will do
            mean = total / np.linalg.norm(total, axis=1, keepdims=True)
            turn = 2.0 * np.arcsin(np.minimum(0.5 * np.linalg.norm(normals - mean[owner], axis=1), 1.0))
            self.centres[here], self.radii[here] = middle, np.maximum.reduceat(apart, ends[:-1])
            means[here], turns[here] = mean, np.maximum.reduceat(turn, ends[:-1])
        self.cones = np.stack([turns, self.radii], axis=1)
        finer = self._finer
        if not self.exact:
            return Rows(self.centres, means, self.cones, finer)
        points = np.concatenate([self.centres, corners.reshape(-1, 3)])
        every = np.concatenate([means, np.repeat(normals, 3, axis=0)])
        more = 3 * len(corners)
        self.cones = np.concatenate([self.cones, np.zeros((more, 2))])
        return Rows(points, every, self.cones, np.concatenate([finer, np.full((more, 2**STEP), -1)]))

    @cached_property
    def _finer(self) -> IntArray:
        """Return for each cluster the rows that stand for its part more finely, the last repeated; -1 for none."""
        result = np.full((self.count, 2**STEP), -1, dtype=np.int64)
        for level in range(self.levels):
            nodes = np.arange(2**level, 2 ** (level + 1))
            step = min(STEP, self.levels - level)
            result[nodes] = nodes[:, None] * 2**step + np.minimum(np.arange(2**STEP), 2**step - 1)
        if self.exact:
            ends = _ends(len(self.order), self.levels)
            spread = np.minimum(3 * ends[:-1, None] + np.arange(2**STEP), 3 * ends[1:, None] - 1)
            result[2**self.levels :] = self.count + spread
        return result


def _ordered(features: FloatArray, levels: int) -> IntArray:
    """Return an order in which all clusters are ranges: halved again and again where they are most spread."""
    order = np.arange(len(features))
    for level in range(levels):
        ends = _ends(len(order), level)
        owner = np.repeat(np.arange(2**level), np.diff(ends))
        own = features[order]
        number = np.diff(ends)[:, None]
        mean = np.add.reduceat(own, ends[:-1]) / number
        spread = np.add.reduceat((own - mean[owner]) ** 2, ends[:-1])
        axis = np.argmax(spread, axis=1)
        order = order[np.lexsort((own[np.arange(len(own)), axis[owner]], owner))]
    return order


def _ends(count: int, level: int) -> IntArray:
    """Return where the clusters of a level begin and end in the order, (2^level + 1,)."""
    return np.asarray(np.arange(2**level + 1) * count // 2**level)
