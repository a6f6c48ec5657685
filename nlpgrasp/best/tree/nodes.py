"""Nodes of the tree, and the bounds of a batch of them at once."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from nlpgrasp.best.bound.mixtures import mixtures
from nlpgrasp.best.bound.supports import IntArray
from nlpgrasp.best.bound.twists import Twists
from nlpgrasp.best.bound.weakest import Design, descended
from nlpgrasp.best.scope.pieces import Pieces
from nlpgrasp.best.scope.scope import Scope
from nlpgrasp.common.validation import FloatArray

FEW = 8  # rows of a cell that a mixture sees all of
FRESH = 4  # directions that a second round replaces
STARTS = 3  # of the node's own directions that descents begin from, beside the weakest of those tried
MARGIN = 1e-9  # relative: what rounding may take from a bound

Cells = tuple[int, ...]
NOWHERE = (np.zeros((0, 0), dtype=np.int64), np.zeros((0, 0)))  # the design of a node that needs none


@dataclass(frozen=True, order=True)
class Node:
    """One cell for each contact, with the mixture of directions that bounds mu over them.

    Parameters
    ----------
    key : tuple of float and int
        Less the bound, and a number: the order of the heap.
    cells : tuple of int
        By slot.
    twists : (j,) array
        Numbers of directions.
    weights : (j,) array
        The mixture.
    rows, design : (k, m) arrays
        Numbers of rows, and how much of each contact is there.
    """

    key: tuple[float, int]
    cells: Cells
    twists: IntArray
    weights: FloatArray
    rows: IntArray
    design: FloatArray

    @property
    def bound(self) -> float:
        """The most that mu is over the node's cells."""
        return -self.key[0]


@dataclass(frozen=True)
class Bounded:
    """A node's bound before it has a number; entries as of ``Node``."""

    bound: float
    cells: Cells
    twists: IntArray
    weights: FloatArray
    rows: IntArray
    design: FloatArray

    def node(self, number: int) -> Node:
        """Return the node."""
        return Node((-self.bound, number), self.cells, self.twists, self.weights, self.rows, self.design)


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
        self.groups: list[tuple[Pieces, slice]] = []
        start = 0
        for pieces in scope.pieces:
            self.groups.append((pieces, slice(start, start + len(pieces.slots))))
            start += len(pieces.slots)

    def bounded(self, weights: FloatArray | None, target: float) -> Iterator[Bounded]:
        """Yield every node with its bound: those that the parents' mixtures close first, then round by round."""
        open_ = np.arange(len(self.cells))
        if weights is not None:
            table = _Table(self, open_)
            bounds = table.bounds(weights)
            yield from table.results(bounds <= target, bounds, weights, None)
            open_, weights = open_[bounds > target], weights[bounds > target]
        for last in (False, True):
            if not len(open_):
                return
            table = _Table(self, open_)
            table.choose(weights)
            weights, design = mixtures(table.chosen)
            bounds, weights = table.sharpened(weights)
            closed = (bounds <= target) | last
            yield from table.results(closed, bounds, weights, design)
            open_, weights, design = open_[~closed], weights[~closed], design[~closed]
            if len(open_):
                self._renew(table, ~closed, weights, design)

    def recomputed(self, weights: FloatArray) -> FloatArray:
        """Return the bounds (b,) that mixtures (b, j) give, with the budget's own sum for one direction alone."""
        table, measure = _Table(self, np.arange(len(self.cells))), self.scope.measure
        bounds = table.bounds(weights)
        if measure.exact:
            return bounds
        alone = np.max(table.maxima(None) * (weights == 1.0)[:, None], axis=2) ** (1.0 / measure.power)
        single = measure.combined(alone, 1) * (1.0 + MARGIN)
        return np.where(np.max(weights, axis=1) == 1.0, single, bounds)

    def _renew(self, table: _Table, kept: np.ndarray, weights: FloatArray, design: FloatArray) -> None:
        """Replace the least useful directions of some nodes by the weakest of their designs."""
        designs = []
        for pieces, where in self.groups:
            rows, shares = table.rows[kept, where], design[:, where]
            b, c, m = rows.shape
            flat = rows.reshape(b, c * m), shares.reshape(b, c * m)
            designs.append(Design.over(pieces.supports, *flat, 3 * c))
        numbers = self.numbers[table.nodes[kept]]
        own = np.take_along_axis(numbers, np.argsort(-weights, axis=1)[:, :STARTS], axis=1)
        tried = self.twists.tried()
        every = np.broadcast_to(tried, (len(weights), *tried.shape))
        value = sum(d.value(every) for d in designs)
        weakest = tried[np.argsort(value, axis=1)[:, :FRESH]]
        found, ratios = descended(designs, self.scope.task, np.concatenate([self.twists[own], weakest], axis=1))
        order = np.argsort(ratios, axis=1)[:, :FRESH]
        fresh = np.take_along_axis(found, order[..., None], axis=1)
        added = self.twists.add(fresh.reshape(-1, fresh.shape[2])).reshape(fresh.shape[:2])
        self.twists.remember(fresh[:, 0])
        least = np.argsort(weights, axis=1)[:, :FRESH]
        np.put_along_axis(numbers, least, added, axis=1)
        self.numbers[table.nodes[kept]] = numbers


