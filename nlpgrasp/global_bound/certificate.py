"""Certificate of a global bound: JSON data from which plain arithmetic recomputes the bound."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import IntArray
from nlpgrasp.global_bound.contact_cells import NONE, ContactCells
from nlpgrasp.global_bound.dual_weights import DualWeights
from nlpgrasp.global_bound.node_tree import NodeTree
from nlpgrasp.global_bound.scope import BoundScope

MOTION_DIGITS = 9  # decimal digits in which equal motions agree


def build_certificate(tree: NodeTree) -> tuple[float, Json]:
    """Return the bound that a recorded tree proves, and its certificate as JSON data.

    The bound is the largest bound of the leaves, each computed from its dual weights as recorded.

    Returns
    -------
    upper : float
        0 without leaves.
    data : mapping
        As in docs/how_close.md: ``origin`` (metres), ``groups`` of identical contacts with their cells,
        ``directions``, ``mixtures``, ``motions``, ``splits``, ``twins`` and ``leaves``; ``thresholds`` of the mixtures
        under the shared budget.
    """
    recorded = tree.bounding.certified_tree(tree)
    bounding, scope, leaves = recorded.bounding, recorded.scope, recorded.leaves
    bounds, motions = bounding.recompute_bounds(leaves), _Motions(scope)
    indices, positions = np.unique(leaves.dual_index, return_inverse=True)
    dual_weights, dual_index = _deduplicate([bounding.dual_weights[i].rounded() for i in indices.tolist()])
    directions = np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *(dual.indices for dual in dual_weights)]))
    data = {
        "origin": scope.origin.tolist(),
        "complete": recorded.complete,
        "groups": [_group_data(group, _split_cells(recorded, slots)) for group, slots in scope.groups],
        "directions": bounding.twists[directions].tolist(),
        "mixtures": [
            [np.searchsorted(directions, dual.indices).tolist(), dual.weights.tolist()] for dual in dual_weights
        ],
        "motions": motions.data,
        "splits": [[*split] for batch in recorded.splits for split in zip(*(a.tolist() for a in batch), strict=True)],
        "twins": [[list(c), motions.index_of(t.forward, t.back), list(t.node)] for c, t in recorded.copies.items()],
        "leaves": [
            [*leaf] for leaf in zip(leaves.cells.tolist(), dual_index[positions].tolist(), bounds.tolist(), strict=True)
        ],
    }
    if scope.rule.takes_largest:
        data["thresholds"] = [dual.threshold for dual in dual_weights]
    return float(np.max(bounds, initial=0.0)), data


def _deduplicate(dual_weights: Sequence[DualWeights]) -> tuple[list[DualWeights], IntArray]:
    """Return the distinct sets of dual weights, and the index of each given set among them."""
    keys = [(dual.indices.tobytes(), dual.weights.tobytes(), dual.threshold) for dual in dual_weights]
    distinct = dict(zip(keys, dual_weights, strict=True))
    positions = {key: i for i, key in enumerate(distinct)}
    return list(distinct.values()), np.array([positions[key] for key in keys], dtype=np.int64)


def _split_cells(tree: NodeTree, group_slots: slice) -> IntArray:
    """Return the indices of the split cells of a group, parents before children."""
    split_cells: list[IntArray] = [np.zeros(0, dtype=np.int64)]
    for nodes, slots in tree.splits:
        selected = np.flatnonzero((slots >= group_slots.start) & (slots < group_slots.stop))
        split_cells.append(nodes[selected, slots[selected]])
    return np.unique(np.concatenate(split_cells))


def _group_data(group: ContactCells, split_cells: IntArray) -> Json:
    """Return the JSON data of a group of identical contacts: root cells and splits."""
    roots = [(i, group.cell(i)) for i in group.roots]
    pairs = group.child_indices(split_cells).tolist()
    children = [[None if child == NONE else child for child in pair] for pair in pairs]
    return {
        "contacts": list(group.contact_indices),
        "turned": group.rotated_to,
        "roots": [[i, root.to_dict() if len(split_cells) else root.unsplit_data()] for i, root in roots],
        "cuts": [[i, group.cell(i).cut(), *pair] for i, pair in zip(split_cells.tolist(), children, strict=True)],
    }


class _Motions:
    """Indexed list of the rigid motions and reflections in a certificate."""

    def __init__(self, scope: BoundScope) -> None:
        space = len(scope.origin)
        identity = np.eye(space), np.zeros(space)
        self._motions = {NONE: identity} | {i: (s.rotation, s.translation) for i, s in enumerate(scope.symmetries)}
        self._size = scope.problem.body.size
        self._index_of_pair: dict[tuple[int, int], int] = {}
        self._index_of_motion: dict[bytes, int] = {}
        self.data: list[Json] = []

    def index_of(self, forward: int, back: int) -> int:
        """Return the index of a composed motion: one symmetry followed by the inverse of another."""
        if (forward, back) not in self._index_of_pair:
            self._index_of_pair[forward, back] = self._find(forward, back)
        return self._index_of_pair[forward, back]

    def _find(self, forward: int, back: int) -> int:
        (R, t), (Q, s) = self._motions[forward], self._motions[back]
        rotation, translation = Q.T @ R, Q.T @ (t - s)
        values = np.append(rotation, translation / self._size)
        key = (np.round(values, MOTION_DIGITS) + 0.0).tobytes()
        if key not in self._index_of_motion:
            self._index_of_motion[key] = len(self.data)
            self.data.append({"rotation": rotation.tolist(), "translation": translation.tolist()})
        return self._index_of_motion[key]
