"""What it takes to check a bound: how cells and nodes were cut, and the mixture of every leaf."""

from __future__ import annotations

from nlpgrasp.best.tree.nodes import Cells, Node


class Proof:
    """The record of a search.

    Attributes
    ----------
    roots : list of tuple of int
        The cells of the nodes that everything began with.
    splits : dict
        The slot whose cell was cut, of each node that was.
    twins : dict
        The symmetry that maps a node onto one that was looked at in its place.
    leaves : dict
        The nodes that bounds are claimed of.
    """

    def __init__(self) -> None:
        self.roots: list[Cells] = []
        self.splits: dict[Cells, int] = {}
        self.twins: dict[Cells, int] = {}
        self.leaves: dict[Cells, Node] = {}

    def split(self, cells: Cells, slot: int) -> None:
        """Record that a node's cell in a slot was cut."""
        self.splits[cells] = slot

    def twin(self, cells: Cells, symmetry: int) -> None:
        """Record that a symmetry maps a node onto another."""
        self.twins[cells] = symmetry

    def to_dict(self) -> dict[str, object]:
        """Return nothing yet."""
        return {}

    def leaf(self, node: Node) -> None:
        """Record a node that needs no further look."""
        self.leaves[node.cells] = node
