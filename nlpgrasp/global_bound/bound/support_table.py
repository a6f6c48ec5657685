"""Support tables over the cells of many nodes, and the bounds that dual weights give."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.global_bound.bound.curved_supports import mixed_supports, single_supports
from nlpgrasp.global_bound.cells.base import IntArray
from nlpgrasp.global_bound.scope.pieces import Pieces

FEW = 8  # rows per cell up to which linear programs use all
MARGIN = 1e-9  # relative, for rounding in a bound


@dataclass(frozen=True)
class GroupTable:
    """Support table of identical contacts over the cells of nodes, without duplicate pairs of node and cell.

    Parameters
    ----------
    pieces : Pieces
    cells : (c,) array
        Of each pair.
    rows : (c, m) array
        Of each pair's cell.
    twists : (c, j, d) array
    powers : (c, m, j) array
    owner : (c,) array
        The node of each pair.
    back : (b, s) array
        The pair of each node and slot.
    """

    pieces: Pieces
    cells: IntArray
    rows: IntArray
    twists: FloatArray
    powers: FloatArray
    owner: IntArray
    back: IntArray

    @classmethod
    def of(cls, pieces: Pieces, cells: IntArray, twists: FloatArray) -> GroupTable:
        """Return the powers over cells (b, s) along each node's twists (b, j, d)."""
        pairs = np.arange(len(cells))[:, None] * len(pieces.cells) + cells
        once, back = np.unique(pairs, return_inverse=True)
        owner, own = np.divmod(once, len(pieces.cells))
        rows = pieces.supports.rows_of(own)
        powers = pieces.supports.powers(rows, twists[owner])
        return cls(pieces, own, rows, twists[owner], powers, owner, back.reshape(cells.shape))

    def mixed(self, weights: FloatArray) -> FloatArray:
        """Return powers under each node's mixture (b, j), by pair and row."""
        return np.asarray((self.powers @ weights[self.owner][:, :, None])[:, :, 0])

    def largest(self, weights: FloatArray | None, most: int) -> tuple[IntArray, FloatArray]:
        """Return the rows that mixtures see, sorted, and their powers: (c, m) and (c, m, j)."""
        c, m, _ = self.powers.shape
        if most <= FEW:
            where = np.broadcast_to(np.minimum(np.arange(most), m - 1), (c, most))
        else:
            mixed = np.mean(self.powers, axis=2) if weights is None else self.mixed(weights)
            along = np.argmax(self.powers, axis=1)
            where = np.sort(np.concatenate([along, np.argmax(mixed, axis=1)[:, None]], axis=1), axis=1)
        rows = np.take_along_axis(self.rows, where, axis=1)
        return rows, np.take_along_axis(self.powers, where[..., None], axis=1)

    def maxima(self, weights: FloatArray) -> FloatArray:
        """Return upper bounds under each node's dual weights, (b, s)."""
        supports = self.pieces.supports
        if supports.bent:
            found = mixed_supports(supports, self.cells, self.powers, self.twists, weights[self.owner])
            return np.asarray(found[self.back])
        return np.asarray(np.max(self.mixed(weights), axis=1)[self.back])

    def along(self) -> FloatArray:
        """Return upper bounds along each direction alone, (b, s, j)."""
        return single_supports(self.pieces.supports, self.cells, self.powers, self.twists)[self.back]


def _padded(parts: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Return arrays (b, s, m, ...) with as many rows each, zeros in place of rows."""
    most = max(part.shape[2] for part in parts)
    return [np.pad(part, [(0, 0), (0, 0), (0, most - part.shape[2])] + [(0, 0)] * (part.ndim - 3)) for part in parts]


class SupportTable:
    """Support table of several nodes: powers by slot, row of its cell, and direction.

    Parameters
    ----------
    groups : sequence of (Pieces, slice)
        And the slots of each.
    cells : (b, k) array
        Of each node.
    twists : (b, j, d) array
    """

    def __init__(self, groups: Sequence[tuple[Pieces, slice]], cells: IntArray, twists: FloatArray) -> None:
        self._measure = groups[0][0].supports.measure
        self._parts = [GroupTable.of(pieces, cells[:, where], twists) for pieces, where in groups]
        self.rows = np.zeros((0, 0, 0), dtype=np.int64)
        self.chosen = np.zeros((0, 0, 0, 0))

    def maxima(self, weights: FloatArray | None) -> FloatArray:
        """Return the largest mixed power over the rows of each slot, (b, k); of each direction, (b, k, j), for None."""
        if weights is None:
            return np.concatenate([part.along() for part in self._parts], axis=1)
        return np.concatenate([part.maxima(weights) for part in self._parts], axis=1)

    def bounds(self, weights: FloatArray) -> FloatArray:
        """Return the nodes' bounds by dual weights, (b,), with a margin for rounding."""
        power = self._measure.power
        return np.asarray(np.sum(self.maxima(weights), axis=1) ** (1.0 / power) * (1.0 + MARGIN))

    def sharpened(self, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return bounds and mixtures; one direction alone where the budget's own sum along it is better."""
        bounds, measure = self.bounds(weights), self._measure
        if measure.exact:
            return bounds, weights
        single = measure.combined(self.maxima(None) ** (1.0 / measure.power), 1) * (1.0 + MARGIN)
        best = np.argmin(single, axis=1)
        least = single[np.arange(len(best)), best]
        alone = np.eye(weights.shape[1])[best]
        return np.minimum(bounds, least), np.where((least < bounds)[:, None], alone, weights)

    def choose(self, weights: FloatArray | None) -> None:
        """Choose the rows that mixtures see: all of few, else the largest along each direction and under a mixture."""
        most = max(part.powers.shape[1] for part in self._parts)
        rows, tables = [], []
        for part in self._parts:
            once, its = part.largest(weights, most)
            chosen, powers = once[part.back], its[part.back]
            again = np.diff(chosen, axis=2, prepend=-1) == 0  # one row counts once: no designs spread over copies
            rows.append(chosen)
            tables.append(np.where(again[..., None], 0.0, powers))
        self.rows, self.chosen = (np.concatenate(_padded(parts), axis=1) for parts in (rows, tables))
