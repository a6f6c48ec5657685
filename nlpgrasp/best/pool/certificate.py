"""The certificate of a mesh's bound: a tree grown anew from all mixtures, its leaves in double precision."""

from __future__ import annotations

import numpy as np

from nlpgrasp.best.cells.base import IntArray
from nlpgrasp.best.cells.mesh import MeshCell
from nlpgrasp.best.pool.front import Front, grown
from nlpgrasp.best.pool.pool import Pool
from nlpgrasp.best.pool.tree import PoolTree
from nlpgrasp.best.tree.table import MARGIN
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray

MOST_LEAVES = 40_000


def pool_certificate(tree: PoolTree) -> tuple[float, Json]:
    """Return the bound that follows from what is recorded of a mesh's search, and the record.

    Returns
    -------
    upper : float
    data : mapping
        As of docs/how_close.md; leaves name mixtures by number.
    """
    front, complete = grown(tree.pool, tree.excluded, tree.upper**tree.scope.measure.power, MOST_LEAVES)
    nodes, chosen = front.nodes, tree.pool.bounds(front.nodes)[1]
    used, mixture = np.unique(chosen, return_inverse=True)
    bounds = _bounds(tree.pool, nodes, used, mixture)
    numbers = [tree.pool.mixtures[i][0] for i in used.tolist()]
    directions = np.unique(np.concatenate(numbers))
    short = [np.searchsorted(directions, own).tolist() for own in numbers]
    weights = [tree.pool.mixtures[i][1].tolist() for i in used.tolist()]
    leaves = zip(nodes.tolist(), mixture.tolist(), bounds.tolist(), strict=True)
    pairs = [(own.tolist(), slots.tolist()) for own, slots in front.splits]
    splits = [list(split) for pair in pairs for split in zip(*pair, strict=True)]
    data = {
        "origin": tree.scope.origin.tolist(),
        "complete": complete,
        "groups": _groups(tree, front),
        "directions": tree.twists[directions].tolist(),
        "mixtures": [list(pair) for pair in zip(short, weights, strict=True)],
        "motions": [],
        "splits": splits,
        "twins": [],
        "leaves": [list(leaf) for leaf in leaves],
    }
    return float(np.max(bounds, initial=0.0)), data


def _bounds(pool: Pool, nodes: IntArray, used: IntArray, mixture: IntArray) -> FloatArray:
    """Return the bounds of nodes (n, k), each by one of the mixtures that are used, with a margin for rounding."""
    result = np.empty(len(nodes))
    order = np.argsort(mixture, kind="stable")
    ends = np.searchsorted(mixture[order], np.arange(len(used) + 1))
    for i, number in enumerate(used.tolist()):
        own = order[ends[i] : ends[i + 1]]
        most = pool.largest(*pool.mixtures[number])
        result[own] = np.sum(most[nodes[own] + pool.offsets], axis=1)
    return np.asarray(result ** (1.0 / pool.scope.measure.power) * (1.0 + MARGIN))


def _groups(tree: PoolTree, front: Front) -> list[Json]:
    """Return the contacts that are alike, the whole mesh as their first cell, and how it was cut."""
    clusters, result = tree.pool.clusters, list[Json]()
    none = np.zeros(0, dtype=np.int64)
    cells = np.concatenate([none, *(own[np.arange(len(own)), slots] for own, slots in front.splits)])
    slots = np.concatenate([none, *(slots for _, slots in front.splits)])
    for out, (pieces, where) in zip(tree.excluded, tree.scope.groups, strict=True):
        own = np.unique(cells[(slots >= where.start) & (slots < where.stop)]).tolist()
        parts = [[None if out[2 * cell + i] else 2 * cell + i for i in (0, 1)] for cell in own]
        cuts = [[cell, MeshCell(clusters, cell).cut(), *both] for cell, both in zip(own, parts, strict=True)]
        whole = MeshCell(clusters, 1)
        roots = [[1, whole.to_dict() if own else whole.uncut()]]
        result.append({"contacts": list(pieces.slots), "turned": None, "roots": roots, "cuts": cuts})
    return result
