"""Nodes of the tree."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlpgrasp.best.cells.base import IntArray
from nlpgrasp.common.validation import FloatArray

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
