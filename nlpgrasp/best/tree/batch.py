"""The bounds of a batch of nodes at once."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from nlpgrasp.best.bound.mixtures import mixtures
from nlpgrasp.best.bound.twists import Twists
from nlpgrasp.best.cells.base import IntArray
from nlpgrasp.best.scope.scope import Scope
from nlpgrasp.best.tree.nodes import NOWHERE, Bounded, Cells
from nlpgrasp.best.tree.renewed import renewed
from nlpgrasp.best.tree.table import MARGIN, Table
from nlpgrasp.common.validation import FloatArray

FIRST_ROUNDS = 24  # of a tree that begins with one node

Best = tuple[FloatArray, FloatArray, IntArray]  # bounds, weights and numbers of directions


class Batch:
    """Nodes that are bounded together.

    Parameters
    ----------
    scope : Scope
    cells : sequence of b tuples of int
    numbers : (b, j) array
        Of the directions that each begins with.
    twists : Twists
    """

    def __init__(self, scope: Scope, cells: Sequence[Cells], numbers: IntArray, twists: Twists) -> None:
        self.scope, self.twists = scope, twists
        self.cells, self.numbers = np.array(cells, dtype=np.int64), numbers

    def bounded(self, weights: FloatArray | None, target: float) -> Iterator[Bounded]:
        """Yield every node with its bound: those that the parents' mixtures close first, then round by round."""
        open_ = np.arange(len(self.cells))
        if weights is not None:
            table = self._table(open_)
            bounds = table.bounds(weights)
            yield from self._results(open_[bounds <= target], bounds[bounds <= target], weights[bounds <= target])
            open_, weights = open_[bounds > target], weights[bounds > target]
        rounds = int(np.clip(FIRST_ROUNDS // len(open_), 2, FIRST_ROUNDS)) if weights is None and len(open_) else 2
        best = np.full(len(open_), np.inf), np.zeros((len(open_), 0)), self.numbers[open_]
        for last in [False] * (rounds - 1) + [True]:
            if not len(open_):
                return
            table = self._table(open_)
            table.choose(weights)
            weights, design = mixtures(table.chosen)
            bounds, weights = table.sharpened(weights)
            best = _lower((bounds, weights, self.numbers[open_]), best)
            closed = (best[0] <= target) | last
            shown = self.numbers[open_[~closed]], weights[~closed], design[~closed]
            self.numbers[open_] = best[2]
            yield from self._results(
                open_[closed], best[0][closed], best[1][closed], table.rows[closed], design[closed]
            )
            best = best[0][~closed], best[1][~closed], best[2][~closed]
            open_ = open_[~closed]
            self.numbers[open_], weights, design = shown
            if len(open_):
                self.numbers[open_] = renewed(
                    self.scope, self.twists, self.numbers[open_], weights, (table.rows[~closed], design)
                )

    def recomputed(self, weights: FloatArray) -> FloatArray:
        """Return the bounds (b,) that mixtures (b, j) give, with the budget's own sum for one direction alone."""
        table, measure = self._table(np.arange(len(self.cells))), self.scope.measure
        bounds = table.bounds(weights)
        if measure.exact:
            return bounds
        alone = np.max(table.maxima(None) * (weights == 1.0)[:, None], axis=2) ** (1.0 / measure.power)
        single = measure.combined(alone, 1) * (1.0 + MARGIN)
        return np.where(np.max(weights, axis=1) == 1.0, single, bounds)

    def _table(self, nodes: IntArray) -> Table:
        return Table(self.scope.groups, self.cells[nodes], self.twists[self.numbers[nodes]])

    def _results(
        self,
        nodes: IntArray,
        bounds: FloatArray,
        weights: FloatArray,
        rows: IntArray | None = None,
        design: FloatArray | None = None,
    ) -> Iterator[Bounded]:
        """Yield some of the nodes with their bounds."""
        for i, number in enumerate(nodes.tolist()):
            spread = NOWHERE if rows is None or design is None else (rows[i], design[i])
            cells = tuple(self.cells[number].tolist())
            yield Bounded(float(bounds[i]), cells, self.numbers[number].copy(), weights[i], *spread)


def _lower(new: Best, old: Best) -> Best:
    """Return the lower of two bounds of each node, with the mixtures that give it."""
    if not old[1].shape[1]:
        return new
    better = new[0] < old[0]
    weights, numbers = (np.where(better[:, None], new[i], old[i]) for i in (1, 2))
    return np.minimum(new[0], old[0]), weights, numbers
