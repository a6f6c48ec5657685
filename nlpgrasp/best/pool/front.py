"""The nodes of a tree that are open, as arrays: thousands are cut and bounded at once."""

from __future__ import annotations

import numpy as np

from nlpgrasp.best.cells.base import IntArray
from nlpgrasp.best.pool.pool import Pool, Single

BATCH = 512  # nodes that are cut at a time
AGAIN = np.float32(1e-6)  # relative: a node whose bound exceeds a goal by less is not cut


class Front:
    """Open nodes, and what it took to get there.

    Parameters
    ----------
    pool : Pool
    excluded : (groups, clusters) array of bool
        Cells of contacts that are alike which constraints leave nothing of.
    """

    def __init__(self, pool: Pool, excluded: np.ndarray) -> None:
        self.pool, self._excluded = pool, np.ravel(excluded)
        self.nodes = np.ones((1, len(pool.offsets)), dtype=np.int64)
        self.bounds = pool.bounds(self.nodes)[0]
        self.splits: list[tuple[IntArray, IntArray]] = []
        self.made = 1
        self._groups = [where for _, where in pool.scope.groups]

    def __len__(self) -> int:
        return len(self.nodes)

    def loosest(self, count: int) -> IntArray:
        """Return where some of the nodes with the largest bounds are, renewed by the mixtures there are now."""
        every = np.arange(len(self))
        where = every if count >= len(self) else np.argpartition(-self.bounds, count - 1)[:count]
        self.bounds[where] = np.minimum(self.bounds[where], self.pool.bounds(self.nodes[where])[0])
        return where[np.argsort(-self.bounds[where], kind="stable")]

    def take(self, where: IntArray) -> tuple[IntArray, Single]:
        """Return some nodes and their bounds, which are open no more."""
        taken = self.nodes[where], self.bounds[where]
        kept = np.ones(len(self), dtype=bool)
        kept[where] = False
        self.nodes, self.bounds = self.nodes[kept], self.bounds[kept]
        return taken

    def cut(self, where: IntArray) -> tuple[IntArray, Single]:
        """Replace some nodes by their parts: each is cut at the slot whose parts have the least bounds on average.

        Returns
        -------
        nodes : (n, k) array
            Those that cannot be cut: all their cells are of the last level.
        bounds : (n,) array
        """
        nodes, bounds = self.take(where)
        chosen, score = np.full(len(nodes), -1), np.full(len(nodes), np.inf)
        for slot in range(nodes.shape[1]):
            can = nodes[:, slot] < self.pool.clusters.last
            if slot and self.pool.offsets[slot] == self.pool.offsets[slot - 1]:
                can &= nodes[:, slot] != nodes[:, slot - 1]
            own = np.flatnonzero(can)
            if not len(own):
                continue
            parts, parent = self._parts(nodes[own], np.full(len(own), slot))
            found = np.maximum(np.minimum(self.pool.bounds(parts)[0], bounds[own][parent]), 0.0)
            mean = np.bincount(parent, found, len(own)) / np.maximum(np.bincount(parent, minlength=len(own)), 1)
            better = mean < score[own]
            score[own[better]], chosen[own[better]] = mean[better], slot
        done = chosen < 0
        self._replace(nodes[~done], bounds[~done], chosen[~done])
        return nodes[done], bounds[done]

    def _replace(self, nodes: IntArray, bounds: Single, slots: IntArray) -> None:
        parts, parent = self._parts(nodes, slots)
        found = np.minimum(self.pool.bounds(parts)[0], bounds[parent])
        self.splits.append((nodes, slots))
        self.nodes, self.bounds = np.concatenate([self.nodes, parts]), np.concatenate([self.bounds, found])
        self.made += len(parts)

    def _parts(self, nodes: IntArray, slots: IntArray) -> tuple[IntArray, IntArray]:
        """Return the parts of nodes (n, k), each cut at its slot (n,): (m, k), and whose parts they are, (m,).

        All contacts that are alike in that slot's cell go to its halves in every possible way.
        """
        parts, parents = [], []
        for group in self._groups:
            here = np.flatnonzero((slots >= group.start) & (slots < group.stop))
            cell = nodes[here, slots[here]][:, None]
            same = np.zeros((len(here), nodes.shape[1]), dtype=bool)
            same[:, group] = nodes[here, group] == cell
            rank, times = np.cumsum(same, axis=1), np.sum(same, axis=1)
            for left in range(group.stop - group.start + 1):
                own = times >= left
                halves = 2 * cell[own] + (rank[own] > left)
                made = np.where(same[own], halves, nodes[here[own]])
                made[:, group] = np.sort(made[:, group], axis=1)
                parts.append(made)
                parents.append(here[own])
        every, parent = np.concatenate(parts), np.concatenate(parents)
        allowed = ~np.any(self._excluded[every + self.pool.offsets], axis=1)
        return every[allowed], parent[allowed]


def grown(pool: Pool, excluded: np.ndarray, goal: float, most: int) -> tuple[Front, bool]:
    """Return a new tree that is cut until no node's bound exceeds a goal, or there are so many nodes.

    With all mixtures there from the beginning it needs fewer nodes than the search that made them.

    Returns
    -------
    front : Front
        With the nodes that could not be cut.
    reached : bool
    """
    front = Front(pool, excluded)
    stuck = [(front.nodes[:0], front.bounds[:0])]
    while True:
        open_ = np.flatnonzero(front.bounds > np.float32(goal) * (1 + AGAIN))
        left = most - len(front) - sum(len(nodes) for nodes, _ in stuck)
        if not len(open_) or left <= 0:
            break
        loosest = open_[np.argsort(-front.bounds[open_], kind="stable")[: min(BATCH, left)]]
        stuck.append(front.cut(loosest))
    front.nodes = np.concatenate([front.nodes, *(nodes for nodes, _ in stuck)])
    front.bounds = np.concatenate([front.bounds, *(bounds for _, bounds in stuck)])
    return front, not len(open_)
