"""Certificate of a global bound: JSON data from which plain arithmetic recomputes it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.global_bound.cells.cell import IntArray
from nlpgrasp.global_bound.contact_cells import NONE, ContactCells
from nlpgrasp.global_bound.dual_weights import DualWeights
from nlpgrasp.global_bound.node_tree import NodeTree
from nlpgrasp.global_bound.scope import BoundScope

TURN_DIGITS = 9  # to which motions are the same


def certificate(search: NodeTree) -> tuple[float, Json]:
    """Return the bound that follows from a recorded search, and the record.

    The bound is the largest of the leaves', each computed from its mixture as it is written.

    Returns
    -------
    upper : float
        0 where no node is left.
    data : mapping
        As of docs/how_close.md: ``origin`` (metres), ``groups`` of contacts with the cells that they may be in,
        ``directions``, ``mixtures``, ``motions``, ``splits``, ``twins`` and ``leaves``.
    """
    tree = search.bounding.recorded(search)
    bounding, scope, leaves = tree.bounding, tree.scope, tree.leaves
    bounds, motions = bounding.recomputed(leaves), _Motions(scope)
    used, mixture = np.unique(leaves.mixtures, return_inverse=True)
    mixtures, number = _deduplicate([bounding.mixtures[i].written() for i in used.tolist()])
    directions = np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *(own.numbers for own in mixtures)]))
    data = {
        "origin": scope.origin.tolist(),
        "complete": tree.complete,
        "groups": [_identical_contacts(pieces, _cut_cells(tree, own)) for pieces, own in scope.groups],
        "directions": bounding.twists[directions].tolist(),
        "mixtures": [[np.searchsorted(directions, own.numbers).tolist(), own.weights.tolist()] for own in mixtures],
        "motions": motions.made,
        "splits": [[*split] for some in tree.splits for split in zip(*(a.tolist() for a in some), strict=True)],
        "twins": [[list(c), motions.number(t.forward, t.back), list(t.node)] for c, t in tree.twins.items()],
        "leaves": [
            [*leaf] for leaf in zip(leaves.cells.tolist(), number[mixture].tolist(), bounds.tolist(), strict=True)
        ],
    }
    return float(np.max(bounds, initial=0.0)), data


def _deduplicate(mixtures: Sequence[DualWeights]) -> tuple[list[DualWeights], IntArray]:
    """Return some dual weights without duplicates, and the index of each among these."""
    keys = [(own.numbers.tobytes(), own.weights.tobytes()) for own in mixtures]
    once = dict(zip(keys, mixtures, strict=True))
    places = {key: i for i, key in enumerate(once)}
    return list(once.values()), np.array([places[key] for key in keys], dtype=np.int64)


def _cut_cells(tree: NodeTree, group: slice) -> IntArray:
    """Return the numbers of the split cells of identical contacts, parents before children."""
    found = [np.zeros(0, dtype=np.int64)]
    for nodes, slots in tree.splits:
        own = np.flatnonzero((slots >= group.start) & (slots < group.stop))
        found.append(nodes[own, slots[own]])
    return np.unique(np.concatenate(found))


def _identical_contacts(pieces: ContactCells, cut: IntArray) -> Json:
    """Return identical contacts with their cells: the first ones, and how some were split."""
    parts = [[None if part == NONE else part for part in both] for both in pieces.child_numbers(cut).tolist()]
    return {
        "contacts": list(pieces.slots),
        "turned": pieces.turned,
        "roots": [[i, pieces.cell(i).to_dict() if len(cut) else pieces.cell(i).whole_data()] for i in pieces.roots],
        "cuts": [[i, pieces.cell(i).cut(), *both] for i, both in zip(cut.tolist(), parts, strict=True)],
    }


class _Motions:
    """Numbered set of rigid motions and reflections."""

    def __init__(self, scope: BoundScope) -> None:
        space = len(scope.origin)
        one = np.eye(space), np.zeros(space)
        self._of = {NONE: one} | {i: (s.rotation, s.translation) for i, s in enumerate(scope.symmetries)}
        self._size = scope.problem.body.size
        self._known: dict[tuple[int, int], int] = {}
        self._numbers: dict[bytes, int] = {}
        self.made: list[Json] = []

    def number(self, forward: int, back: int) -> int:
        """Return the number of a motion: forward by one symmetry and back by another."""
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
