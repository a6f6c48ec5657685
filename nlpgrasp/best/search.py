"""Bound and grasps together: the tree closes in from above, climbs from its heaviest designs from below."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Sequence

import numpy as np

from nlpgrasp.best.bound.twists import Twists
from nlpgrasp.best.climb import Climber, Spot
from nlpgrasp.best.scope.pieces import NONE
from nlpgrasp.best.scope.scope import Scope
from nlpgrasp.best.tree.nodes import Node
from nlpgrasp.best.tree.tree import Tree
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.grasp import Grasp
from nlpgrasp.quality import Bounds, mu

ROUGH, FINE = 0.01, 0.15  # width of a grasp's certificate: at first, and at last relative to the gap asked for
SHARE = 0.8  # of the gap that the tree closes; the rest is the certificate's
CLIMBS, MORE, SAME = 3, 150, 3  # at first; nodes that are worth one more; from designs in the same root cells
BETTER = 1e-3


class Search:
    """The state of a search for the best placement.

    Parameters
    ----------
    scope : Scope
    gap : float
        Relative, at which to stop.
    """

    def __init__(self, scope: Scope, gap: float) -> None:
        self.scope, self.gap = scope, gap
        body = scope.problem.body
        self.twists = Twists(scope.task, body.size)
        self.tree = Tree(scope, self.twists)
        self.climber = Climber(scope.task, self.twists.lattice, body.size)
        self.grasp: Grasp | None = None
        self.faces: tuple[str, ...] = ()
        self.mu = Bounds(0.0, 0.0)
        self.value = 0.0  # what the best grasp's mu seems to be, within its certificate
        self._climbs: Counter[tuple[int, ...]] = Counter()

    @property
    def target(self) -> float:
        """The bound at which a node needs no further look."""
        return self.value * (1.0 + SHARE * self.gap)

    @property
    def upper(self) -> float:
        """The bound on mu over all placements."""
        return max(self.tree.upper, self.mu.lower)

    @property
    def closed(self) -> bool:
        """Whether the bound is within the gap of the best grasp's certified mu."""
        return self.upper <= self.mu.lower * (1.0 + self.gap)

    def run(self, stopped: Callable[[], bool], watch: Callable[[Search], None] | None = None) -> None:
        """Search until the gap is closed, memory is full, or ``stopped`` says so; the bound holds at any time."""
        nodes = self.tree.begin(self.target)
        while True:
            self._look(nodes)
            if watch is not None:
                watch(self)
            if self.tree.upper <= self.target:
                self.refine()
            if self.closed or self.tree.full or stopped():
                return
            nodes = self.tree.grow(self.target)

    def refine(self) -> None:
        """Certify the best grasp as narrowly as the gap asks for."""
        if self.grasp is not None and self.mu.gap > FINE * self.gap:
            self.mu = self._certified(self.grasp, FINE * self.gap)
            self.value = self.mu.lower

    def _certified(self, grasp: Grasp, rtol: float) -> Bounds:
        return mu(grasp, self.scope.task, rtol, force_budget=self.scope.problem.budget)

    def _look(self, nodes: Sequence[Node]) -> None:
        """Climb from the heaviest rows of the loosest new node."""
        for node in sorted(nodes)[:2]:
            spots = self._spots(node)
            roots = self._roots(node)
            if self._climbs[roots] >= SAME or self._climbs.total() >= CLIMBS + self.tree.nodes // MORE:
                continue
            if not all(spot.allowed for spot in spots):
                continue
            self._climbs[roots] += 1
            self.offer(*self.climber.climb(spots, self.twists[node.twists], self.value))

    def _roots(self, node: Node) -> tuple[int, ...]:
        """Return the root cells that a node's cells are parts of."""
        result = []
        for cell, pieces in zip(node.cells, (p for p in self.scope.pieces for _ in p.slots), strict=True):
            while pieces.parents[cell] != NONE:
                cell = pieces.parents[cell]
            result.append(cell)
        return tuple(result)

    def _spots(self, node: Node) -> list[Spot]:
        """Return each contact at its heaviest row."""
        spots, slot = [], 0
        for pieces in self.scope.pieces:
            for _ in pieces.slots:
                row = int(node.rows[slot][np.argmax(node.design[slot])])
                points, normals = pieces.supports.points[row], pieces.supports.normals[row]
                spots.append(Spot(pieces, pieces.surfaces[node.cells[slot]], points, normals))
                slot += 1
        return spots

    def offer(self, spots: Sequence[Spot], value: float) -> None:
        """Certify a grasp that seems better than the best so far."""
        if value <= self.value * (1.0 + BETTER):
            return
        order = np.argsort(self.scope.slots)
        placed = [spots[i] for i in order]
        points: FloatArray = np.stack([s.point for s in placed])
        normals: FloatArray = np.stack([s.normal for s in placed])
        problem = self.scope.problem
        grasp = Grasp(points, normals, problem.models, problem.origin)
        found = self._certified(grasp, ROUGH)
        if found.lower > self.mu.lower:
            self.grasp, self.mu, self.faces = grasp, found, tuple(s.surface.name for s in placed)
            self.value = min(value, found.upper)


def deadline(seconds: float) -> Callable[[], bool]:
    """Return what says whether some seconds are over, counted from now."""
    end = time.monotonic() + seconds
    return lambda: time.monotonic() >= end
