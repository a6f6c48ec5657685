"""Branch and bound over the clusters of a mesh."""

from __future__ import annotations

import numpy as np

from nlpgrasp.best.bound.twists import Twists
from nlpgrasp.best.cells.base import IntArray
from nlpgrasp.best.cells.clusters import Clusters
from nlpgrasp.best.cells.mesh import MeshCell
from nlpgrasp.best.pool.designer import DIRECTIONS, Designer
from nlpgrasp.best.pool.front import Front
from nlpgrasp.best.pool.pool import Pool
from nlpgrasp.best.scope.scope import Scope
from nlpgrasp.best.tree.nodes import Node

ROOT_ROUNDS, ROUNDS = 30, 5  # of linear programs, for the whole surface and for a node
TOP, CUT = 512, 0.5  # nodes that are looked at again at a time, and the share of these that is cut
LOOKED = 4  # nodes that new mixtures are made for at a time
APART = 2  # cells in which these differ at least
MOST_OPEN, MOST_MIXTURES = 2_000_000, 6000  # beyond which a search ends


class PoolTree:
    """What is left to look at of a mesh: many nodes, cheaply bounded by the mixtures that were made for a few.

    Parameters
    ----------
    scope : Scope
        Of contacts that may be on one mesh.
    clusters : Clusters
        The mesh's.
    """

    def __init__(self, scope: Scope, clusters: Clusters) -> None:
        self.scope = scope
        self.twists = Twists(scope.task, scope.problem.body.size, DIRECTIONS)
        self.pool = Pool(scope, clusters, self.twists)
        self.front: Front | None = None
        self.looked = 0
        self._designer = Designer(self.pool)
        self._closed = 0.0
        self.excluded = self._exclude()

    @property
    def nodes(self) -> int:
        """How many nodes there were."""
        return 0 if self.front is None else self.front.made

    @property
    def top(self) -> float:
        """The loosest bound of a node that is open, 0 where none is."""
        return self._mu(float(np.max(self.front.bounds))) if self.front is not None and len(self.front) else 0.0

    @property
    def upper(self) -> float:
        """An upper bound on mu over all placements."""
        return max(self._closed, self.top)

    @property
    def full(self) -> bool:
        """Whether as many nodes are open, or mixtures are there, as memory is meant for."""
        return len(self.pool) >= MOST_MIXTURES or (self.front is not None and len(self.front) >= MOST_OPEN)

    def begin(self, target: float) -> list[Node]:
        """Bound the one node of all placements."""
        del target
        first = self.twists.first()
        self.pool.add(first, np.full(len(first), 1.0 / len(first)))
        found = self._designer.look(np.ones((1, len(self.scope.slots)), dtype=np.int64), ROOT_ROUNDS)
        self.front = Front(self.pool, self.excluded)
        return self._counted(found)

    def grow(self, target: float) -> list[Node]:
        """Cut the loosest nodes, and make mixtures for some of those that are then; return these."""
        front = self.front
        if front is None or not len(front):
            return []
        where = front.loosest(TOP)
        bounds = front.bounds[where]
        loose = where[bounds >= np.quantile(bounds, CUT)]
        self._close(front.cut(loose)[1])
        where = front.loosest(TOP)
        low = self._power(target) >= front.bounds[where]
        chosen = front.nodes[self._apart(where[~low])]
        self._close(front.take(where[low])[1])
        return self._counted(self._designer.look(chosen, ROUNDS)) if len(chosen) else []

    def _apart(self, where: IntArray) -> IntArray:
        """Return a few of some nodes, loosest first, none like those before it."""
        front, chosen = self.front, list[int]()
        if front is None:
            return where[:0]
        for i in where.tolist():
            if len(chosen) == LOOKED:
                break
            if all(np.sum(front.nodes[i] != front.nodes[j]) >= APART for j in chosen):
                chosen.append(i)
        return np.array(chosen, dtype=np.int64)

    def _counted(self, found: list[Node]) -> list[Node]:
        self.looked += len(found)
        return found

    def _close(self, bounds: np.ndarray) -> None:
        """Count nodes as done: their bounds hold for good."""
        self._closed = max(self._closed, self._mu(float(np.max(bounds, initial=0.0))))

    def _mu(self, bound: float) -> float:
        return float(max(bound, 0.0) ** (1.0 / self.scope.measure.power))

    def _power(self, mu: float) -> float:
        return float(mu**self.scope.measure.power)

    def _exclude(self) -> np.ndarray:
        """Return which clusters constraints leave nothing of, (groups, clusters)."""
        clusters = self.pool.clusters
        result = np.zeros((len(self.scope.pieces), clusters.count), dtype=bool)
        for own, pieces in zip(result, self.scope.pieces, strict=True):
            if pieces.allowed.limited:
                own[1:] = [pieces.allowed.excludes(MeshCell(clusters, node)) for node in range(1, clusters.count)]
        return result
