"""The largest mixed support over a cell, with finer rows wherever those to begin with leave it open."""

from __future__ import annotations

import numpy as np

from nlpgrasp.best.bound.supports import NONE, Supports
from nlpgrasp.best.cells.base import IntArray
from nlpgrasp.common.validation import FloatArray

ROUNDS = 20
MOST = 100  # rows of a cell that a round replaces
BEAM = 6
ENOUGH = 0.01  # relative: rows that bound hardly more than the largest that cannot be replaced stay as they are


def refined(
    supports: Supports, rows: IntArray, mixed: FloatArray, twists: FloatArray, weights: FloatArray
) -> tuple[FloatArray, IntArray]:
    """Return what no contact of some cells exceeds under mixtures, and the contacts that do most.

    In each round the rows that could be the largest, above all that cannot be replaced, are replaced by finer ones.

    Parameters
    ----------
    supports : Supports
    rows : (b, m) array
        Of each cell.
    mixed : (b, m) array
        What each row bounds under the cell's mixture.
    twists : (b, j, d) array
    weights : (b, j) array

    Returns
    -------
    bounds : (b,) array
    chosen : (b,) array
        Numbers of rows that cannot be replaced; ``NONE`` where none was met.
    """
    twists, weights = used(twists, weights)
    best, open_ = _Largest(len(rows)), np.zeros(len(rows))
    owner, row, value = np.repeat(np.arange(len(rows)), rows.shape[1]), np.ravel(rows), np.ravel(mixed)
    for _ in range(ROUNDS):
        ends = supports.finer[row, 0] == NONE
        best.take(owner[ends], row[ends], value[ends])
        above = ~ends & (value > (1.0 + ENOUGH) * best.value[owner])
        left = ~ends & ~above
        np.maximum.at(open_, owner[left], value[left])
        owner, row, value = owner[above], row[above], value[above]
        if not len(owner):
            break
        rest = np.ones(len(owner), dtype=bool)
        first = _largest(owner, value, MOST)
        rest[first] = False
        fresh = _finer(supports, owner[first], row[first], twists, weights)
        old = owner[rest], row[rest], value[rest]
        owner, row, value = (np.concatenate([a, b]) for a, b in zip(old, fresh, strict=True))
    np.maximum.at(open_, owner, value)
    return np.maximum(best.value, open_), best.row


class _Largest:
    """The largest value of each owner so far, and its row."""

    def __init__(self, count: int) -> None:
        self.value, self.row = np.zeros(count), np.full(count, NONE)

    def take(self, owner: IntArray, row: IntArray, value: FloatArray) -> None:
        """Compare some more rows."""
        first = _largest(owner, value, 1)
        better = first[value[first] > self.value[owner[first]]]
        self.value[owner[better]], self.row[owner[better]] = value[better], row[better]


def used(twists: FloatArray, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return as many directions, (b, j, d), and weights, (b, j), as any mixture uses."""
    most = int(np.max(np.count_nonzero(weights, axis=1)))
    if most == weights.shape[1]:
        return twists, weights
    used = np.argpartition(-weights, most, axis=1)[:, :most]
    return np.take_along_axis(twists, used[..., None], axis=1), np.take_along_axis(weights, used, axis=1)


def heaviest(
    supports: Supports, rows: IntArray, mixed: FloatArray, twists: FloatArray, weights: FloatArray
) -> IntArray:
    """Return a contact of each cell, (b,), that does about as much under its mixture as any; entries as of ``refined``.

    From level to level, the finer rows of a few that seem best.
    """
    owner, row, value = np.repeat(np.arange(len(rows)), rows.shape[1]), np.ravel(rows), np.ravel(mixed)
    while True:
        first = _largest(owner, value, BEAM)
        owner, row, value = owner[first], row[first], value[first]
        ends = supports.finer[row, 0] == NONE
        if np.all(ends):
            return row[_largest(owner, value, 1)]
        fresh = _finer(supports, owner[~ends], row[~ends], twists, weights)
        old = owner[ends], row[ends], value[ends]
        owner, row, value = (np.concatenate([a, b]) for a, b in zip(old, fresh, strict=True))


def _finer(
    supports: Supports, owner: IntArray, row: IntArray, twists: FloatArray, weights: FloatArray
) -> tuple[IntArray, IntArray, FloatArray]:
    """Return the finer rows of some, each once, with their owners and what they bound under the owners' mixtures."""
    finer = supports.finer[row]
    rows = np.ravel(finer)
    kept = np.diff(rows, prepend=NONE) != 0
    kept &= rows != NONE
    owners, rows = np.repeat(owner, finer.shape[1])[kept], rows[kept]
    powers = supports.powers(rows[:, None], twists[owners])[:, 0]
    return owners, rows, np.sum(powers * weights[owners], axis=1)


def _largest(owner: IntArray, value: FloatArray, most: int) -> IntArray:
    """Return where the largest few values of each owner are."""
    order = np.lexsort((-value, owner))
    sorted_ = owner[order]
    begin = np.flatnonzero(np.diff(sorted_, prepend=-1))
    rank = np.arange(len(order)) - np.repeat(begin, np.diff(np.append(begin, len(order))))
    return np.asarray(order[rank < most])
