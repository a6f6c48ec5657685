"""Mixtures of directions, each a bound on every placement, with what each bounds over every cluster of a mesh."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.best.bound.twists import Twists
from nlpgrasp.best.cells.base import IntArray
from nlpgrasp.best.cells.clusters import Clusters
from nlpgrasp.best.pool.corners import EVERY, Corners
from nlpgrasp.best.scope.scope import Scope
from nlpgrasp.common.validation import FloatArray

FIRST = 64  # mixtures that there is room for to begin with
WORK = 2_000_000  # nodes times mixtures at a time
ROUNDING = np.float32(3e-5)  # relative: more than what single precision takes from a sum over contacts

Single = NDArray[np.float32]


class Pool:
    """Mixtures that all nodes share.

    A mixture w of directions y bounds every placement, ``mu^p <= sum_i g_i(p_i)`` with
    ``g_i(p) = sum_j w_j s_i(p, y_j)^p``. Kept are the largest g over each cluster, for contacts that are alike, so that
    a node's bound is the least of many short sums. They are in single precision, from above: what is claimed in the
    end is computed anew.

    Parameters
    ----------
    scope : Scope
        Of which every contact has the same clusters.
    clusters : Clusters
    twists : Twists
    """

    def __init__(self, scope: Scope, clusters: Clusters, twists: Twists) -> None:
        self.scope, self.clusters, self.twists = scope, clusters, twists
        self.corners = self._corners(single=True)
        group = [i for i, pieces in enumerate(scope.pieces) for _ in pieces.slots]
        self.offsets = clusters.count * np.array(group, dtype=np.int64)
        self.mixtures: list[tuple[IntArray, FloatArray]] = []
        self._most = np.zeros((clusters.count * len(self.corners), FIRST), dtype=np.float32)
        self._where = np.zeros((clusters.last * len(self.corners), FIRST), dtype=np.int32)
        self._cluster = np.repeat(np.arange(clusters.last), np.diff(clusters.begin))

    def __len__(self) -> int:
        """Return how many mixtures there are."""
        return len(self.mixtures)

    def add(self, numbers: IntArray, weights: FloatArray) -> None:
        """Add a mixture of directions (j,), by number, with weights (j,)."""
        k, last = len(self.mixtures), self.clusters.last
        if k == self._most.shape[1]:
            self._most, self._where = (np.concatenate([a, np.zeros_like(a)], axis=1) for a in (self._most, self._where))
        for i, corners in enumerate(self.corners):
            mixed = self._mixed(corners, numbers, weights)
            most = self._over_clusters(mixed)
            hit = np.flatnonzero(mixed == most[last:][self._cluster])
            self._where[last * i + self._cluster[hit], k] = hit
            with np.errstate(over="ignore"):  # inf is a bound too
                self._most[2 * last * i : 2 * last * (i + 1), k] = most.astype(np.float32) * (1 + ROUNDING)
        self.mixtures.append((numbers, weights))

    def largest(self, numbers: IntArray, weights: FloatArray) -> FloatArray:
        """Return the largest g of a mixture over every cluster, for one group of contacts after another."""
        return np.concatenate([self._over_clusters(self._mixed(c, numbers, weights)) for c in self._exact])

    def heaviest(self, node: IntArray, numbers: IntArray, weights: FloatArray) -> tuple[IntArray, float]:
        """Return the row of each cell of a node (k,) that has most of a mixture, (k,), and the bound that it gives."""
        found: dict[tuple[int, int], tuple[int, float]] = {}
        places = list(zip(node.tolist(), (self.offsets // self.clusters.count).tolist(), strict=True))
        for cell, group in places:
            if (cell, group) not in found:
                part = self.clusters.rows_of(cell)
                mixed = self._mixed(self.corners[group], numbers, weights, part)
                best = int(np.argmax(mixed))
                found[cell, group] = part.start + best, float(mixed[best])
        return np.array([found[place][0] for place in places]), sum(found[place][1] for place in places)

    @cached_property
    def _exact(self) -> list[Corners]:
        return self._corners(single=False)

    def _corners(self, single: bool) -> list[Corners]:
        every = slice(0, len(self.clusters.rows.points))
        return [Corners(pieces.supports, every, single) for pieces, _ in self.scope.groups]

    def _mixed(self, corners: Corners, numbers: IntArray, weights: FloatArray, part: slice = EVERY) -> FloatArray:
        return corners.mixed(self.twists[numbers], weights / np.sum(weights), part)

    def _over_clusters(self, mixed: FloatArray) -> FloatArray:
        """Return the largest of a value at every row over every cluster."""
        first = self.clusters.last
        most = np.zeros(2 * first)
        most[first:] = np.maximum.reduceat(mixed, self.clusters.begin[:-1])
        while first > 1:
            first //= 2
            halves = most[2 * first : 4 * first]
            most[first : 2 * first] = np.maximum(halves[::2], halves[1::2])
        return most

    def each(self, node: IntArray) -> Single:
        """Return what every mixture bounds mu to the measure's power by over a node (k,)."""
        return np.asarray(np.sum(self._most[node + self.offsets, : len(self)], axis=0))

    def bounds(self, nodes: IntArray) -> tuple[Single, IntArray]:
        """Return the least bounds over nodes (n, k), (n,), on mu to the measure's power, and of which mixtures."""
        least, best = np.empty(len(nodes), dtype=np.float32), np.empty(len(nodes), dtype=np.int64)
        most, own = self._most[:, : len(self)], nodes + self.offsets
        step = max(1, WORK // len(self))
        for begin in range(0, len(nodes), step):
            some = own[begin : begin + step]
            total = most[some[:, 0]]
            for slot in range(1, some.shape[1]):
                total += most[some[:, slot]]
            best[begin : begin + step] = chosen = np.argmin(total, axis=1)
            least[begin : begin + step] = total[np.arange(len(some)), chosen]
        return least, best

    def rows(self, node: IntArray, mixtures: IntArray) -> IntArray:
        """Return the rows of a node's cells (k,) that have most of some mixtures (n,), (k, n)."""
        result = np.empty((len(node), len(mixtures)), dtype=np.int64)
        last, count = self.clusters.last, self.clusters.count
        for slot, (cell, offset) in enumerate(zip(node.tolist(), self.offsets.tolist(), strict=True)):
            at = np.full(len(mixtures), cell)
            while at[0] < last:
                left, right = (self._most[offset + 2 * at + i, mixtures] for i in (0, 1))
                at = 2 * at + (right > left)
            result[slot] = self._where[at - last + offset // count * last, mixtures]
        return result