class _Table:
    """Powers of supports for some nodes of a batch: by slot, row of its cell, and direction."""

    def __init__(self, batch: Batch, nodes: IntArray) -> None:
        self.batch, self.nodes = batch, nodes
        cells, twists = batch.cells[nodes], batch.twists[batch.numbers[nodes]]
        self._parts: list[tuple[IntArray, FloatArray, IntArray, slice]] = []
        for pieces, where in batch.groups:
            own = cells[:, where]
            pairs = np.arange(len(nodes))[:, None] * len(pieces.cells) + own
            once, back = np.unique(pairs, return_inverse=True)
            rows = pieces.supports.rows_of(once % len(pieces.cells))
            powers = pieces.supports.powers(rows, twists[once // len(pieces.cells)])
            self._parts.append((rows, powers, back.reshape(own.shape), where))
        self.rows = np.zeros((0, 0, 0), dtype=np.int64)
        self.chosen = np.zeros((0, 0, 0, 0))

    def maxima(self, weights: FloatArray | None) -> FloatArray:
        """Return the largest mixed power over the rows of each slot, (b, k); of each direction, (b, k, j), for None."""
        parts = []
        for _, powers, back, _ in self._parts:
            if weights is None:
                parts.append(np.max(powers, axis=1)[back])
                continue
            owner = np.zeros(len(powers), dtype=np.int64)
            owner[back.ravel()] = np.repeat(np.arange(len(back)), back.shape[1])
            mixed = (powers @ weights[owner][:, :, None])[:, :, 0]
            parts.append(np.max(mixed, axis=1)[back])
        return np.concatenate(parts, axis=1)

    def bounds(self, weights: FloatArray) -> FloatArray:
        """Return the bounds that mixtures give, (b,), with a margin for rounding."""
        power = self.batch.scope.measure.power
        return np.asarray(np.sum(self.maxima(weights), axis=1) ** (1.0 / power) * (1.0 + MARGIN))

    def sharpened(self, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return bounds and mixtures; one direction alone where the budget's own sum along it is better."""
        bounds, measure = self.bounds(weights), self.batch.scope.measure
        if measure.exact:
            return bounds, weights
        single = measure.combined(self.maxima(None) ** (1.0 / measure.power), 1) * (1.0 + MARGIN)
        best = np.argmin(single, axis=1)
        least = single[np.arange(len(best)), best]
        alone = np.eye(weights.shape[1])[best]
        return np.minimum(bounds, least), np.where((least < bounds)[:, None], alone, weights)

    def choose(self, weights: FloatArray | None) -> None:
        """Choose the rows that mixtures see: all of few, else the largest along each direction and under a mixture."""
        j = self._parts[0][1].shape[2]
        most = max(powers.shape[1] for _, powers, _, _ in self._parts)
        count = most if most <= FEW else j + 1
        rows, tables = [], []
        for own, powers, back, _ in self._parts:
            if most <= FEW:
                where = np.broadcast_to(np.minimum(np.arange(count), powers.shape[1] - 1), (len(powers), count))
            else:
                owner = np.zeros(len(powers), dtype=np.int64)
                owner[back.ravel()] = np.repeat(np.arange(len(back)), back.shape[1])
                mixed = np.mean(powers, axis=2) if weights is None else (powers @ weights[owner][:, :, None])[:, :, 0]
                where = np.concatenate([np.argmax(powers, axis=1), np.argmax(mixed, axis=1)[:, None]], axis=1)
                where = np.sort(where, axis=1)
            again = np.diff(where, axis=1, prepend=-1) == 0  # a row counts once, or designs would be spread over copies
            rows.append(np.take_along_axis(own, where, axis=1)[back])
            table = np.where(again[..., None], 0.0, np.take_along_axis(powers, where[..., None], axis=1))
            tables.append(table[back])
        self.rows, self.chosen = np.concatenate(rows, axis=1), np.concatenate(tables, axis=1)

    def results(
        self, where: np.ndarray, bounds: FloatArray, weights: FloatArray, design: FloatArray | None
    ) -> Iterator[Bounded]:
        """Yield some of the nodes with their bounds."""
        for i in np.flatnonzero(where).tolist():
            number = int(self.nodes[i])
            spread = NOWHERE if design is None else (self.rows[i], design[i])
            cells = tuple(self.batch.cells[number].tolist())
            yield Bounded(float(bounds[i]), cells, self.batch.numbers[number].copy(), weights[i], *spread)
