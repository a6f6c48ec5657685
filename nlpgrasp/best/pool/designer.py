"""New mixtures for the nodes that those there are leave loosest."""

from __future__ import annotations

import numpy as np

from nlpgrasp.best.bound.mixtures import mixtures
from nlpgrasp.best.cells.base import IntArray
from nlpgrasp.best.pool.pool import Pool
from nlpgrasp.best.tree.nodes import Node
from nlpgrasp.best.tree.renewed import renewed
from nlpgrasp.best.tree.rounded import LEAST, rounded
from nlpgrasp.common.validation import FloatArray

DIRECTIONS = 24  # of a node
ROWS = 24  # of a cell that a linear program sees to begin with
NEAR = 4  # mixtures whose directions a node begins with

Mixed = tuple[float, IntArray, FloatArray]  # a bound, numbers of directions and their weights


class Designer:
    """Makes mixtures by the linear program of ``best.bound.mixtures``, over the rows that known mixtures point to.

    Parameters
    ----------
    pool : Pool
        Grows by every mixture made.
    """

    def __init__(self, pool: Pool) -> None:
        self.pool = pool

    def look(self, nodes: IntArray, rounds: int) -> list[Node]:
        """Make mixtures for nodes (b, k) in some rounds; return the nodes with bounds and designs.

        A round's mixture is looked at over the node's own cells alone, and the best of them goes to the pool.
        """
        pool, twists = self.pool, self.pool.twists
        numbers = np.stack([self._directions(node) for node in nodes])
        rows = np.stack([self._rows(node) for node in nodes])
        best: list[Mixed] = [(np.inf, numbers[0], np.zeros(0))] * len(nodes)
        weights, design = np.zeros(numbers.shape), np.zeros(rows.shape)
        for left in reversed(range(rounds)):
            rows = np.sort(rows, axis=2)
            weights, design = mixtures(self._powers(rows, numbers))
            found = np.empty((*nodes.shape, 1), dtype=np.int64)
            for i, (node, own, shares) in enumerate(zip(nodes, numbers, weights, strict=True)):
                kept = shares > LEAST
                mixture = own[kept], rounded(shares[kept])
                found[i, :, 0], bound = pool.heaviest(node, *mixture)
                if bound < best[i][0]:
                    best[i] = (bound, *mixture)
            if left:
                numbers = renewed(pool.scope, twists, numbers, weights, (rows, design))
                rows = np.concatenate([rows, found], axis=2)
        for _, own, shares in best:
            pool.add(own, shares)
        power = 1.0 / pool.scope.measure.power
        parts = zip(nodes, best, numbers, weights, rows, design, strict=True)
        return [
            Node((-(seen[0] ** power), i), tuple(node.tolist()), own, shares, there, spread)
            for i, (node, seen, own, shares, there, spread) in enumerate(parts)
        ]

    def _powers(self, rows: IntArray, numbers: IntArray) -> FloatArray:
        """Return powers of supports at rows (b, k, m), sorted, (b, k, m, j); zero for one that is there twice."""
        scope, twists = self.pool.scope, self.pool.twists[numbers]
        parts = []
        for pieces, where in scope.groups:
            own = rows[:, where]
            found = pieces.supports.powers(own.reshape(len(own), -1), twists)
            parts.append(found.reshape(*own.shape, -1))
        again = np.diff(rows, axis=2, prepend=-1) == 0
        return np.where(again[..., None], 0.0, np.concatenate(parts, axis=1))

    def _directions(self, node: IntArray) -> IntArray:
        """Return the directions of the mixtures that are the least over a node, the heaviest first, (DIRECTIONS,)."""
        pool = self.pool
        near = np.argsort(pool.each(node))[:NEAR].tolist()
        numbers = np.concatenate([pool.mixtures[i][0] for i in near])
        weights = np.concatenate([pool.mixtures[i][1] for i in near])
        heavy = numbers[np.argsort(-weights, kind="stable")]
        once = heavy[np.sort(np.unique(heavy, return_index=True)[1])]
        return np.concatenate([once, pool.twists.first()])[:DIRECTIONS]

    def _rows(self, node: IntArray) -> IntArray:
        """Return rows of each cell that do most under the mixtures that are the least over a node, (k, ROWS)."""
        near = np.argsort(self.pool.each(node))[:ROWS]
        return self.pool.rows(node, np.resize(near, ROWS))
