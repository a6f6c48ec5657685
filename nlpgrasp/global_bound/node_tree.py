"""Tree of a branch and bound over placements: each node has one surface cell per contact.

The nodes with the largest bounds are split, their children are bounded, and children with low enough bounds are closed.
A strategy (``BoundingStrategy``) bounds nodes: by dual weights of each node's own, or by sets of dual weights that all
nodes share.

The contacts of a node are in slots, identical contacts side by side. Cells are referred to by their indices, and rows
are the representative contacts of cells.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, combinations_with_replacement, product
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.common.validation import BoolArray, FloatArray, IntArray
from nlpgrasp.global_bound.contact_cells import NONE, ContactCells
from nlpgrasp.global_bound.dual_weights import DualWeights
from nlpgrasp.global_bound.scope import BoundScope
from nlpgrasp.global_bound.weak_twists import NumberedDirections

Cells = tuple[int, ...]  # a node, as the index of a cell for each slot
Floats = FloatArray | NDArray[np.float32]


@dataclass(frozen=True)
class NodeArrays:
    """Set of nodes of a branch-and-bound tree, as arrays.

    Parameters
    ----------
    cells : (n, k) array
        Index of a cell for each slot.
    bounds : (n,) array
        Upper bounds on mu over these cells, to the power ``BoundingStrategy.power``.
    dual_index : (n,) array
        Index of the set of dual weights from which each bound follows.
    """

    cells: IntArray
    bounds: Floats
    dual_index: IntArray

    def __len__(self) -> int:
        return len(self.cells)

    def __getitem__(self, indices: IntArray | BoolArray) -> NodeArrays:
        return NodeArrays(self.cells[indices], self.bounds[indices], self.dual_index[indices])

    @classmethod
    def none(cls, slots: int) -> NodeArrays:
        """Return an empty set of nodes."""
        return cls(np.zeros((0, slots), dtype=np.int64), np.zeros(0), np.zeros(0, dtype=np.int64))

    @classmethod
    def concatenate(cls, parts: Sequence[NodeArrays]) -> NodeArrays:
        """Return the concatenation of several sets of nodes."""
        return cls(*(np.concatenate([getattr(p, name) for p in parts]) for name in ("cells", "bounds", "dual_index")))


@dataclass(frozen=True)
class FractionalPlacement:
    """Relaxed placement that attains a node's bound: contacts spread over their cells by fractions.

    Parameters
    ----------
    bound : float
        Upper bound on mu.
    rows : (k, m) array
        Indices of the rows.
    fractions : (k, m) array
        Fraction of each contact at each row, of sum one.
    """

    bound: float
    rows: IntArray
    fractions: FloatArray

    def heaviest_rows(self) -> IntArray:
        """Return for each contact the representative contact with the largest fraction, (k,)."""
        return np.asarray(self.rows[np.arange(len(self.rows)), np.argmax(self.fractions, axis=1)])


@dataclass(frozen=True)
class SymmetricCopy:
    """Symmetry that maps a node to an earlier one, so that the node need not be bounded.

    Parameters
    ----------
    forward, back : int
        Indices of the symmetries to the common representative; ``NONE`` is the identity.
    node : tuple of int
        Cells of the node bounded before.
    """

    forward: int
    back: int
    node: Cells


class BoundingStrategy(ABC):
    """Interface of strategies that bound nodes, and select the nodes and contacts to branch on.

    Parameters
    ----------
    scope : BoundScope
    directions : int
        Number of directions of a linear program.

    Attributes
    ----------
    power : float
        Bounds of nodes are on mu to this power.
    drops_copies : bool
        Whether symmetric copies of nodes are dropped.
    max_open : int
        Largest number of open nodes.
    twists : NumberedDirections
    dual_weights : list of DualWeights
        Sets of dual weights used so far.
    placements : list of FractionalPlacement
        Fractional placements dual to the bounds of the latest nodes.
    """

    power: float = 1.0
    drops_copies: ClassVar[bool]
    max_open: ClassVar[int]

    def __init__(self, scope: BoundScope, directions: int) -> None:
        self.scope, self.twists = scope, NumberedDirections(scope.problem.task, scope.problem.body.size, directions)
        self.dual_weights, self.placements = list[DualWeights](), list[FractionalPlacement]()

    @abstractmethod
    def bound_nodes(self, cells: IntArray, parents: NodeArrays | None, target: float) -> NodeArrays:
        """Return nodes (n, k) with their bounds, in any order, given their parents' bounds.

        Bounds need not be lowered below the target, on mu.
        """

    @abstractmethod
    def select_nodes(self, nodes: NodeArrays, count: int, target: float) -> IntArray:
        """Return the indices of the open nodes to branch on next, in order.

        ``count`` is the number of all nodes so far.
        """

    @abstractmethod
    def select_slots(self, nodes: NodeArrays) -> IntArray:
        """Return for each node the position of the contact whose cell is to be split, or ``NONE``.

        ``NONE`` stands for a node in which no cell can be split.
        """

    @abstractmethod
    def recompute_bounds(self, nodes: NodeArrays) -> FloatArray:
        """Return bounds on mu recomputed from the recorded dual weights by plain arithmetic, (n,)."""

    def improve(self, nodes: NodeArrays, target: float) -> IntArray:
        """Lower the bounds of some nodes in place, and return the indices of nodes that can be closed.

        These have a bound on mu of at most ``target``. By default no bound is lowered.
        """
        return np.flatnonzero(nodes.bounds <= target**self.power)

    def is_full(self, count: int) -> bool:
        """Return whether ``count`` open nodes, or the sets of dual weights, reach the memory limit."""
        return count >= self.max_open

    def certified_tree(self, tree: NodeTree) -> NodeTree:
        """Return the tree to record in the certificate of a search."""
        return tree


class NodeTree:
    """Branch-and-bound tree: open nodes, and the record of split and closed ones.

    Parameters
    ----------
    bounding : BoundingStrategy
    most_leaves : int
        Largest number of recorded leaves; beyond it, splits are no longer recorded.

    Attributes
    ----------
    nodes : int
        Number of nodes bounded so far.
    open : NodeArrays
    splits : list of pairs of arrays
        Recorded split nodes, (n, k), and the slots of their split cells, (n,).
    copies : dict
        Recorded nodes that were dropped as symmetric copies.
    """

    def __init__(self, bounding: BoundingStrategy, most_leaves: int) -> None:
        self.bounding, self.scope, self._most_leaves = bounding, bounding.scope, most_leaves
        self.nodes, self.splits, self.copies = 0, list[tuple[IntArray, IntArray]](), dict[Cells, SymmetricCopy]()
        self.open = NodeArrays.none(len(self.scope.contact_of_slot))
        self._closed = [self.open]
        self._highest_closed = 0.0
        self._recorded_leaves: NodeArrays | None = None
        self._bounded: dict[Cells, tuple[Cells, int]] = {}

    @property
    def largest_open_bound(self) -> float:
        """Largest bound on mu of an open node, 0 without open nodes."""
        return self._largest_bound(self.open)

    @property
    def upper(self) -> float:
        """Upper bound on mu over all placements."""
        return max(self._highest_closed, self.largest_open_bound)

    @property
    def leaves(self) -> NodeArrays:
        """Recorded leaves, which together with their symmetric copies cover all placements."""
        if self._recorded_leaves is not None:
            return self._recorded_leaves
        return NodeArrays.concatenate([*self._closed, self.open])

    @property
    def leaf_count(self) -> int:
        """Number of leaves of the tree, open and closed ones.

        Leaves closed after the tree has ceased to be ``complete`` do not count.
        """
        return len(self.open) + sum(len(nodes) for nodes in self._closed)

    @property
    def complete(self) -> bool:
        """Whether all nodes are recorded."""
        return self._recorded_leaves is None

    def begin(self, target: float) -> None:
        """Bound the root nodes, one per choice of root cells, without symmetric copies."""
        choices = product(
            *(combinations_with_replacement(p.roots, len(p.contact_indices)) for p in self.scope.contact_cells)
        )
        roots = np.array([list(chain.from_iterable(choice)) for choice in choices], dtype=np.int64)
        cells, _ = self._drop_copies(roots, np.arange(len(roots)))
        self.open = self.bounding.bound_nodes(cells, None, target)
        self.nodes = len(self.open)
        self._close(self._pop_open(np.flatnonzero(self.open.bounds <= target**self.bounding.power)))

    def branch(self, target: float) -> None:
        """Branch on the nodes with the largest bounds, and close those whose bound is at most the target."""
        if len(self.open):
            self.split(self.bounding.select_nodes(self.open, self.nodes, target), target)
            self._close(self._pop_open(self.bounding.improve(self.open, target)))

    def split(self, indices: IntArray, target: float) -> None:
        """Replace some open nodes by their children; close those that cannot be split."""
        if self.complete and self.leaf_count >= self._most_leaves:
            self._recorded_leaves = self.leaves
        nodes = self._pop_open(indices)
        slots = self.bounding.select_slots(nodes)
        self._close(nodes[slots == NONE])
        nodes, slots = nodes[slots != NONE], slots[slots != NONE]
        if self.complete:
            self.splits.append((nodes.cells, slots))
        cells, parent = self._drop_copies(*children(self.scope.groups, nodes.cells, slots))
        new_nodes = self.bounding.bound_nodes(cells, nodes[parent], target)
        self.nodes += len(new_nodes)
        self.open = NodeArrays.concatenate([self.open, new_nodes])

    def _pop_open(self, indices: IntArray) -> NodeArrays:
        """Remove and return some of the open nodes."""
        nodes = self.open[indices]
        if len(nodes):
            remaining = np.ones(len(self.open), dtype=bool)
            remaining[indices] = False
            self.open = self.open[remaining]
        return nodes

    def _close(self, nodes: NodeArrays) -> None:
        """Close nodes, so that their bounds are final."""
        self._highest_closed = max(self._highest_closed, self._largest_bound(nodes))
        if self.complete and len(nodes):
            self._closed.append(nodes)

    def _largest_bound(self, nodes: NodeArrays) -> float:
        """Return the largest bound on mu of some nodes."""
        return float(float(np.max(nodes.bounds, initial=0.0)) ** (1.0 / self.bounding.power))

    def _drop_copies(self, cells: IntArray, parent: IntArray) -> tuple[IntArray, IntArray]:
        """Return nodes and their parents, without nodes that are symmetric copies of earlier ones."""
        if not self.bounding.drops_copies:
            return cells, parent
        order = np.lexsort((-np.arange(len(parent)), parent))
        if self.scope.symmetries:
            order = np.array([i for i in order.tolist() if self._is_new(tuple(cells[i].tolist()))], dtype=np.int64)
        return cells[order], parent[order]

    def _is_new(self, cells: Cells) -> bool:
        """Return whether a node is no symmetric copy of an earlier one, and record the node or the copy."""
        representative, symmetry = min([(cells, NONE), *((image, i) for i, image in self._images(cells))])
        previous = self._bounded.get(representative)
        if previous is None:
            self._bounded[representative] = cells, symmetry
        elif previous[0] != cells and self.complete:
            self.copies[cells] = SymmetricCopy(symmetry, previous[1], previous[0])
        return previous is None

    def _images(self, cells: Cells) -> Iterator[tuple[int, Cells]]:
        """Yield the index of each symmetry that maps a node to a node, and the image."""
        for index, symmetry in enumerate(self.scope.symmetries):
            image: list[int] = []
            for i, (group, slots) in enumerate(self.scope.groups):
                image += sorted(symmetry.image(i, group, cell) for cell in cells[slots])
            if NONE not in image:
                yield index, tuple(image)


def children(
    groups: Sequence[tuple[ContactCells, slice]], nodes: IntArray, slots: IntArray
) -> tuple[IntArray, IntArray]:
    """Return the children of nodes, each split at the cell of one contact, with the indices of their parents.

    Identical contacts in the split cell are distributed over its halves in every way. As their order does not matter,
    the cells of a group are in ascending order.

    Parameters
    ----------
    groups : sequence of (ContactCells, slice)
        Groups of identical contacts, and their slots.
    nodes : (n, k) array
    slots : (n,) array

    Returns
    -------
    cells : (m, k) array
    parent : (m,) array
    """
    child_cells, parents = [nodes[:0]], [slots[:0]]
    for group, group_slots in groups:
        parent_indices = np.flatnonzero((slots >= group_slots.start) & (slots < group_slots.stop))
        cell = nodes[parent_indices, slots[parent_indices]]
        is_split = np.zeros((len(parent_indices), nodes.shape[1]), dtype=bool)
        is_split[:, group_slots] = nodes[parent_indices, group_slots] == cell[:, None]
        rank, counts = np.cumsum(is_split, axis=1), np.sum(is_split, axis=1)
        halves = group.child_indices(cell)
        for first_count in range(group_slots.stop - group_slots.start + 1):
            selected = counts >= first_count
            sides = np.where(rank[selected] > first_count, halves[selected, 1:], halves[selected, :1])
            child = np.where(is_split[selected], sides, nodes[parent_indices[selected]])
            child[:, group_slots] = np.sort(child[:, group_slots], axis=1)
            child_cells.append(child)
            parents.append(parent_indices[selected])
    cells, parent = np.concatenate(child_cells), np.concatenate(parents)
    allowed = np.all(cells != NONE, axis=1)
    return cells[allowed], parent[allowed]
