"""Which tree bounds a problem."""

from __future__ import annotations

from nlpgrasp.best.bound.twists import Twists
from nlpgrasp.best.cells.mesh import MeshCell
from nlpgrasp.best.pool.tree import PoolTree
from nlpgrasp.best.scope.scope import Scope
from nlpgrasp.best.tree.tree import Tree


def tree_of(scope: Scope) -> Tree | PoolTree:
    """Return the tree of a problem: one whose nodes share mixtures on a mesh, which has thousands of small cells."""
    first = scope.pieces[0].cells[0]
    if isinstance(first, MeshCell):
        return PoolTree(scope, first.clusters)
    return Tree(scope, Twists(scope.task, scope.problem.body.size))
