"""Tree of a branch and bound over placements: each node has one surface cell per contact.

The loosest nodes are cut, their parts are bounded, and parts whose bound is low enough are closed. How nodes are
bounded is left to a strategy (``BoundingStrategy``): a mixture of directions for every node, or mixtures that all nodes
share.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, combinations_with_replacement, product
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.global_bound.cells.cell import IntArray
from nlpgrasp.global_bound.contact_cells import NONE, ContactCells
from nlpgrasp.global_bound.dual_weights import DualWeights
from nlpgrasp.global_bound.scope import BoundScope
from nlpgrasp.global_bound.weak_twists import WeightedDirections

Cells = tuple[int, ...]  # a node: the number of a cell for each slot
Floats = FloatArray | NDArray[np.float32]


@dataclass(frozen=True)
class NodeArrays:
    """Nodes of a branch-and-bound tree, as arrays.

    Parameters
    ----------
    cells : (n, k) array
        A cell for each contact, by slot.
    bounds : (n,) array
        The most that mu is over these cells, to the power ``BoundingStrategy.power``.
    mixtures : (n,) array
        The number of the mixture of directions from which each bound follows.
    """

    cells: IntArray
    bounds: Floats
    mixtures: IntArray

    def __len__(self) -> int:
        return len(self.cells)

    def __getitem__(self, where: NDArray[np.int64] | NDArray[np.bool_]) -> NodeArrays:
        return NodeArrays(self.cells[where], self.bounds[where], self.mixtures[where])

    @classmethod
    def none(cls, contacts: int) -> NodeArrays:
        """Return an empty set of nodes."""
        return cls(np.zeros((0, contacts), dtype=np.int64), np.zeros(0), np.zeros(0, dtype=np.int64))

    @classmethod
    def concatenate(cls, parts: Sequence[NodeArrays]) -> NodeArrays:
        """Return the concatenation of nodes."""
        return cls(*(np.concatenate([getattr(p, name) for p in parts]) for name in ("cells", "bounds", "mixtures")))


@dataclass(frozen=True)
class FractionalPlacement:
    """Relaxed placement behind a node's bound: each contact spread over rows of its cell.

    Parameters
    ----------
    bound : float
        On mu.
    rows : (k, m) array
        Numbers of rows.
    shares : (k, m) array
        How much of each contact is there, of sum one over the rows.
    """

    bound: float
    rows: IntArray
    shares: FloatArray

    def heaviest(self) -> IntArray:
        """Return the row of each contact with the largest share, (k,)."""
        return np.asarray(self.rows[np.arange(len(self.rows)), np.argmax(self.shares, axis=1)])


@dataclass(frozen=True)
class SymmetricCopy:
    """Symmetric copy of a node that was met before, with the motion between them.

    Parameters
    ----------
    forward, back : int
        Numbers of symmetries; ``NONE`` of the identity.
    node : tuple of int
        Cells of the node met before.
    """

    forward: int
    back: int
    node: Cells


class BoundingStrategy(ABC):
    """Interface of a bounding strategy, which also selects nodes and contacts to branch on.

    Parameters
    ----------
    scope : BoundScope
    directions : int
        Of a node for which a mixture is made.

    Attributes
    ----------
    power : float
        Of mu: bounds of nodes are on mu to this power.
    by_parent : bool
        Whether parts of one node are bounded one after another.
    most_open : int
        Nodes beyond which a search ends.
    twists : WeightedDirections
    mixtures : list of DualWeights
    placements : list of FractionalPlacement
        Those that the bounds of the latest nodes rest on.
    """

    power: float = 1.0
    by_parent: ClassVar[bool]
    most_open: ClassVar[int]

    def __init__(self, scope: BoundScope, directions: int) -> None:
        self.scope, self.twists = scope, WeightedDirections(scope.task, scope.problem.body.size, directions)
        self.mixtures, self.placements = list[DualWeights](), list[FractionalPlacement]()

    @abstractmethod
    def bound_nodes(self, cells: IntArray, parents: NodeArrays | None, target: float) -> NodeArrays:
        """Return nodes (n, k) with their bounds, in any order; ``parents`` are the nodes they were split from.

        A bound that is at most the target, on mu, need not be the least.
        """

    @abstractmethod
    def loosest(self, nodes: NodeArrays, count: int, target: float) -> IntArray:
        """Return which open nodes to branch on next, in order, after so many nodes in all."""

    @abstractmethod
    def slots(self, nodes: NodeArrays) -> IntArray:
        """Return the slot of the cell to split, of each node; ``NONE`` where no cell can be."""

    @abstractmethod
    def recomputed(self, nodes: NodeArrays) -> FloatArray:
        """Return bounds on mu recomputed from the recorded dual weights by plain arithmetic, (n,)."""

    def improve(self, nodes: NodeArrays, target: float) -> IntArray:
        """Lower the bounds of some open nodes, in place; return those to close: at most the target, on mu."""
        return np.flatnonzero(nodes.bounds <= target**self.power)

    def is_full(self, count: int) -> bool:
        """Return whether so many open nodes, or the dual weights, exceed the memory limit."""
        return count >= self.most_open

    def recorded(self, tree: NodeTree) -> NodeTree:
        """Return the tree that is written as the certificate of a search."""
        return tree


class NodeTree:
    """Branch-and-bound tree: open nodes, and the record of split and closed ones.

    Parameters
    ----------
    bounding : BoundingStrategy
    most_leaves : int
        Leaves beyond which nodes are cut without record: the record stays as fine as it was.

    Attributes
    ----------
    nodes : int
        How many there were so far.
    open : NodeArrays
    splits : list of pairs of arrays
        Recorded nodes that were cut, (n, k), and the slots of the cells that were, (n,).
    twins : dict
        Recorded nodes that were not bounded, because a symmetric copy was.
    """

    def __init__(self, bounding: BoundingStrategy, most_leaves: int) -> None:
        self.bounding, self.scope, self._most_leaves = bounding, bounding.scope, most_leaves
        self.nodes, self.splits, self.twins = 0, list[tuple[IntArray, IntArray]](), dict[Cells, SymmetricCopy]()
        self.open = NodeArrays.none(len(self.scope.slots))
        self._closed = [self.open]
        self._highest_closed = 0.0
        self._kept: NodeArrays | None = None
        self._met: dict[Cells, tuple[Cells, int]] = {}

    @property
    def top(self) -> float:
        """Largest bound on mu of an open node; 0 without one."""
        return self._mu(self.open)

    @property
    def upper(self) -> float:
        """Upper bound on mu over all placements."""
        return max(self._highest_closed, self.top)

    @property
    def leaves(self) -> NodeArrays:
        """Recorded leaves: together with their symmetric copies they cover all placements."""
        return NodeArrays.concatenate([*self._closed, self.open]) if self._kept is None else self._kept

    @property
    def size(self) -> int:
        """Number of leaves while all nodes are recorded."""
        return len(self.open) + sum(len(nodes) for nodes in self._closed)

    @property
    def complete(self) -> bool:
        """Whether all nodes are recorded."""
        return self._kept is None

    def begin(self, target: float) -> None:
        """Bound the root nodes: one per choice of first cells, without symmetric copies."""
        choices = product(*(combinations_with_replacement(p.roots, len(p.slots)) for p in self.scope.pieces))
        roots = np.array([list(chain.from_iterable(choice)) for choice in choices], dtype=np.int64)
        new, _ = self._distinct(roots, np.arange(len(roots)))
        self.open = self.bounding.bound_nodes(new, None, target)
        self.nodes = len(self.open)
        self._close(self._pop_open(np.flatnonzero(self.open.bounds <= target**self.bounding.power)))

    def branch(self, target: float) -> None:
        """Branch on the loosest nodes, and close those whose bound is at most the target."""
        if len(self.open):
            self.cut(self.bounding.loosest(self.open, self.nodes, target), target)
            self._close(self._pop_open(self.bounding.improve(self.open, target)))

    def cut(self, where: IntArray, target: float) -> None:
        """Replace some open nodes by their children; close those that cannot be split."""
        if self.complete and self.size >= self._most_leaves:
            self._kept = self.leaves
        nodes = self._pop_open(where)
        slots = self.bounding.slots(nodes)
        self._close(nodes[slots == NONE])
        nodes, slots = nodes[slots != NONE], slots[slots != NONE]
        if self.complete:
            self.splits.append((nodes.cells, slots))
        cells, parent = self._distinct(*children(self.scope.groups, nodes.cells, slots))
        found = self.bounding.bound_nodes(cells, nodes[parent], target)
        self.nodes += len(found)
        self.open = NodeArrays.concatenate([self.open, found])

    def _pop_open(self, where: IntArray) -> NodeArrays:
        """Remove some of the open nodes and return them."""
        taken = self.open[where]
        if len(taken):
            rest = np.ones(len(self.open), dtype=bool)
            rest[where] = False
            self.open = self.open[rest]
        return taken

    def _close(self, nodes: NodeArrays) -> None:
        """Close nodes: their bounds hold for good."""
        self._highest_closed = max(self._highest_closed, self._mu(nodes))
        if self.complete and len(nodes):
            self._closed.append(nodes)

    def _mu(self, nodes: NodeArrays) -> float:
        """Return the largest bound of some nodes, on mu."""
        return float(float(np.max(nodes.bounds, initial=0.0)) ** (1.0 / self.bounding.power))

    def _distinct(self, cells: IntArray, parent: IntArray) -> tuple[IntArray, IntArray]:
        """Return nodes and their parents, without symmetric copies of nodes met before."""
        if not self.bounding.by_parent:
            return cells, parent
        order = np.lexsort((-np.arange(len(parent)), parent))
        if self.scope.symmetries:
            order = np.array([i for i in order.tolist() if self._is_new(tuple(cells[i].tolist()))], dtype=np.int64)
        return cells[order], parent[order]

    def _is_new(self, cells: Cells) -> bool:
        """Return whether a node has no symmetric copy met before; remembers it, and records copies."""
        least, symmetry = min([(cells, NONE), *((image, i) for i, image in self._images(cells))])
        met = self._met.get(least)
        if met is None:
            self._met[least] = cells, symmetry
        elif met[0] != cells and self.complete:
            self.twins[cells] = SymmetricCopy(symmetry, met[1], met[0])
        return met is None

    def _images(self, cells: Cells) -> Iterator[tuple[int, Cells]]:
        for number, symmetry in enumerate(self.scope.symmetries):
            image: list[int] = []
            for i, (pieces, where) in enumerate(self.scope.groups):
                image += sorted(symmetry.image(i, pieces, cell) for cell in cells[where])
            if NONE not in image:
                yield number, tuple(image)


def children(
    groups: Sequence[tuple[ContactCells, slice]], nodes: IntArray, slots: IntArray
) -> tuple[IntArray, IntArray]:
    """Return the children of nodes, each split at its slot, and their parents' indices.

    All contacts that are alike in that slot's cell go to its halves in every possible way.

    Parameters
    ----------
    groups : sequence of (ContactCells, slice)
        Contacts that are alike, and their slots.
    nodes : (n, k) array
    slots : (n,) array

    Returns
    -------
    cells : (m, k) array
    parent : (m,) array
    """
    parts, parents = [nodes[:0]], [slots[:0]]
    for pieces, group in groups:
        here = np.flatnonzero((slots >= group.start) & (slots < group.stop))
        cell = nodes[here, slots[here]]
        same = np.zeros((len(here), nodes.shape[1]), dtype=bool)
        same[:, group] = nodes[here, group] == cell[:, None]
        rank, times = np.cumsum(same, axis=1), np.sum(same, axis=1)
        halves = pieces.child_numbers(cell)
        for lower in range(group.stop - group.start + 1):
            own = times >= lower
            chosen = np.where(rank[own] > lower, halves[own, 1:], halves[own, :1])
            made = np.where(same[own], chosen, nodes[here[own]])
            made[:, group] = np.sort(made[:, group], axis=1)
            parts.append(made)
            parents.append(here[own])
    every, parent = np.concatenate(parts), np.concatenate(parents)
    allowed = np.all(every != NONE, axis=1)
    return every[allowed], parent[allowed]
