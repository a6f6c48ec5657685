"""The certificate of a bound: JSON data from which it can be computed again by plain arithmetic."""

from __future__ import annotations

import numpy as np

from nlpgrasp.best.cells.base import IntArray
from nlpgrasp.best.scope.pieces import NONE, Pieces
from nlpgrasp.best.scope.scope import Scope
from nlpgrasp.best.tree.batch import Batch
from nlpgrasp.best.tree.nodes import Cells
from nlpgrasp.best.tree.rounded import rounded
from nlpgrasp.best.tree.tree import BATCH, Tree
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray

TURN_DIGITS = 9  # to which motions are the same


def certificate(tree: Tree) -> tuple[float, Json]:
    """Return the bound that follows from what is recorded of a search, and the record.

    The bound is the largest of the leaves', each computed from its weights as they are written.

    Returns
    -------
    upper : float
        0 where no node is left.
    data : mapping
        As of docs/how_close.md: ``origin`` (metres), ``groups`` of contacts with the cells that they may be in,
        ``directions``, ``motions``, ``splits``, ``twins`` and ``leaves``.
    """
    proof, scope = tree.proof, tree.scope
    cells = list(proof.leaves)
    numbers = np.array([proof.leaves[c][0] for c in cells], dtype=np.int64).reshape(len(cells), -1)
    weights = np.array([rounded(proof.leaves[c][1]) for c in cells]).reshape(numbers.shape)
    bounds = _bounds(tree, cells, numbers, weights)
    used = np.unique(numbers[weights > 0.0])
    short = np.searchsorted(used, numbers)
    motions = _Motions(scope)
    twins = [[list(c), motions.number(t.forward, t.back), list(t.node)] for c, t in proof.twins.items()]
    leaves = []
    for i, own in enumerate(cells):
        there = weights[i] > 0.0
        leaves.append([list(own), short[i, there].tolist(), weights[i, there].tolist(), float(bounds[i])])
    data = {
        "origin": scope.origin.tolist(),
        "complete": not proof.full,
        "groups": [_group(pieces) for pieces in scope.pieces],
        "directions": tree.twists[used].tolist(),
        "motions": motions.made,
        "splits": [[list(own), slot] for own, slot in proof.splits.items()],
        "twins": twins,
        "leaves": leaves,
    }
    return float(np.max(bounds, initial=0.0)), data


def _bounds(tree: Tree, cells: list[Cells], numbers: IntArray, weights: FloatArray) -> FloatArray:
    """Return the bound of every leaf, batch by batch."""
    shares = weights / np.sum(weights, axis=1, keepdims=True)
    found = [np.zeros(0)]
    for i in range(0, len(cells), BATCH):
        part = slice(i, i + BATCH)
        found.append(Batch(tree.scope, cells[part], numbers[part], tree.twists).recomputed(shares[part]))
    return np.concatenate(found)


def _group(pieces: Pieces) -> Json:
    """Return the contacts of some pieces and the cells that they may be in: the first ones, and how they were cut."""
    parts = {cell: [None if part == NONE else part for part in made] for cell, made in pieces.parts.items()}
    return {
        "contacts": list(pieces.slots),
        "turned": pieces.turned,
        "roots": [[root, pieces.cells[root].to_dict()] for root in pieces.roots],
        "cuts": [[cell, pieces.cells[cell].cut(), *made] for cell, made in parts.items()],
    }


class _Motions:
    """Rigid motions and reflections by number, each once."""

    def __init__(self, scope: Scope) -> None:
        space = len(scope.origin)
        one = np.eye(space), np.zeros(space)
        self._of = {NONE: one} | {i: (s.rotation, s.translation) for i, s in enumerate(scope.symmetries)}
        self._size = scope.problem.body.size
        self._known: dict[tuple[int, int], int] = {}
        self._numbers: dict[bytes, int] = {}
        self.made: list[Json] = []

    def number(self, forward: int, back: int) -> int:
        """Return the number of a motion that goes forward by one symmetry and back by another."""
        if (forward, back) not in self._known:
            self._known[forward, back] = self._find(forward, back)
        return self._known[forward, back]

    def _find(self, forward: int, back: int) -> int:
        (R, t), (Q, s) = self._of[forward], self._of[back]
        rotation, translation = Q.T @ R, Q.T @ (t - s)
        whole = np.append(rotation, translation / self._size)
        key = (np.round(whole, TURN_DIGITS) + 0.0).tobytes()
        if key not in self._numbers:
            self._numbers[key] = len(self.made)
            self.made.append({"rotation": rotation.tolist(), "translation": translation.tolist()})
        return self._numbers[key]
