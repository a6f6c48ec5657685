"""Branch and bound over placements: a tree of nodes, each with one cell of the surface for each contact.

The loosest nodes are cut, their parts are bounded, and parts whose bound is low enough are closed. How nodes are
bounded is left to a strategy (``Bounding``): a mixture of directions for every node, or mixtures that all nodes share.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, combinations_with_replacement, product
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.best.bound.mixtures import Mixture
from nlpgrasp.best.bound.twists import Twists
from nlpgrasp.best.cells.base import IntArray
from nlpgrasp.best.scope.pieces import NONE, Pieces
from nlpgrasp.best.scope.scope import Scope
from nlpgrasp.common.validation import FloatArray

Cells = tuple[int, ...]
Floats = FloatArray | NDArray[np.float32]


@dataclass(frozen=True)
class Nodes:
    """Nodes of the tree, as arrays.

    Parameters
    ----------
    cells : (n, k) array
        A cell for each contact, by slot.
    bounds : (n,) array
        The most that mu is over these cells, to the power ``Bounding.power``.
    mixtures : (n,) array
        The number of the mixture of directions from which each bound follows.
    """

    cells: IntArray
    bounds: Floats
    mixtures: IntArray

    def __len__(self) -> int:
        return len(self.cells)

    def __getitem__(self, where: NDArray[np.int64] | NDArray[np.bool_]) -> Nodes:
        return Nodes(self.cells[where], self.bounds[where], self.mixtures[where])

    @classmethod
    def none(cls, contacts: int) -> Nodes:
        """Return no nodes."""
        return cls(np.zeros((0, contacts), dtype=np.int64), np.zeros(0), np.zeros(0, dtype=np.int64))

    @classmethod
    def joined(cls, parts: Sequence[Nodes]) -> Nodes:
        """Return the nodes of all parts, one after another."""
        return cls(*(np.concatenate([getattr(p, name) for p in parts]) for name in ("cells", "bounds", "mixtures")))


@dataclass(frozen=True)
class FractionalPlacement:
    """The placement that a node's bound rests on: each contact spread over rows of its cell.

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
class Twin:
    """A symmetric copy of a node: forward by one symmetry, then back by another, it goes to the node met before.

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


class Bounding(ABC):
    """Strategy that bounds mu over nodes, and says which are cut where.

    Parameters
    ----------
    scope : Scope
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
    twists : Twists
    mixtures : list of Mixture
    placements : list of FractionalPlacement
        Those that the bounds of the latest nodes rest on.
    """

    power: float = 1.0
    by_parent: ClassVar[bool]
    most_open: ClassVar[int]

    def __init__(self, scope: Scope, directions: int) -> None:
        self.scope, self.twists = scope, Twists(scope.task, scope.problem.body.size, directions)
        self.mixtures, self.placements = list[Mixture](), list[FractionalPlacement]()

    @abstractmethod
    def bounded(self, cells: IntArray, parents: Nodes | None, target: float) -> Nodes:
        """Return nodes (n, k) with their bounds, in any order; ``parents`` are those they are parts of.

        A bound that is at most the target, on mu, need not be the least.
        """

    @abstractmethod
    def loosest(self, nodes: Nodes, count: int, target: float) -> IntArray:
        """Return which of the open nodes to cut next, in order, after so many nodes in all."""

    @abstractmethod
    def slots(self, nodes: Nodes) -> IntArray:
        """Return the slot whose cell is cut, of each node; ``NONE`` where no cell can be."""

    @abstractmethod
    def recomputed(self, nodes: Nodes) -> FloatArray:
        """Return bounds on mu from the mixtures as they are written, by plain arithmetic, (n,)."""

    def improve(self, nodes: Nodes, target: float) -> IntArray:
        """Lower the bounds of some open nodes, in place; return which to close: those at most the target, on mu."""
        return np.flatnonzero(nodes.bounds <= target**self.power)

    def is_full(self, count: int) -> bool:
        """Return whether so many open nodes, or the mixtures, are as many as memory is meant for."""
        return count >= self.most_open

    def recorded(self, tree: NodeTree) -> NodeTree:
        """Return the tree that is written as the certificate of a search."""
        return tree


class NodeTree:
    """Open nodes, and the record of how the others were cut and closed.

    Parameters
    ----------
    bounding : Bounding
    most_leaves : int
        Leaves beyond which nodes are cut without record: the record stays as fine as it was.

    Attributes
    ----------
    nodes : int
        How many there were so far.
    open : Nodes
    splits : list of pairs of arrays
        Recorded nodes that were cut, (n, k), and the slots of the cells that were, (n,).
    twins : dict
        Recorded nodes that were not bounded, because a symmetric copy was.
    """

    def __init__(self, bounding: Bounding, most_leaves: int) -> None:
        self.bounding, self.scope, self._most_leaves = bounding, bounding.scope, most_leaves
        self.nodes, self.splits, self.twins = 0, list[tuple[IntArray, IntArray]](), dict[Cells, Twin]()
        self.open = Nodes.none(len(self.scope.slots))
        self._closed = [self.open]
        self._highest_closed = 0.0
        self._kept: Nodes | None = None
        self._met: dict[Cells, tuple[Cells, int]] = {}

    @property
    def top(self) -> float:
        """The loosest bound of an open node, on mu; 0 where none is."""
        return self._mu(self.open)

    @property
    def upper(self) -> float:
        """An upper bound on mu over all placements."""
        return max(self._highest_closed, self.top)

    @property
    def leaves(self) -> Nodes:
        """The recorded nodes that were not cut: together with their twins they cover all placements."""
        return Nodes.joined([*self._closed, self.open]) if self._kept is None else self._kept

    @property
    def size(self) -> int:
        """How many leaves there are while all nodes are recorded."""
        return len(self.open) + sum(len(nodes) for nodes in self._closed)

    @property
    def complete(self) -> bool:
        """Whether all nodes are recorded."""
        return self._kept is None

    def begin(self, target: float) -> None:
        """Bound one node for each choice of first cells, but for symmetric copies."""
        choices = product(*(combinations_with_replacement(p.roots, len(p.slots)) for p in self.scope.pieces))
        roots = np.array([list(chain.from_iterable(choice)) for choice in choices], dtype=np.int64)
        new, _ = self._distinct(roots, np.arange(len(roots)))
        self.open = self.bounding.bounded(new, None, target)
        self.nodes = len(self.open)
        self._close(self._take(np.flatnonzero(self.open.bounds <= target**self.bounding.power)))

    def grow(self, target: float) -> None:
        """Cut the loosest nodes, and close those whose bound is at most the target."""
        if len(self.open):
            self.cut(self.bounding.loosest(self.open, self.nodes, target), target)
            self._close(self._take(self.bounding.improve(self.open, target)))

    def cut(self, where: IntArray, target: float) -> None:
        """Replace some of the open nodes by their parts; close those that cannot be cut."""
        if self.complete and self.size >= self._most_leaves:
            self._kept = self.leaves
        nodes = self._take(where)
        slots = self.bounding.slots(nodes)
        self._close(nodes[slots == NONE])
        nodes, slots = nodes[slots != NONE], slots[slots != NONE]
        if self.complete:
            self.splits.append((nodes.cells, slots))
        cells, parent = self._distinct(*children(self.scope.groups, nodes.cells, slots))
        found = self.bounding.bounded(cells, nodes[parent], target)
        self.nodes += len(found)
        self.open = Nodes.joined([self.open, found])

    def _take(self, where: IntArray) -> Nodes:
        """Return some of the open nodes, which are open no more."""
        taken = self.open[where]
        if len(taken):
            rest = np.ones(len(self.open), dtype=bool)
            rest[where] = False
            self.open = self.open[rest]
        return taken

    def _close(self, nodes: Nodes) -> None:
        """Count nodes as done: their bounds hold for good."""
        self._highest_closed = max(self._highest_closed, self._mu(nodes))
        if self.complete and len(nodes):
            self._closed.append(nodes)

    def _mu(self, nodes: Nodes) -> float:
        """Return the largest bound of some nodes, on mu."""
        return float(float(np.max(nodes.bounds, initial=0.0)) ** (1.0 / self.bounding.power))

    def _distinct(self, cells: IntArray, parent: IntArray) -> tuple[IntArray, IntArray]:
        """Return nodes and their parents without those whose symmetric copy was met before."""
        if not self.bounding.by_parent:
            return cells, parent
        order = np.lexsort((-np.arange(len(parent)), parent))
        if self.scope.symmetries:
            order = np.array([i for i in order.tolist() if self._is_new(tuple(cells[i].tolist()))], dtype=np.int64)
        return cells[order], parent[order]

    def _is_new(self, cells: Cells) -> bool:
        """Return whether no symmetric copy of a node was met before; remembers it, and records twins."""
        least, symmetry = min([(cells, NONE), *((image, i) for i, image in self._images(cells))])
        met = self._met.get(least)
        if met is None:
            self._met[least] = cells, symmetry
        elif met[0] != cells and self.complete:
            self.twins[cells] = Twin(symmetry, met[1], met[0])
        return met is None

    def _images(self, cells: Cells) -> Iterator[tuple[int, Cells]]:
        for number, symmetry in enumerate(self.scope.symmetries):
            image: list[int] = []
            for i, (pieces, where) in enumerate(self.scope.groups):
                image += sorted(symmetry.image(i, pieces, cell) for cell in cells[where])
            if NONE not in image:
                yield number, tuple(image)


def children(groups: Sequence[tuple[Pieces, slice]], nodes: IntArray, slots: IntArray) -> tuple[IntArray, IntArray]:
    """Return the parts of nodes, each cut at its slot, and whose parts they are.

    All contacts that are alike in that slot's cell go to its halves in every possible way.

    Parameters
    ----------
    groups : sequence of (Pieces, slice)
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
        halves = pieces.halves(cell)
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
