"""Directions of wrench space that bounds are mixed from, by number."""

from __future__ import annotations

import numpy as np

from nlpgrasp.best.bound.weakest import normalised
from nlpgrasp.best.cells.base import IntArray
from nlpgrasp.common.directions import directions
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.tasks import Task

RANDOM, RECENT = 200, 60  # directions at random beside the lattice, and latest ones
TRIED = 300  # along which a design is tried
FLAT = 1e-9
DIGITS, ABOVE, UNIT = 11, 5e-10, 9e-10  # of directions; how far a unit of work is exceeded, about and at most


class Twists:
    """A growing list of directions y with unit work of the task, ``phi_A(y) = 1``.

    Parameters
    ----------
    task : Task
    size : float
        Of the body, metres: what turns torques into forces where the task does not say.
    per_node : int
        Directions of a node.
    """

    def __init__(self, task: Task, size: float, per_node: int = 16) -> None:
        self.task, self.per_node = task, per_node
        self._rng = np.random.default_rng(0)
        d = task.dimension
        lattice = np.concatenate([directions(d, 2), self._rng.standard_normal((RANDOM, d))])
        space = 2 if d == 3 else 3
        own = np.diag([1.0] * space + [size**2] * (d - space))
        moment = task.second_moment()
        filled = moment + FLAT * own * np.trace(moment) + 0.05 * np.mean(np.diag(moment) / np.diag(own)) * own
        found = normalised(task, lattice @ np.linalg.inv(np.linalg.cholesky(filled)))
        self.lattice = found[np.any(found != 0.0, axis=1)]
        self._all = np.zeros((1024, d))
        self._count = 0
        self.add(self.lattice)
        self._recent = self.lattice[:0]

    def add(self, twists: FloatArray) -> IntArray:
        """Add directions (m, d), with few digits, and return their numbers, (m,).

        In place of a zero row, along which the task does no work and every bound would be zero, stands one of the
        lattice.
        """
        twists = _short(self.task, np.where(np.any(twists != 0.0, axis=1, keepdims=True), twists, self.lattice[:1]))
        numbers = np.arange(self._count, self._count + len(twists))
        while self._count + len(twists) > len(self._all):
            self._all = np.concatenate([self._all, np.zeros_like(self._all)])
        self._all[numbers] = twists
        self._count += len(twists)
        return numbers

    def __getitem__(self, numbers: IntArray) -> FloatArray:
        return self._all[numbers]

    def first(self) -> IntArray:
        """Return the directions that a search begins with, (per_node,)."""
        chosen = self._rng.permutation(len(self.lattice))[: self.per_node]
        return np.resize(chosen, self.per_node)

    def tried(self) -> FloatArray:
        """Return some directions along which designs may be weak: well-spread, random and recent ones."""
        chosen = self._rng.permutation(len(self.lattice))[: TRIED - len(self._recent)]
        return np.concatenate([self.lattice[chosen], self._recent])

    def remember(self, twists: FloatArray) -> None:
        """Keep some of the directions (m, d) that were found weak."""
        some = twists[self._rng.permutation(len(twists))[: RECENT // 4]]
        self._recent = np.concatenate([some, self._recent])[:RECENT]


def _short(task: Task, twists: FloatArray) -> FloatArray:
    """Return directions (m, d) with few digits along which the task does hardly more than unit work, and no less.

    Bounds that take the work for 1 are then no lower than they should be. One that would have to be off by more stays.
    """
    largest = np.max(np.abs(twists), axis=1, keepdims=True)
    scale = 10.0 ** (DIGITS - 1 - np.floor(np.log10(largest)))
    short = np.round(twists * (1.0 + ABOVE) * scale) / scale
    work = task.support(short)[0]
    return np.where(((work >= 1.0) & (work <= 1.0 + UNIT))[:, None], short, twists)
