"""Bounding strategy for bodies other than meshes: dual weights per node, by small linear programs in batches."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain

import numpy as np

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.global_bound.cells.cell import IntArray
from nlpgrasp.global_bound.contact_cells import NONE
from nlpgrasp.global_bound.dual_weights import DualWeights, optimal_dual_weights, round_weights
from nlpgrasp.global_bound.node_tree import BoundingStrategy, Cells, FractionalPlacement, NodeArrays
from nlpgrasp.global_bound.scope import BoundScope
from nlpgrasp.global_bound.support_table import ROUNDING_MARGIN, SupportTable

BATCH = 64  # nodes bounded together, at most
DIRECTIONS = 16  # directions per node
FEWEST, PART = 8, 4  # nodes cut at a time: at least, and of those so far one in so many
WORK = 500_000  # rows times directions of a batch
BATCHES = 4  # of such work: nodes that are cut at a time have no more themselves
MOST_OPEN = 100_000  # open nodes at which a search ends
MOST_LEAVES = 10_000  # recorded leaves, at most
FIRST_ROUNDS = 24  # of linear programs, of a tree that begins with one node
SPREAD = 1e-2  # weight of a cell's squared radius beside the variance of a contact that is spread over it

Best = tuple[FloatArray, FloatArray, IntArray]  # bounds, weights and numbers of directions


class NodeWeightStrategy(BoundingStrategy):
    """Bounding strategy for bodies other than meshes: every node has optimal dual weights for its own cells.

    Mixtures have as many directions each; a node that its parent's mixture closes shares it.

    Parameters
    ----------
    scope : BoundScope
    """

    by_parent, most_open = True, MOST_OPEN

    def __init__(self, scope: BoundScope) -> None:
        super().__init__(scope, DIRECTIONS)
        self._placement_of: dict[Cells, FractionalPlacement] = {}

    def bound_nodes(self, cells: IntArray, parents: NodeArrays | None, target: float) -> NodeArrays:
        """Return nodes (n, k) with their bounds, batch by batch, in the order of completion."""
        self.placements = []
        if parents is None:
            first = np.tile(self.twists.first(), (len(cells), 1))
            batches = [self._bound_by_rounds(cells[part], first[part], None, target) for part in self._batches(cells)]
        else:
            own = parents.mixtures
            batches = [self._bound_by_parents(cells[part], own[part], target) for part in self._batches(cells)]
        return NodeArrays.concatenate([NodeArrays.none(cells.shape[1]), *chain.from_iterable(batches)])

    def _batches(self, cells: IntArray) -> Iterator[slice]:
        """Yield ranges of nodes small enough to be bounded together."""
        work, begin = self._work(cells), 0
        while begin < len(cells):
            end = begin + min(BATCH, 1 + int(np.searchsorted(np.cumsum(work[begin:]), WORK)))
            yield slice(begin, end)
            begin = end

    def _bound_by_parents(self, cells: IntArray, inherited: IntArray, target: float) -> list[NodeArrays]:
        """Return nodes (b, k) with bounds by their parents' dual weights (b,), where these are at most the target."""
        numbers, weights = self._dense(inherited)
        bounds = self._table(cells, numbers).bounds(weights)
        low = bounds <= target
        closed = NodeArrays(cells[low], bounds[low], inherited[low])
        return [closed, *self._bound_by_rounds(cells[~low], numbers[~low], weights[~low], target)]

    def _bound_by_rounds(
        self, cells: IntArray, numbers: IntArray, weights: FloatArray | None, target: float
    ) -> list[NodeArrays]:
        """Return nodes (b, k) with bounds by dual weights of their own, as they converge.

        Parameters
        ----------
        cells : (b, k) array
        numbers : (b, j) array
            Directions to begin with.
        weights : (b, j) array, optional
            Of their parents' mixtures.
        target : float
        """
        rounds = 2 if weights is not None else int(np.clip(FIRST_ROUNDS // max(1, len(cells)), 2, FIRST_ROUNDS))
        settled = list[NodeArrays]()
        best = np.full(len(cells), np.inf), np.zeros(numbers.shape), numbers
        for last in [False] * (rounds - 1) + [True]:
            if not len(cells):
                break
            table = self._table(cells, numbers)
            table.choose(weights)
            weights, shares = optimal_dual_weights(table.chosen)
            bounds, weights = table.tighten(weights)
            best = _lower_of_two((bounds, weights, numbers), best)
            done = (best[0] <= target) | last
            own = len(self.mixtures) + np.arange(np.count_nonzero(done))
            settled.append(NodeArrays(cells[done], best[0][done], own))
            for i in np.flatnonzero(done).tolist():
                self.mixtures.append(DualWeights(best[2][i], best[1][i]))
                if best[0][i] > target:
                    self.placements.append(FractionalPlacement(float(best[0][i]), table.rows[i], shares[i]))
                    self._placement_of[tuple(cells[i].tolist())] = self.placements[-1]
            best = best[0][~done], best[1][~done], best[2][~done]
            cells, numbers, weights = cells[~done], numbers[~done], weights[~done]
            if len(cells):
                spread = table.rows[~done], shares[~done]
                numbers = self.twists.renewed(self.scope.groups, numbers, weights, *spread)
        return settled

    def loosest(self, nodes: NodeArrays, count: int, target: float) -> IntArray:
        """Return the open nodes with the largest bounds above the target, the largest first."""
        order = np.argsort(-nodes.bounds, kind="stable")[: min(BATCH, max(FEWEST, count // PART))]
        order = order[nodes.bounds[order] > target]
        work = np.cumsum(self._work(nodes.cells[order]))
        return order[: 1 + int(np.searchsorted(work, BATCHES * WORK))]

    def slots(self, nodes: NodeArrays) -> IntArray:
        """Return the slot with the largest spread of a contact over its cell; ``NONE`` where all cells are points."""
        return np.array([self._loosest_slot(tuple(cells)) for cells in nodes.cells.tolist()], dtype=np.int64)

    def _loosest_slot(self, cells: Cells) -> int:
        placement, best, most = self._placement_of.pop(cells), NONE, -1.0
        for slot, cell in enumerate(cells):
            pieces = self.scope.group_of[slot][0]
            if pieces.radii[cell] == 0.0:
                continue
            points, weights = pieces.supports.points[placement.rows[slot]], placement.shares[slot]
            middle = weights @ points
            spread = float(weights @ np.sum((points - middle) ** 2, axis=1)) + SPREAD * pieces.radii[cell] ** 2
            if spread > most:
                best, most = slot, spread
        return best

    def recomputed(self, nodes: NodeArrays) -> FloatArray:
        """Return bounds recomputed from recorded weights; of one direction alone by the budget's own sum."""
        found, measure = [np.zeros(0)], self.scope.measure
        for i in range(0, len(nodes), BATCH):
            numbers, weights = self._dense(nodes.mixtures[i : i + BATCH])
            weights = np.array([round_weights(own) for own in weights])
            weights /= np.sum(weights, axis=1, keepdims=True)
            table = self._table(nodes.cells[i : i + BATCH], numbers)
            bounds = table.bounds(weights)
            if not measure.exact:
                alone = np.max(table.maxima(None) * (weights == 1.0)[:, None], axis=2) ** (1.0 / measure.power)
                single = measure.combined(alone, 1) * (1.0 + ROUNDING_MARGIN)
                bounds = np.where(np.max(weights, axis=1) == 1.0, single, bounds)
            found.append(bounds)
        return np.concatenate(found)

    def _table(self, cells: IntArray, numbers: IntArray) -> SupportTable:
        """Return the supports over the cells of nodes (b, k) along each node's directions (b, j), by number."""
        return SupportTable(self.scope.groups, cells, self.twists[numbers])

    def _dense(self, own: IntArray) -> tuple[IntArray, FloatArray]:
        """Return the directions and weights of several dual weights, (b, j) each."""
        chosen = [self.mixtures[i] for i in own.tolist()]
        return np.stack([m.numbers for m in chosen]), np.stack([m.weights for m in chosen])

    def _work(self, cells: IntArray) -> IntArray:
        """Return how many rows times directions each node takes."""
        counts = [[self.scope.group_of[i][0].supports.count(c) for i, c in enumerate(own)] for own in cells.tolist()]
        return np.asarray(self.twists.per_node * np.sum(np.array(counts, dtype=np.int64).reshape(cells.shape), axis=1))


def _lower_of_two(new: Best, old: Best) -> Best:
    """Return the lower of two bounds of each node, with its dual weights."""
    better = (new[0] < old[0]) | np.isinf(old[0])
    weights, numbers = (np.where(better[:, None], new[i], old[i]) for i in (1, 2))
    return np.minimum(new[0], old[0]), weights, numbers
