"""Branch and bound over all placements of a problem's contacts: an upper bound on mu, closer node by node."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from nlpgrasp.best.bound.weakest import normalised
from nlpgrasp.best.pool.certificate import pool_certificate
from nlpgrasp.best.pool.tree import PoolTree
from nlpgrasp.best.scope.scope import scope_of
from nlpgrasp.best.tree.certificate import certificate
from nlpgrasp.best.tree.nodes import Node
from nlpgrasp.best.trees import tree_of
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.solution.measures.global_bound import GlobalBound

SHARE = 0.8  # of a gap asked for, that the tree closes: recorded leaves and their rounding take the rest
AS_CLOSE = 0.1  # relative: how far the bound of a whole mesh may be above that of its parts


class BranchAndBound:
    """A tree of nodes with one cell of the surface for each contact, each bounded; the loosest are cut first.

    Parameters
    ----------
    problem : GraspProblem
    gap : float
        Relative, between the bound and the best grasp known, at which to stop.

    Attributes
    ----------
    known : float
        Certified quality of the best grasp known.

    Raises
    ------
    InputError
        On a problem that the bound does not cover.
    """

    def __init__(self, problem: GraspProblem, gap: float) -> None:
        self.scope, self.gap, self.known = scope_of(problem), gap, 0.0
        self._tree = tree_of(self.scope)
        self._whole: tuple[float, Json] | None = None  # the certificate of a whole mesh
        self._begun = False
        self._latest: list[Node] = []

    @property
    def nodes(self) -> int:
        """How many nodes there were."""
        return self._tree.nodes

    @property
    def upper(self) -> float:
        """No placement has a larger mu."""
        return max(self._tree.upper, self.known)

    @property
    def closed(self) -> bool:
        """Whether the bound is within the gap of the best grasp known."""
        return self._begun and self.upper <= self.known * (1.0 + self.gap)

    @property
    def searched(self) -> bool:
        """Whether there is nothing more to look at: the gap is closed, or memory is full."""
        return self.closed or (self._begun and (self._tree.top <= self._target or self._tree.full))

    @property
    def _target(self) -> float:
        """The bound at which a node needs no further look."""
        return self.known * (1.0 + SHARE * self.gap)

    def expect(self, mu: float, weak: FloatArray | None = None) -> None:
        """Compare with a grasp of this certified quality, where it is better than the best known.

        Directions (m, d) in which it is weak are tried where designs are.
        """
        self.known = max(self.known, mu)
        if weak is not None and len(weak):
            self._tree.twists.remember(normalised(self.scope.task, weak))

    def grow(self, nodes: int, stopped: Callable[[], bool] = lambda: False) -> None:
        """Cut the loosest nodes until there are so many more, nothing is left to look at, or ``stopped``.

        The whole surface is bounded before, if it was not yet.
        """
        last = self.nodes + nodes
        if not self._begun:
            self._latest, self._begun = self._tree.begin(self._target), True
            if isinstance(self._tree, PoolTree):
                self._whole = pool_certificate(self._tree)
        while self.nodes < last and not self.searched and not stopped():
            self._latest = self._tree.grow(self._target)

    def relaxed_placements(self, count: int) -> list[FloatArray]:
        """Return contact positions (k, space) that the latest nodes' bounds rest on most, the loosest nodes first."""
        found = []
        order = np.argsort(self.scope.slots)
        for node in sorted(self._latest)[:count]:
            rows = node.rows[np.arange(len(node.rows)), np.argmax(node.design, axis=1)] if node.rows.size else []
            each = zip(self.scope.group_of, rows, strict=True) if len(rows) else ()
            points = [pieces.supports.points[row] for (pieces, _), row in each]
            if points:
                found.append(np.stack(points)[order])
        return found

    def certificate(self) -> tuple[float, Json]:
        """Return the bound that follows from what is recorded of the search, and the record (docs/how_close.md)."""
        tree = self._tree
        upper, proof = pool_certificate(tree) if isinstance(tree, PoolTree) else certificate(tree)
        return upper, {"asked": self.gap, **proof}

    def bound(self) -> GlobalBound:
        """Return what holds of all placements so far, with its certificate.

        The certificate of a mesh whose cells were cut holds the order of all its triangles: where that brings the bound
        hardly any closer, it is the one of the whole mesh.
        """
        upper, proof = self.certificate()
        if self._whole is not None and self._whole[0] <= upper * (1.0 + AS_CLOSE):
            upper, proof = self._whole
            return GlobalBound(upper, 1, self.scope.dropped, {"asked": self.gap, **proof})
        return GlobalBound(max(upper, self.upper), self.nodes, self.scope.dropped, proof)
