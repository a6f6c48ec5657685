"""Branch and bound over all placements of a problem's contacts: a decreasing upper bound on mu."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from nlpgrasp.bodies import Mesh
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.global_bound.certificate import certificate
from nlpgrasp.global_bound.node_tree import NodeTree
from nlpgrasp.global_bound.node_weights import MOST_LEAVES, NodeWeightStrategy
from nlpgrasp.global_bound.scope import BoundScope, scope_of
from nlpgrasp.global_bound.shared_weights import SharedWeightStrategy
from nlpgrasp.global_bound.weak_twists import normalise_twists
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.solution.quality_record import GlobalBound

SHARE = 0.8  # share of the requested gap that the tree closes; recorded leaves and rounding take the rest
AS_CLOSE = 0.1  # relative: excess of the bound of a whole mesh over that of its parts that is accepted


def tree_of(scope: BoundScope) -> NodeTree:
    """Return a problem's tree before its first node; on a mesh, with its many cells, nodes share dual weights."""
    if isinstance(scope.problem.body, Mesh):
        return NodeTree(SharedWeightStrategy(scope), 0)
    return NodeTree(NodeWeightStrategy(scope), MOST_LEAVES)


class BranchAndBound:
    """Branch and bound over all placements: an upper bound on mu at any time, with its certificate.

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

    @property
    def nodes(self) -> int:
        """Number of nodes so far."""
        return self._tree.nodes

    @property
    def effort(self) -> int:
        """Supports evaluated inside curved cells so far: most of the time, where faces are curved."""
        return sum(pieces.supports.looked for pieces in self.scope.pieces)

    @property
    def upper(self) -> float:
        """Upper bound on mu over all placements."""
        return max(self._tree.upper, self.known)

    @property
    def is_closed(self) -> bool:
        """Whether the bound is within the gap of the incumbent's quality."""
        return self._begun and self.upper <= self.known * (1.0 + self.gap)

    @property
    def searched(self) -> bool:
        """Whether the search is over: the gap is closed, or memory is full."""
        return self.is_closed or (self._begun and (self._tree.top <= self._target or self._full))

    @property
    def _full(self) -> bool:
        return self._tree.bounding.is_full(len(self._tree.open))

    @property
    def _target(self) -> float:
        """Bound at which a node is closed."""
        return self.known * (1.0 + SHARE * self.gap)

    def update_incumbent(self, mu: float, weak: FloatArray | None = None) -> None:
        """Update the incumbent's certified quality, if this one is better.

        Directions (m, d) in which it is weak are tried where designs are.
        """
        self.known = max(self.known, mu)
        if weak is not None and len(weak):
            self._tree.bounding.twists.remember(normalise_twists(self.scope.task, weak))

    def branch(self, nodes: int, stopped: Callable[[], bool] = lambda: False) -> None:
        """Branch on the loosest nodes until so many more are bounded, the search is over, or ``stopped``.

        The whole surface is bounded before, if it was not yet.
        """
        last = self.nodes + nodes
        if not self._begun:
            self._tree.begin(self._target)
            self._begun = True
            if isinstance(self.scope.problem.body, Mesh):
                self._whole = certificate(self._tree)
        while self.nodes < last and not self.searched and not stopped():
            self._tree.branch(self._target)

    def relaxed_placements(self, count: int) -> list[FloatArray]:
        """Return contact positions (k, space) from the latest relaxed placements, of the loosest nodes first."""
        order, groups = np.argsort(self.scope.slots), self.scope.group_of
        loosest = sorted(self._tree.bounding.placements, key=lambda placement: -placement.bound)[:count]
        rows = [zip(groups, placement.heaviest().tolist(), strict=True) for placement in loosest]
        return [np.stack([pieces.supports.points[row] for (pieces, _), row in each])[order] for each in rows]

    def certificate(self) -> tuple[float, Json]:
        """Return the bound that follows from the recorded search, and the record (docs/how_close.md)."""
        upper, proof = certificate(self._tree)
        return upper, {"asked": self.gap, **proof}

    def bound(self) -> GlobalBound:
        """Return the current bound over all placements, with its certificate.

        The certificate of a mesh whose cells were cut holds the order of all its triangles: where that brings the bound
        hardly any closer, it is the one of the whole mesh.
        """
        upper, proof = self.certificate()
        if self._whole is not None and self._whole[0] <= upper * (1.0 + AS_CLOSE):
            upper, proof = self._whole
            return GlobalBound(upper, 1, self.scope.dropped, {"asked": self.gap, **proof})
        return GlobalBound(max(upper, self.upper), self.nodes, self.scope.dropped, proof)
