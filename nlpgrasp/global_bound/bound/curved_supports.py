"""Largest weighted support over curved cells, by adaptive subdivision.

Between the corners of a part the work z of a contact is off a linear interpolation of theirs by at most Z, and off any
corner's by at most X (``cells.base.Patches``). ``s^p`` is convex in z, and steep by at most ``p M^(p-1) L`` where no
support exceeds M, with L the length of the largest force of one unit. So over a part

    s^p  <=  max over corners of  min(s^p + p (s + L X)^(p-1) L Z, (s + L X)^p) .

Z falls with the square of a part's size: quarters are looked at wherever a part could exceed the largest support met by
more than a tolerance. Mixtures make their largest supports as even as they can, so the parts that matter may be all of
a cell: the tolerance falls with the square of the cell's size, and their number stays the same.
"""

from __future__ import annotations

import numpy as np

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.global_bound.bound.supports import Between, Supports
from nlpgrasp.global_bound.cells.base import IntArray, Patches

ENOUGH, COARSE = 3e-3, 0.1  # relative tolerance: at least; for cells as large as the first ones
ROUNDS = 3  # subdivisions
BLOCK = 256  # parts subdivided at a time, to fit the processor's cache
MARGIN = 0.3  # share of the tolerance kept for other arithmetic of the same accuracy (``verify.bound``)


def mixed_supports(
    supports: Supports, cells: IntArray, powers: FloatArray, twists: FloatArray, weights: FloatArray
) -> FloatArray:
    """Return upper bounds on the weighted supports of contacts in some cells, (c,).

    Parameters
    ----------
    supports : Supports
    cells : (c,) array
        Numbers of cells.
    powers : (c, m, j) array
        ``s^p`` of each cell's rows along its directions.
    twists : (c, j, d) array
    weights : (c, j) array
        Of each cell's mixture.
    """
    mixed = (powers @ weights[:, :, None])[:, :, 0]
    largest = np.max(powers, axis=1) ** (1.0 / supports.measure.power)
    speed, turning = supports.speeds(cells, twists)
    look = _Look(supports, np.max(mixed, axis=1), tolerance(supports, cells), *_used(twists, weights))
    for patches, parts, rows, bends, owner in _gathered(supports, cells):
        more = between(supports, bends, largest[owner], speed[owner], turning[owner])
        upper = np.max(mixed[owner[:, None], rows], axis=1) + np.sum(weights[owner] * more, axis=1)
        look.at(patches, parts, owner, upper)
    return look.result()


def single_supports(supports: Supports, cells: IntArray, powers: FloatArray, twists: FloatArray) -> FloatArray:
    """Return upper bounds on the support in some cells along each direction, (c, j); see ``mixed_supports``."""
    most = np.max(powers, axis=1)
    own = [supports.curved[c] for c in cells.tolist()]
    if not any(own):
        return np.asarray(most)
    bends = np.stack([np.max([b.most for b in some], axis=0) if some else np.zeros((2, 3)) for some in own])
    largest = most ** (1.0 / supports.measure.power)
    more = between(supports, bends, largest, *supports.speeds(cells, twists))
    return np.asarray((most + more) * (1.0 + MARGIN * tolerance(supports, cells))[:, None])


def tolerance(supports: Supports, cells: IntArray) -> FloatArray:
    """Return the accepted relative excess over the largest support met, (c,)."""
    radii = supports.radii(cells)
    return np.asarray(np.maximum(ENOUGH, COARSE * (radii / max(supports.widest, 1e-300)) ** 2))


def between(
    supports: Supports, bends: FloatArray, largest: FloatArray, speed: FloatArray, turning: FloatArray
) -> FloatArray:
    """Return a bound on the excess of ``s^p`` inside parts over corners whose s and ``|v|`` are no larger than these.

    Parameters
    ----------
    supports : Supports
    bends : (..., 2, 3) array
        Of each part.
    largest, speed, turning : (..., j) arrays
        s, ``|v|`` and ``|tau|`` along each direction.
    """
    p, L = supports.measure.power, supports.steepness
    linear = bends[..., 1] + supports.turns * bends[..., 2]
    off, apart = (bends[..., i, 0, None] * speed + linear[..., i, None] * turning for i in (0, 1))
    most = largest + L * apart
    return np.asarray(np.minimum(p * most ** (p - 1.0) * L * off, most**p - largest**p))


