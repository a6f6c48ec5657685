"""Other directions for a node: where contacts that are spread over its cells do least against the task."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.best.bound.twists import Twists
from nlpgrasp.best.bound.weakest import Design, descended, normalised
from nlpgrasp.best.cells.base import IntArray
from nlpgrasp.best.scope.scope import Scope
from nlpgrasp.common.validation import FloatArray

FRESH = 4  # directions that are replaced: one of so many
STARTS = 3  # of the node's own directions that descents begin from, or between, beside the weakest of those tried
ALIKE = 0.999  # cosine of directions that are the same


def renewed(
    scope: Scope, twists: Twists, numbers: IntArray, weights: FloatArray, spread: tuple[IntArray, FloatArray]
) -> IntArray:
    """Return directions of some nodes, the least useful replaced by the weakest of their designs.

    Parameters
    ----------
    scope : Scope
    twists : Twists
        Grows by the new ones.
    numbers, weights : (b, j) arrays
        Of each node's directions.
    spread : pair of (b, k, m) arrays
        Rows, and how much of each contact is there.
    """
    designs = []
    for pieces, where in scope.groups:
        rows, shares = spread[0][:, where], spread[1][:, where]
        b, c, m = rows.shape
        designs.append(Design.over(pieces.supports, rows.reshape(b, c * m), shares.reshape(b, c * m), 3 * c))
    few = numbers.shape[1] // FRESH
    copied = _repeated(twists[numbers], -weights)
    heavy = np.argsort(np.where(copied, 0.0, -weights), axis=1)[:, :STARTS]
    own = twists[np.take_along_axis(numbers, heavy, axis=1)]
    between = normalised(scope.task, own + np.roll(own, 1, axis=1))  # what descents that stay at corners miss
    stuck = np.any(copied & (weights > 0.0), axis=1)[:, None, None]
    begin = np.where(stuck & np.any(between != 0.0, axis=2, keepdims=True), between, own)
    tried = twists.tried()
    every = np.broadcast_to(tried, (len(weights), *tried.shape))
    value = sum(d.value(every) for d in designs)
    weakest = tried[np.argsort(value, axis=1)[:, :few]]
    found, ratios = descended(designs, scope.task, np.concatenate([begin, weakest], axis=1))
    order = np.argsort(np.where(_repeated(found, ratios), np.inf, ratios), axis=1)[:, :few]
    fresh = np.take_along_axis(found, order[..., None], axis=1)
    added = twists.add(fresh.reshape(-1, fresh.shape[2])).reshape(fresh.shape[:2])
    twists.remember(fresh[:, 0])
    result = numbers.copy()
    least = np.where(copied, -1.0, weights)  # copies share the weight of one of them
    np.put_along_axis(result, np.argsort(least, axis=1)[:, :few], added, axis=1)
    return result


def _repeated(twists: FloatArray, ratios: FloatArray) -> NDArray[np.bool_]:
    """Return which directions (b, m, d) are nearly those of others with smaller ratios (b, m)."""
    unit = twists / np.maximum(np.max(np.abs(twists), axis=1, keepdims=True), 1e-300)
    unit /= np.maximum(np.linalg.norm(unit, axis=2, keepdims=True), 1e-300)
    near = unit @ unit.transpose(0, 2, 1) > ALIKE
    first = np.argsort(np.argsort(ratios, axis=1), axis=1)
    return np.asarray(np.any(near & (first[:, None] < first[:, :, None]), axis=2))
