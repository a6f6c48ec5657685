"""Bounding strategy for bodies other than meshes: dual weights for each node, by small linear programs."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain
from typing import NamedTuple

import numpy as np

from nlpgrasp.common.validation import BoolArray, FloatArray, IntArray
from nlpgrasp.global_bound.contact_cells import NONE
from nlpgrasp.global_bound.dual_weights import DualWeights, optimal_dual_weights, round_weights
from nlpgrasp.global_bound.node_tree import BoundingStrategy, Cells, FractionalPlacement, NodeArrays
from nlpgrasp.global_bound.scope import BoundScope
from nlpgrasp.global_bound.support_table import SupportTable

BATCH = 64  # largest number of nodes bounded together
DIRECTIONS, SHARED_DIRECTIONS = 16, 32  # directions per node, in general and under the shared budget
FEWEST, PART = 8, 4  # nodes split at a time, at least, and all nodes so far over those split at a time
WORK = 500_000  # rows times directions of a batch, at most
BATCHES = 4  # work of the nodes split at a time, at most, in units of WORK
MOST_OPEN = 100_000  # largest number of open nodes
MOST_LEAVES = 10_000  # largest number of recorded leaves
FIRST_ROUNDS = 24  # rounds of linear programs over all root nodes
SPREAD = 1e-2  # weight of a cell's squared radius relative to the variance of the fractional contact


class DualBounds(NamedTuple):
    """Bounds of nodes (b,), with dual weights and direction indices (b, j) and thresholds (b,) as proof."""

    bounds: FloatArray
    weights: FloatArray
    directions: IntArray
    thresholds: FloatArray

    def select(self, mask: BoolArray) -> DualBounds:
        """Return the bounds of the nodes in a mask."""
        return DualBounds(self.bounds[mask], self.weights[mask], self.directions[mask], self.thresholds[mask])

    def lower_of(self, other: DualBounds) -> DualBounds:
        """Return the lower of two bounds for each node.

        Where the other bound is infinite, the weights are those of this one.
        """
        is_lower = (self.bounds < other.bounds) | np.isinf(other.bounds)
        weights = np.where(is_lower[:, None], self.weights, other.weights)
        directions = np.where(is_lower[:, None], self.directions, other.directions)
        thresholds = np.where(is_lower, self.thresholds, other.thresholds)
        return DualBounds(np.minimum(self.bounds, other.bounds), weights, directions, thresholds)


class NodeWeightStrategy(BoundingStrategy):
    """Bounding strategy for bodies other than meshes, with dual weights optimised for each node's cells.

    A node that is closed by its parent's dual weights keeps these.

    Parameters
    ----------
    scope : BoundScope
    """

    drops_copies, max_open = True, MOST_OPEN

    def __init__(self, scope: BoundScope) -> None:
        super().__init__(scope, SHARED_DIRECTIONS if scope.rule.takes_largest else DIRECTIONS)
        self._placement_of: dict[Cells, FractionalPlacement] = {}

    def bound_nodes(self, cells: IntArray, parents: NodeArrays | None, target: float) -> NodeArrays:
        """Return nodes (n, k) with their bounds, in the order in which batches are completed."""
        self.placements = []
        if parents is None:
            initial = np.tile(self.twists.draw_initial(), (len(cells), 1))
            batches = [
                self._bound_by_rounds(cells[part], initial[part], None, np.zeros(len(cells[part])), target)
                for part in self._batches(cells)
            ]
        else:
            inherited = parents.dual_index
            batches = [self._bound_by_parents(cells[part], inherited[part], target) for part in self._batches(cells)]
        return NodeArrays.concatenate([NodeArrays.none(cells.shape[1]), *chain.from_iterable(batches)])

    def _batches(self, cells: IntArray) -> Iterator[slice]:
        """Yield ranges of nodes small enough to be bounded together."""
        cost, begin = self._cost(cells), 0
        while begin < len(cells):
            end = begin + min(BATCH, 1 + int(np.searchsorted(np.cumsum(cost[begin:]), WORK)))
            yield slice(begin, end)
            begin = end

    def _bound_by_parents(self, cells: IntArray, inherited: IntArray, target: float) -> list[NodeArrays]:
        """Return nodes (b, k) bounded by their parents' dual weights, or by new ones if above the target."""
        directions, weights, thresholds = self._weight_arrays(inherited)
        bounds = self._table(cells, directions, thresholds).bounds(weights)
        is_low = bounds <= target
        closed = NodeArrays(cells[is_low], bounds[is_low], inherited[is_low])
        thresholds = self.scope.rule.thresholds(bounds, 0)
        cells, directions, weights = cells[~is_low], directions[~is_low], weights[~is_low]
        return [closed, *self._bound_by_rounds(cells, directions, weights, thresholds[~is_low], target)]

    def _bound_by_rounds(
        self, cells: IntArray, directions: IntArray, weights: FloatArray | None, thresholds: FloatArray, target: float
    ) -> list[NodeArrays]:
        """Return nodes (b, k) bounded by rounds of linear programs for each node's dual weights.

        Parameters
        ----------
        cells : (b, k) array
        directions : (b, j) array
            Initial directions.
        weights : (b, j) array, optional
            Dual weights of their parents.
        thresholds : (b,) array
        target : float
        """
        rounds = 2 if weights is not None else int(np.clip(FIRST_ROUNDS // max(1, len(cells)), 2, FIRST_ROUNDS))
        finished = list[NodeArrays]()
        best = DualBounds(np.full(len(cells), np.inf), np.zeros(directions.shape), directions, thresholds)
        for round_number in range(1, rounds + 1):
            if not len(cells):
                break
            table = self._table(cells, directions, thresholds)
            table.select_rows(weights)
            weights, fractions = optimal_dual_weights(table.excesses)
            bounds, weights, thresholds = table.tighten(weights)
            best = DualBounds(bounds, weights, directions, thresholds).lower_of(best)
            is_finished = (best.bounds <= target) | (round_number == rounds)
            dual_index = len(self.dual_weights) + np.arange(np.count_nonzero(is_finished))
            finished.append(NodeArrays(cells[is_finished], best.bounds[is_finished], dual_index))
            for i in np.flatnonzero(is_finished).tolist():
                self.dual_weights.append(DualWeights(best.directions[i], best.weights[i], float(best.thresholds[i])))
                if best.bounds[i] > target:
                    self.placements.append(FractionalPlacement(float(best.bounds[i]), table.rows[i], fractions[i]))
                    self._placement_of[tuple(cells[i].tolist())] = self.placements[-1]
            best = best.select(~is_finished)
            cells, directions, weights = cells[~is_finished], directions[~is_finished], weights[~is_finished]
            thresholds = self.scope.rule.thresholds(best.bounds, round_number)
            if len(cells):
                spread = table.rows[~is_finished], fractions[~is_finished]
                directions = self.twists.renew(self.scope.groups, directions, weights, *spread)
        return finished

    def select_nodes(self, nodes: NodeArrays, count: int, target: float) -> IntArray:
        """Return the indices of some open nodes with the largest bounds above the target, the largest first."""
        order = np.argsort(-nodes.bounds, kind="stable")[: min(BATCH, max(FEWEST, count // PART))]
        order = order[nodes.bounds[order] > target]
        cost = np.cumsum(self._cost(nodes.cells[order]))
        return order[: 1 + int(np.searchsorted(cost, BATCHES * WORK))]

    def select_slots(self, nodes: NodeArrays) -> IntArray:
        """Return for each node the position of the contact that is most spread over its cell.

        ``NONE`` where all cells are points.
        """
        return np.array([self._loosest_slot(tuple(cells)) for cells in nodes.cells.tolist()], dtype=np.int64)

    def _loosest_slot(self, cells: Cells) -> int:
        placement, loosest, largest = self._placement_of.pop(cells), NONE, -1.0
        for slot, cell in enumerate(cells):
            group = self.scope.group_of[slot][0]
            if (radius := group.supports.balls[cell][1]) == 0.0:
                continue
            points, weights = group.supports.points[placement.rows[slot]], placement.fractions[slot]
            centre = weights @ points
            spread = float(weights @ np.sum((points - centre) ** 2, axis=1)) + SPREAD * radius**2
            if spread > largest:
                loosest, largest = slot, spread
        return loosest

    def recompute_bounds(self, nodes: NodeArrays) -> FloatArray:
        """Return bounds recomputed from the recorded dual weights."""
        results = [np.zeros(0)]
        for i in range(0, len(nodes), BATCH):
            directions, weights, thresholds = self._weight_arrays(nodes.dual_index[i : i + BATCH])
            weights = np.array([round_weights(weight) for weight in weights])
            weights /= np.sum(weights, axis=1, keepdims=True)
            results.append(self._table(nodes.cells[i : i + BATCH], directions, thresholds).bounds(weights))
        return np.concatenate(results)

    def _table(self, cells: IntArray, directions: IntArray, thresholds: FloatArray) -> SupportTable:
        """Return the support table of nodes (b, k) for their directions (b, j) and thresholds (b,)."""
        return SupportTable(self.scope.groups, cells, self.twists[directions], thresholds)

    def _weight_arrays(self, indices: IntArray) -> tuple[IntArray, FloatArray, FloatArray]:
        """Return recorded sets of dual weights as arrays: direction indices and weights (b, j), thresholds (b,)."""
        directions, weights, thresholds = zip(*(self.dual_weights[i] for i in indices.tolist()), strict=True)
        return np.stack(directions), np.stack(weights), np.array(thresholds)

    def _cost(self, cells: IntArray) -> IntArray:
        """Return the cost of bounding each node: its representative contacts times directions."""
        counts = [[self.scope.group_of[i][0].supports.count(c) for i, c in enumerate(node)] for node in cells.tolist()]
        return np.asarray(self.twists.per_node * np.sum(np.array(counts, dtype=np.int64).reshape(cells.shape), axis=1))
