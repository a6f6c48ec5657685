"""Bound and grasps together: the tree closes in from above, climbs from its heaviest designs from below."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence

import numpy as np

from nlpgrasp.best.bound.weakest import Design, descended
from nlpgrasp.best.climb import Climber
from nlpgrasp.best.exchange import Exchange
from nlpgrasp.best.incumbent import ROUGH, Incumbent
from nlpgrasp.best.pool.certificate import pool_certificate
from nlpgrasp.best.pool.tree import PoolTree
from nlpgrasp.best.scope.scope import Scope
from nlpgrasp.best.spots import Spot
from nlpgrasp.best.tree.certificate import certificate
from nlpgrasp.best.tree.nodes import Node
from nlpgrasp.best.trees import tree_of
from nlpgrasp.best.wander import wander
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray

SHARE, UNSURE = 0.8, 0.5  # of the gap that the tree closes; the rest is the certificate's, at first a rough one's
CLIMBS, MORE, SAME = 4, 0.8, 3  # at first; more, by the root of the nodes; from designs in the same root cells
OF_ROUGH = 0.12  # climbs a node on a mesh, where designs say less
LOOKED, STARTS = 8, 4  # of the new nodes, best first; directions that descents begin from
FEW, SURVEYED = 40, 400  # nodes before the first and between other rounds of climbs of a survey
EARLY = 3  # climbs of the first round, which prunes the tree
AFTER, WIDE = 300, 0.1  # nodes after which grasps are drawn at random, where the gap is wider than that
AGAIN = 3  # climbs from one design, while certificates disprove what they end with


class Search:
    """The state of a search for the best placement.

    Parameters
    ----------
    scope : Scope
    gap : float
        Relative, at which to stop.
    rough : float
        Relative width of the certificates of grasps met, until the best is close to the bound.
    """

    def __init__(self, scope: Scope, gap: float, rough: float = ROUGH) -> None:
        self.scope, self.gap = scope, gap
        self.best = Incumbent(scope, gap, rough)
        self.tree = tree_of(scope)
        self.twists = self.tree.twists
        self.climber = Climber(scope.task, self.twists.lattice, scope.problem.body.size)
        self.exchange = Exchange.of(scope.pieces, self.climber)
        self._reach_of = [reach for reach in scope.pieces for _ in reach.slots]
        self._begun = self._wandered = False
        self._hurried = True  # whether climbs far below the best so far end early
        self._fresh: list[Node] = []  # nodes that no climb began from yet
        self._rng = np.random.default_rng(0)
        self._climbs: Counter[tuple[int, ...]] = Counter()

    @property
    def target(self) -> float:
        """The bound at which a node needs no further look."""
        return self.best.value * (1.0 + (SHARE if self.best.sure else UNSURE) * self.gap)

    @property
    def upper(self) -> float:
        """The bound on mu over all placements."""
        return max(self.tree.upper, self.best.known)

    @property
    def closed(self) -> bool:
        """Whether the bound is within the gap of the best grasp's certified mu."""
        return self.upper <= self.best.known * (1.0 + self.gap)

    @property
    def searched(self) -> bool:
        """Whether there is nothing more to look at: the gap is closed, as far as it can be, or memory is full."""
        return self.closed or self.tree.top <= self.target or self.tree.full

    def run(self, stopped: Callable[[], bool], watch: Callable[[Search], None] | None = None) -> None:
        """Search until the gap is closed, memory is full, or ``stopped`` says so; the bound holds at any time.

        Nodes are climbed from as they come.
        """
        if self._begun and not self._fresh:
            self._fresh = self.tree.grow(self.target)
        self.begin()
        while True:
            self._look(self._fresh, LOOKED)
            if watch is not None:
                watch(self)
            if self.tree.top <= self.best.value * (1.0 + SHARE * self.gap):
                self.best.refine()
            if self.searched or stopped():
                self._fresh = []
                return
            self._fresh = self.tree.grow(self.target)

    def survey(self, nodes: int, stopped: Callable[[], bool]) -> None:
        """Cut cells until the tree has so many nodes, and climb from the best of many of them, side by side.

        Few large batches of climbs take half the time of many small ones; the first one is small, for a grasp to prune
        the tree by. All climbs go on to their ends: the best grasp often begins far below others.
        """
        self._hurried = False
        self.begin()
        while not stopped():
            few = self.exchange is None and self.tree.nodes < FEW  # a mesh's tree is hardly pruned
            last = min(nodes, self.tree.nodes + (FEW if few else SURVEYED))
            while self.tree.nodes < last and not self.searched and not stopped():
                self._fresh += self.tree.grow(self.target)
            self._look(self._fresh, EARLY if few else SURVEYED)
            self._fresh = self._fresh if few else []
            if self.tree.nodes >= nodes or self.searched:
                return

    def begin(self) -> None:
        """Bound all placements once, without a grasp; does nothing where that was done."""
        if not self._begun:
            self._fresh, self._begun = self.tree.begin(self.target), True

    def tighten(self, nodes: int) -> None:
        """Cut cells until the tree has so many nodes, and look for no grasps."""
        self.begin()
        while self.tree.nodes < nodes and self.tree.top > self.target and not self.tree.full:
            self._fresh = self.tree.grow(self.target)

    def certificate(self) -> tuple[float, Json]:
        """Return the bound that follows from what is recorded of the search, and the record (docs/how_close.md)."""
        return pool_certificate(self.tree) if isinstance(self.tree, PoolTree) else certificate(self.tree)

    def _look(self, nodes: Sequence[Node], most: int) -> None:
        """Climb from the heaviest rows, then from others, of those new nodes where these seem to be the best grasps."""
        open_nodes = [node for node in nodes if node.rows.size]
        begun: list[tuple[list[Spot], FloatArray]] = []
        for i in np.argsort(-self._values(open_nodes), kind="stable")[:most].tolist():
            node, allowance = open_nodes[i], CLIMBS + MORE * np.sqrt(self.tree.looked)
            allowance = allowance if self.exchange is None else max(allowance, OF_ROUGH * self.tree.nodes)
            roots = self._roots(node)
            if self._climbs[roots] >= SAME or self._climbs.total() >= allowance:
                continue
            spots = self._spots(node, drawn=self._climbs[roots] > 0)
            spots = spots if self.exchange is None else self.exchange.allowed(spots)
            if not all(spot.allowed for spot in spots):
                continue
            self._climbs[roots] += 1
            begun.append((spots, self.twists[node.twists]))
        if self.exchange is not None:
            ended = self.exchange.improved([spots for spots, _ in begun], [twists for _, twists in begun])
            begun = [(one.spots, one.latest) for one in ended]
        self._climb(begun)
        if not self._wandered and self.tree.nodes >= AFTER:
            self._wandered, wide = True, self.upper > (1.0 + WIDE) * self.best.value
            self._climb(wander(self.scope, self.climber, self._rng) if wide and self.exchange is None else [])

    def _climb(self, begun: Sequence[tuple[Sequence[Spot], FloatArray]]) -> None:
        """Climb from some spots, with directions that are weak there; anew where a certificate taught a direction."""
        for _ in range(AGAIN):
            if not begun:
                return
            known = self.best.value if self._hurried else 0.0
            found = self.climber.climb([spots for spots, _ in begun], [twists for _, twists in begun], known)
            begun = [one for one, ended in zip(begun, found, strict=True) if not self._offer(*ended)]

    def _values(self, nodes: Sequence[Node]) -> FloatArray:
        """Return what mu seems to be with each contact at its heaviest row, (b,)."""
        if not nodes:
            return np.zeros(0)
        heavy = np.array([n.rows[np.arange(len(n.rows)), np.argmax(n.design, axis=1)] for n in nodes])
        designs = []
        for pieces, where in self.scope.groups:
            rows = heavy[:, where]
            designs.append(Design.over(pieces.supports, rows, np.ones(rows.shape), rows.shape[1]))
        measure, tried = self.scope.measure, self.twists.tried()
        every = np.broadcast_to(tried, (len(nodes), *tried.shape))
        weakest = np.argsort(sum(d.value(every) for d in designs), axis=1)[:, :STARTS]
        found = descended(designs, self.scope.task, tried[weakest])[0]
        supports = np.concatenate([d.supports(found) for d in designs], axis=2)
        return np.asarray(np.min(measure.combined(supports, 2), axis=1))

    def _roots(self, node: Node) -> tuple[int, ...]:
        """Return the whole cells that a node's cells are parts of; where contacts are exchanged, these cells."""
        if self.exchange is not None:
            return node.cells
        return tuple(p.whole(cell) for cell, (p, _) in zip(node.cells, self.scope.group_of, strict=True))

    def _spots(self, node: Node, drawn: bool) -> list[Spot]:
        """Return each contact at its heaviest row, or at one drawn with the design as probabilities."""
        spots = []
        for slot, (pieces, _) in enumerate(self.scope.group_of):
            share = np.maximum(node.design[slot], 0.0)
            chosen = self._rng.choice(len(share), p=share / np.sum(share)) if drawn else np.argmax(share)
            row = int(node.rows[slot][chosen])
            point, normal = pieces.supports.points[row], pieces.supports.normals[row]
            spot = Spot(self._reach_of[slot], self.tree.surface(slot, node.cells[slot], point, normal), point, normal)
            if not spot.surface.rough:
                spot = spot.moved(np.zeros(point.size - 1))  # a disc's row may be beyond its rim
            spots.append(spot)
        return spots

    def _offer(self, spots: Sequence[Spot], value: float) -> bool:
        """Remember a grasp, and return whether it is as good as it seemed; directions in which it is not are learnt."""
        weaker = self.best.offer(spots, value)
        if weaker is None:
            return True
        if len(weaker):
            self.climber.learn(weaker)
            self.twists.remember(weaker)
        return False
