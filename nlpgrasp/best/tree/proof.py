"""What it takes to check a bound: how nodes were cut, which are images of others, and the mixture of every leaf."""

from __future__ import annotations

from dataclasses import dataclass

from nlpgrasp.best.cells.base import IntArray
from nlpgrasp.best.tree.nodes import Cells, Node
from nlpgrasp.common.validation import FloatArray

MOST_LEAVES = 10_000  # beyond which nodes are cut without record: the proof stays as fine as it was


@dataclass(frozen=True)
class Twin:
    """How a node is mapped onto one that stands for it: forward by one symmetry, then back by another.

    Parameters
    ----------
    forward, back : int
        Numbers of symmetries; ``NONE`` of the identity.
    node : tuple of int
        Cells of the node that was looked at.
    """

    forward: int
    back: int
    node: Cells


class Proof:
    """The record of a search, whole at any time: every node is cut, a twin, or a leaf.

    Attributes
    ----------
    splits : dict
        The slot whose cell was cut, of each node that was.
    twins : dict
        Of each node that was not looked at, the one that was in its place.
    leaves : dict
        Directions, by number, and weights of every other node.
    full : bool
        Whether there are as many leaves as are recorded.
    """

    def __init__(self) -> None:
        self.splits: dict[Cells, int] = {}
        self.twins: dict[Cells, Twin] = {}
        self.leaves: dict[Cells, tuple[IntArray, FloatArray]] = {}
        self.full = False

    def go_on(self) -> None:
        """Say that all nodes so far are recorded, and more are to come."""
        self.full = self.full or len(self.leaves) >= MOST_LEAVES

    def bounded(self, node: Node) -> None:
        """Record a node with its mixture."""
        if not self.full and node.cells not in self.splits:
            self.leaves[node.cells] = node.twists, node.weights

    def split(self, cells: Cells, slot: int) -> None:
        """Record that a node's cell in a slot was cut."""
        if not self.full and self.leaves.pop(cells, None) is not None:
            self.splits[cells] = slot

    def twin(self, cells: Cells, forward: int, node: Cells, back: int) -> None:
        """Record that a node is an image of another: a symmetry maps it to where another maps that one."""
        if not self.full:
            self.twins[cells] = Twin(forward, back, node)
