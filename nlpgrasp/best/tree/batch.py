"""The bounds of a batch of nodes at once."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.best.bound.mixtures import mixtures
from nlpgrasp.best.bound.supports import NONE
from nlpgrasp.best.bound.twists import Twists
from nlpgrasp.best.bound.weakest import Design, descended
from nlpgrasp.best.cells.base import IntArray
from nlpgrasp.best.scope.scope import Scope
from nlpgrasp.best.tree.nodes import NOWHERE, Bounded, Cells
from nlpgrasp.best.tree.table import MARGIN, Table
from nlpgrasp.common.validation import FloatArray

FIRST_ROUNDS = 24  # of a tree that begins with one node
FRESH = 4  # directions that a second round replaces: one of so many
STARTS = 3  # of the node's own directions that descents begin from, beside the weakest of those tried
ALIKE = 0.999  # cosine of directions that are the same
POOL = 24  # rows of a cell that a round leaves to the next

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
    pool : (b, k, POOL) array, optional
        Rows of cells whose rows can be replaced that mixtures shall see, ``NONE`` for fewer.
    """

    def __init__(
        self, scope: Scope, cells: Sequence[Cells], numbers: IntArray, twists: Twists, pool: IntArray | None = None
    ) -> None:
        self.scope, self.twists = scope, twists
        self.cells, self.numbers = np.array(cells, dtype=np.int64), numbers
        self.pool = np.full((*self.cells.shape, POOL), NONE) if pool is None else pool

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
            table.choose(weights, self.pool[open_])
            weights, design = mixtures(table.chosen)
            bounds, weights = table.sharpened(weights)
            self.pool[open_] = table.pool(weights, POOL)
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
                self._renew(open_, table.rows[~closed], weights, design)

    def recomputed(self, weights: FloatArray) -> FloatArray:
        """Return the bounds (b,) that mixtures (b, j) give, with the budget's own sum for one direction alone."""
        table, measure = self._table(np.arange(len(self.cells))), self.scope.measure
        bounds = table.bounds(weights)
        if measure.exact:
            return bounds
        alone = np.max(table.maxima(None) * (weights == 1.0)[:, None], axis=2) ** (1.0 / measure.power)
        single = measure.combined(alone, 1) * (1.0 + MARGIN)
        return np.where(np.max(weights, axis=1) == 1.0, single, bounds)

    def _renew(self, nodes: IntArray, chosen: IntArray, weights: FloatArray, design: FloatArray) -> None:
        """Replace the least useful directions of some nodes by the weakest of their designs."""
        designs = []
        for pieces, where in self.scope.groups:
            rows, shares = chosen[:, where], design[:, where]
            b, c, m = rows.shape
            flat = rows.reshape(b, c * m), shares.reshape(b, c * m)
            designs.append(Design.over(pieces.supports, *flat, 3 * c))
        numbers = self.numbers[nodes]
        few = numbers.shape[1] // FRESH
        own = np.take_along_axis(numbers, np.argsort(-weights, axis=1)[:, :STARTS], axis=1)
        tried = self.twists.tried()
        every = np.broadcast_to(tried, (len(weights), *tried.shape))
        value = sum(d.value(every) for d in designs)
        weakest = tried[np.argsort(value, axis=1)[:, :few]]
        found, ratios = descended(designs, self.scope.task, np.concatenate([self.twists[own], weakest], axis=1))
        order = np.argsort(np.where(_repeated(found, ratios), np.inf, ratios), axis=1)[:, :few]
        fresh = np.take_along_axis(found, order[..., None], axis=1)
        added = self.twists.add(fresh.reshape(-1, fresh.shape[2])).reshape(fresh.shape[:2])
        self.twists.remember(fresh[:, 0])
        least = np.argsort(weights, axis=1)[:, :few]
        np.put_along_axis(numbers, least, added, axis=1)
        self.numbers[nodes] = numbers

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


def _repeated(twists: FloatArray, ratios: FloatArray) -> NDArray[np.bool_]:
    """Return which directions (b, m, d) are nearly those of others with smaller ratios (b, m)."""
    unit = twists / np.maximum(np.max(np.abs(twists), axis=1, keepdims=True), 1e-300)
    unit /= np.linalg.norm(unit, axis=2, keepdims=True)
    near = unit @ unit.transpose(0, 2, 1) > ALIKE
    first = np.argsort(np.argsort(ratios, axis=1), axis=1)
    return np.asarray(np.any(near & (first[:, None] < first[:, :, None]), axis=2))
