"""Branch and bound over placements: nodes of one cell for each contact, the loosest bound first."""

from __future__ import annotations

import heapq
from collections.abc import Iterator, Sequence
from itertools import combinations_with_replacement, product

import numpy as np

from nlpgrasp.best.bound.twists import Twists
from nlpgrasp.best.scope.pieces import NONE
from nlpgrasp.best.scope.scope import Scope
from nlpgrasp.best.tree.batch import Batch
from nlpgrasp.best.tree.nodes import Cells, Node
from nlpgrasp.best.tree.proof import Proof

BATCH = 64
FEWEST, PART = 8, 4  # nodes cut at a time: at least, and of those so far one in so many
WORK = 500_000  # rows times directions of a batch; nodes are cut until there is work for some batches
BATCHES = 4
MOST_OPEN = 100_000  # nodes, beyond which a search ends
SPREAD = 1e-2  # weight of a cell's squared radius beside the design's variance over it


class Tree:
    """What is left to look at, as a heap of nodes, and what it took to close the rest.

    Parameters
    ----------
    scope : Scope
    twists : Twists
    """

    def __init__(self, scope: Scope, twists: Twists) -> None:
        self.scope, self.twists = scope, twists
        self.proof = Proof()
        self.nodes = 0
        self._heap: list[Node] = []
        self._closed = 0.0
        self._seen: dict[Cells, tuple[Cells, int]] = {}

    @property
    def top(self) -> float:
        """The loosest bound of a node that is open, 0 where none is."""
        return self._heap[0].bound if self._heap else 0.0

    @property
    def upper(self) -> float:
        """An upper bound on mu over all placements."""
        return max(self._closed, self.top)

    @property
    def looked(self) -> int:
        """Nodes for which mixtures were sought."""
        return self.nodes

    @property
    def full(self) -> bool:
        """Whether as many nodes are open as memory is meant for."""
        return len(self._heap) >= MOST_OPEN

    def begin(self, target: float) -> list[Node]:
        """Bound one node for each choice of root cells, but for mirror images; return those that stay open."""
        choices = product(*(combinations_with_replacement(p.roots, len(p.slots)) for p in self.scope.pieces))
        roots = [tuple(cell for group in choice for cell in group) for choice in choices]
        new = [cells for cells in roots if self._is_new(cells)]
        first = self.twists.first()
        return self._bounded([(cells, first, None) for cells in new], target)

    def grow(self, target: float) -> list[Node]:
        """Cut the cells of the loosest nodes; return those of the new nodes whose bound exceeds the target."""
        todo: list[tuple[Cells, np.ndarray, np.ndarray | None]] = []
        work = 0
        self.proof.go_on()
        for _ in range(min(BATCH, max(FEWEST, self.nodes // PART))):
            if not self._heap or self._heap[0].bound <= target or work >= BATCHES * WORK:
                break
            node = heapq.heappop(self._heap)
            children = self._children(node)
            if children is None:
                self._close(node)
                continue
            new = [cells for cells in children if self._is_new(cells)]
            todo += [(cells, node.twists, node.weights) for cells in new]
            work += sum(self._work(cells) for cells in new)
        return self._bounded(todo, target)

    def _children(self, node: Node) -> list[Cells] | None:
        """Return the nodes that a node falls into, None where its cells are points."""
        slot = self._loosest(node)
        if slot is None:
            return None
        pieces, where = self.scope.group_of[slot]
        cell, group = node.cells[slot], node.cells[where]
        parts = pieces.children(cell)
        rest, times = [c for c in group if c != cell], group.count(cell)
        self.proof.split(node.cells, slot)
        before, after = node.cells[: where.start], node.cells[where.stop :]
        chosen = combinations_with_replacement(parts, times)
        return [before + tuple(sorted([*rest, *new])) + after for new in chosen]

    def _loosest(self, node: Node) -> int | None:
        """Return the slot whose contact is most spread over a cell that can be cut."""
        best, most = None, -1.0
        for slot, cell in enumerate(node.cells):
            pieces = self.scope.group_of[slot][0]
            if pieces.radii[cell] == 0.0:
                continue
            points, weights = pieces.supports.points[node.rows[slot]], node.design[slot]
            middle = weights @ points
            spread = float(weights @ np.sum((points - middle) ** 2, axis=1)) + SPREAD * pieces.radii[cell] ** 2
            if spread > most:
                best, most = slot, spread
        return best

    def _is_new(self, cells: Cells) -> bool:
        """Return whether no mirror image of these cells was met before; remembers them."""
        images = [(cells, NONE), *((image, i) for i, image in self._images(cells))]
        least, symmetry = min(images)
        met = self._seen.get(least)
        if met is None:
            self._seen[least] = cells, symmetry
        elif met[0] != cells:
            self.proof.twin(cells, symmetry, *met)
        return met is None

    def _images(self, cells: Cells) -> Iterator[tuple[int, Cells]]:
        for number, symmetry in enumerate(self.scope.symmetries):
            image: list[int] = []
            for i, (pieces, where) in enumerate(self.scope.groups):
                image += sorted(symmetry.image(i, pieces, cell) for cell in cells[where])
            if NONE not in image:
                yield number, tuple(image)

    def _bounded(self, todo: Sequence[tuple[Cells, np.ndarray, np.ndarray | None]], target: float) -> list[Node]:
        """Bound nodes batch by batch; close those that do not exceed the target and keep the others."""
        kept: list[Node] = []
        begin = 0
        while begin < len(todo):
            end, work = begin, 0
            while end < len(todo) and (end == begin or (end - begin < BATCH and work < WORK)):
                work += self._work(todo[end][0])
                end += 1
            chunk = todo[begin:end]
            given = [t[2] for t in chunk]
            weights = None if given[0] is None else np.stack([w for w in given if w is not None])
            batch = Batch(self.scope, [t[0] for t in chunk], np.stack([t[1] for t in chunk]), self.twists)
            for found in batch.bounded(weights, target):
                self.nodes += 1
                node = found.node(self.nodes)
                self.proof.bounded(node)
                if found.bound <= target:
                    self._close(node)
                else:
                    kept.append(node)
                    heapq.heappush(self._heap, node)
            begin = end
        return kept

    def _work(self, cells: Cells) -> int:
        """Return how many rows times directions a node takes."""
        rows = 0
        for slot, cell in enumerate(cells):
            rows += self.scope.group_of[slot][0].supports.count(cell)
        return rows * self.twists.per_node

    def _close(self, node: Node) -> None:
        """Count a node as done: its bound holds for good."""
        self._closed = max(self._closed, node.bound)
