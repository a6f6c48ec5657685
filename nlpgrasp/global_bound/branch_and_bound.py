"""Branch and bound over all placements of a problem's contacts, for an upper bound on mu."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy

import numpy as np

from nlpgrasp.bodies import Mesh
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.global_bound.certificate import build_certificate
from nlpgrasp.global_bound.node_tree import NodeTree
from nlpgrasp.global_bound.node_weights import MOST_LEAVES, NodeWeightStrategy
from nlpgrasp.global_bound.scope import BoundScope, scope_of
from nlpgrasp.global_bound.shared_weights import SharedWeightStrategy
from nlpgrasp.global_bound.weak_twists import normalise_twists
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.solution.quality_record import GlobalBound

SHARE = 0.8  # share of the requested gap that the tree closes, the rest for recorded leaves and rounding
ROOT_EXCESS = 0.1  # relative, accepted excess of the root bound of a mesh over the bound of its tree


def tree_of(scope: BoundScope) -> NodeTree:
    """Return an empty branch-and-bound tree with the bounding strategy for the kind of body.

    On a mesh, with its many cells, nodes share sets of dual weights.
    """
    if isinstance(scope.problem.body, Mesh):
        return NodeTree(SharedWeightStrategy(scope), 0)
    return NodeTree(NodeWeightStrategy(scope), MOST_LEAVES)


class BranchAndBound:
    """Branch and bound over all placements, with an upper bound on mu and its certificate at any time.

    Parameters
    ----------
    problem : GraspProblem
    gap : float
        Relative gap between bound and incumbent at which to stop.

    Attributes
    ----------
    incumbent : float
        Certified quality of the best feasible grasp known.

    Raises
    ------
    NotCoveredError
        On a problem that the bound does not cover.
    """

    def __init__(self, problem: GraspProblem, gap: float) -> None:
        self.scope, self.gap, self.incumbent = scope_of(problem), gap, 0.0
        self._tree = tree_of(self.scope)
        self._root_certificate: tuple[float, Json] | None = None  # on a mesh
        self._has_roots = False

    @property
    def nodes(self) -> int:
        """Number of nodes bounded so far."""
        return self._tree.nodes

    @property
    def evaluations(self) -> int:
        """Number of support evaluations inside curved cells so far.

        On curved faces they take most of the time.
        """
        return sum(group.supports.evaluations for group in self.scope.contact_cells)

    @property
    def upper(self) -> float:
        """Upper bound on mu over all placements."""
        return max(self._tree.upper, self.incumbent)

    @property
    def is_closed(self) -> bool:
        """Whether the bound exceeds the incumbent's quality by no more than the gap."""
        return self._has_roots and self.upper <= self.incumbent * (1.0 + self.gap)

    @property
    def is_finished(self) -> bool:
        """Whether the gap is closed, or memory is full."""
        return self.is_closed or (self._has_roots and (self._tree.largest_open_bound <= self._target or self._full))

    @property
    def _full(self) -> bool:
        return self._tree.bounding.is_full(len(self._tree.open))

    @property
    def _target(self) -> float:
        """Largest bound with which a node is closed."""
        return self.incumbent * (1.0 + SHARE * self.gap)

    def copy(self) -> BranchAndBound:
        """Return an independent copy of the search, on the same problem."""
        problem = self.scope.problem
        shared = [problem, problem.body, problem.task, *problem.models, *problem.constraints]
        for group in self.scope.contact_cells:
            shared += group.fixed_parts
        return deepcopy(self, {id(part): part for part in shared})

    def update_incumbent(self, mu: float, weak: FloatArray | None = None) -> None:
        """Raise the incumbent's certified quality to mu, and remember the grasp's weak directions (m, d)."""
        self.incumbent = max(self.incumbent, mu)
        if weak is not None and len(weak):
            self._tree.bounding.twists.remember(normalise_twists(self.scope.problem.task, weak))

    def branch(self, count: int, stopped: Callable[[], bool] = lambda: False) -> None:
        """Branch until ``count`` more nodes are bounded, the search is finished, or ``stopped()`` is true.

        The root nodes are bounded first.
        """
        last = self.nodes + count
        if not self._has_roots:
            self._tree.begin(self._target)
            self._has_roots = True
            if isinstance(self.scope.problem.body, Mesh):  # before any split, for ``bound``
                self._root_certificate = build_certificate(self._tree)
        while self.nodes < last and not self.is_finished and not stopped():
            self._tree.branch(self._target)

    def relaxed_placements(self, count: int) -> list[FloatArray]:
        """Return contact positions (k, space) of the latest relaxed placements, the largest bounds first."""
        order, groups = np.argsort(self.scope.contact_of_slot), [group for group, _ in self.scope.group_of]
        loosest = sorted(self._tree.bounding.placements, key=lambda placement: -placement.bound)[:count]
        rows = [zip(groups, placement.heaviest_rows().tolist(), strict=True) for placement in loosest]
        return [np.stack([group.supports.points[row] for group, row in pairs])[order] for pairs in rows]

    def certificate(self) -> tuple[float, Json]:
        """Return the bound that the recorded tree proves, and its certificate as JSON data (docs/how_close.md)."""
        upper, proof = build_certificate(self._tree)
        return upper, {"asked": self.gap, **proof}

    def bound(self) -> GlobalBound:
        """Return the current bound with its certificate.

        The certificate of a mesh whose cells were split holds the order of all triangles. Where splits hardly lower the
        bound, the much smaller certificate of the root is returned.
        """
        upper, proof = self.certificate()
        if self._root_certificate is not None and self._root_certificate[0] <= upper * (1.0 + ROOT_EXCESS):
            upper, proof = self._root_certificate
            return GlobalBound(upper, 1, self.scope.dropped, {"asked": self.gap, **proof})
        return GlobalBound(max(upper, self.upper), self.nodes, self.scope.dropped, proof)