def _used(twists: FloatArray, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the directions with weights, (b, j, d), padded to the same number, and the weights, (b, j)."""
    most = int(np.max(np.count_nonzero(weights, axis=1)))
    if most == weights.shape[1]:
        return twists, weights
    used = np.argpartition(-weights, most, axis=1)[:, :most]
    return np.take_along_axis(twists, used[..., None], axis=1), np.take_along_axis(weights, used, axis=1)


def _gathered(supports: Supports, cells: IntArray) -> list[tuple[Patches, FloatArray, IntArray, FloatArray, IntArray]]:
    """Return the parts of cells by kind of face: patches, corners (n, c, q), rows (n, c), bends, and cells."""
    kinds: dict[tuple[int, int], list[tuple[Between, int]]] = {}
    for i, cell in enumerate(cells.tolist()):
        for one in supports.curved[cell]:
            kinds.setdefault((id(one.patches), one.rows.shape[1]), []).append((one, i))
    found = []
    for some in kinds.values():
        parts, rows, bends = (np.concatenate([getattr(b, n) for b, _ in some]) for n in ("parts", "rows", "bends"))
        owner = np.repeat([i for _, i in some], [len(b.parts) for b, _ in some])
        found.append((some[0][0].patches, parts, rows, bends, owner))
    return found


class _Look:
    """Lower and upper bounds on the largest weighted support over each cell.

    Parameters
    ----------
    supports : Supports
    met : (c,) array
        The largest of the rows.
    enough : (c,) array
        Relative tolerance.
    twists : (c, j, d) array
    weights : (c, j) array
    """

    def __init__(
        self, supports: Supports, met: FloatArray, enough: FloatArray, twists: FloatArray, weights: FloatArray
    ) -> None:
        self._supports, self._enough, self._twists, self._weights = supports, enough, twists, weights
        self._met, self._upper = met, met.copy()

    def at(self, patches: Patches, parts: FloatArray, owner: IntArray, upper: FloatArray) -> None:
        """Bound parts (n, c, q) of some cells, and subdivide those that may hold the maximum."""
        for _ in range(ROUNDS):
            open_ = upper > (1.0 + self._enough[owner]) * self._met[owner]
            np.maximum.at(self._upper, owner[~open_], upper[~open_])
            if not np.any(open_):
                return
            blocks = np.array_split(np.flatnonzero(open_), -(-np.count_nonzero(open_) // BLOCK))
            found = [self._quarters(patches, parts[block], owner[block]) for block in blocks]
            parts, owner, upper = (np.concatenate([one[i] for one in found]) for i in range(3))
        np.maximum.at(self._upper, owner, upper)

    def _quarters(
        self, patches: Patches, parts: FloatArray, owner: IntArray
    ) -> tuple[FloatArray, IntArray, FloatArray]:
        """Return the quarters (n r, c, q) of parts (n, c, q), their cells, and upper bounds on them, (n r,)."""
        vertices, into = patches.finer(parts)
        n, v, q = vertices.shape
        supports, weights = self._supports, self._weights[owner][:, None]
        points, normals = (x.reshape(n, v, 3) for x in patches.contacts(vertices.reshape(n * v, q)))
        powers, speed, turning = supports.at(points, normals, self._twists[owner])
        supports.looked += powers.size
        np.maximum.at(self._met, owner, np.max(np.sum(powers * weights, axis=2), axis=1))
        quarters = vertices[:, into].reshape(-1, into.shape[1], q)
        bends = patches.bends(quarters).reshape(n, len(into), 1, 2, 3)
        largest = powers ** (1.0 / supports.measure.power)
        more = between(supports, bends, largest[:, into], speed[:, into], turning[:, None, None])
        upper = np.sum((powers[:, into] + more) * weights[:, None], axis=3)
        return quarters, np.repeat(owner, len(into)), np.max(upper, axis=2).ravel()

    def result(self) -> FloatArray:
        """Return the upper bounds, (c,), with a margin for rounding."""
        return np.asarray(np.maximum(self._upper, self._met) * (1.0 + MARGIN * self._enough))
