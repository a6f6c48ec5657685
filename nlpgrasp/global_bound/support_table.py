"""Support tables over the cells of many nodes, curved cells by adaptive subdivision.

A table holds ``s^p`` of every contact at the rows of its cell, along the directions of each node: linear programs for
dual weights choose among these rows, and bounds follow from the largest weighted sums. Over flat cells the rows attain
them; over curved cells ``mixed_supports`` bounds what lies between.

Between the corners of a part of a curved cell the work z of a contact is off a linear interpolation of theirs by at
most Z, and off any corner's by at most X (``cells.cell.Patches``). ``s^p`` is convex in z, and steep by at most
``p M^(p-1) L`` where no support exceeds M, with L the length of the largest force of one unit. So over a part

    s^p  <=  max over corners of  min(s^p + p (s + L X)^(p-1) L Z, (s + L X)^p) .

Z falls with the square of a part's size: parts that could exceed the largest support met by more than a tolerance are
quartered. Optimal dual weights make the largest supports as even as they can, so the parts that matter may be all of a
cell: the tolerance falls with the square of the cell's size, and their number stays the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.global_bound.cell_supports import CurvedParts, Supports
from nlpgrasp.global_bound.cells.cell import CurvedFace, IntArray
from nlpgrasp.global_bound.contact_cells import ContactCells

ENOUGH, COARSE = 3e-3, 0.1  # relative tolerance: at least; for cells as large as the first ones
ROUNDS = 3  # subdivisions, at most
BLOCK = 256  # parts subdivided at a time, to fit the processor's cache
ARITHMETIC_MARGIN = 0.3  # share of the tolerance kept for other arithmetic of the same accuracy (``verify.bound``)
FEW = 8  # rows per cell up to which linear programs use all
ROUNDING_MARGIN = 1e-9  # relative, for rounding in a bound


class SupportTable:
    """Support table of several nodes: powers by slot, row of its cell, and direction.

    Parameters
    ----------
    groups : sequence of (ContactCells, slice)
        And the slots of each.
    cells : (b, k) array
        Of each node.
    twists : (b, j, d) array
    """

    def __init__(self, groups: Sequence[tuple[ContactCells, slice]], cells: IntArray, twists: FloatArray) -> None:
        self._measure = groups[0][0].supports.measure
        self._parts = [GroupTable.powers_of(pieces, cells[:, where], twists) for pieces, where in groups]
        self.rows = np.zeros((0, 0, 0), dtype=np.int64)
        self.chosen = np.zeros((0, 0, 0, 0))

    def maxima(self, weights: FloatArray | None) -> FloatArray:
        """Return the largest mixed power over the rows of each slot, (b, k); of each direction, (b, k, j), for None."""
        if weights is None:
            return np.concatenate([part.along() for part in self._parts], axis=1)
        return np.concatenate([part.maxima(weights) for part in self._parts], axis=1)

    def bounds(self, weights: FloatArray) -> FloatArray:
        """Return the nodes' bounds by dual weights, (b,), with a margin for rounding."""
        power = self._measure.power
        return np.asarray(np.sum(self.maxima(weights), axis=1) ** (1.0 / power) * (1.0 + ROUNDING_MARGIN))

    def tighten(self, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return bounds and mixtures; one direction alone where the budget's own sum along it is better."""
        bounds, measure = self.bounds(weights), self._measure
        if measure.exact:
            return bounds, weights
        single = measure.combined(self.maxima(None) ** (1.0 / measure.power), 1) * (1.0 + ROUNDING_MARGIN)
        best = np.argmin(single, axis=1)
        least = single[np.arange(len(best)), best]
        alone = np.eye(weights.shape[1])[best]
        return np.minimum(bounds, least), np.where((least < bounds)[:, None], alone, weights)

    def choose(self, weights: FloatArray | None) -> None:
        """Choose the rows that mixtures see: all of few, else the largest along each direction and under a mixture."""
        most = max(part.powers.shape[1] for part in self._parts)
        rows, tables = [], []
        for part in self._parts:
            once, its = part.largest(weights, most)
            chosen, powers = once[part.back], its[part.back]
            again = np.diff(chosen, axis=2, prepend=-1) == 0  # one row counts once: no designs spread over copies
            rows.append(chosen)
            tables.append(np.where(again[..., None], 0.0, powers))
        self.rows, self.chosen = (np.concatenate(_pad_rows(parts), axis=1) for parts in (rows, tables))


def _pad_rows(parts: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Return arrays (b, s, m, ...) with as many rows each, zeros in place of rows."""
    most = max(part.shape[2] for part in parts)
    return [np.pad(part, [(0, 0), (0, 0), (0, most - part.shape[2])] + [(0, 0)] * (part.ndim - 3)) for part in parts]


@dataclass(frozen=True)
class GroupTable:
    """Support table of identical contacts over the cells of nodes, without duplicate pairs of node and cell.

    Parameters
    ----------
    pieces : ContactCells
    cells : (c,) array
        Of each pair.
    rows : (c, m) array
        Of each pair's cell.
    twists : (c, j, d) array
    powers : (c, m, j) array
    owner : (c,) array
        The node of each pair.
    back : (b, s) array
        The pair of each node and slot.
    """

    pieces: ContactCells
    cells: IntArray
    rows: IntArray
    twists: FloatArray
    powers: FloatArray
    owner: IntArray
    back: IntArray

    @classmethod
    def powers_of(cls, pieces: ContactCells, cells: IntArray, twists: FloatArray) -> GroupTable:
        """Return the powers over cells (b, s) along each node's twists (b, j, d)."""
        pairs = np.arange(len(cells))[:, None] * len(pieces.cells) + cells
        once, back = np.unique(pairs, return_inverse=True)
        owner, own = np.divmod(once, len(pieces.cells))
        rows = pieces.supports.rows_of(own)
        powers = pieces.supports.powers(rows, twists[owner])
        return cls(pieces, own, rows, twists[owner], powers, owner, back.reshape(cells.shape))

    def mixed(self, weights: FloatArray) -> FloatArray:
        """Return powers under each node's mixture (b, j), by pair and row."""
        return np.asarray((self.powers @ weights[self.owner][:, :, None])[:, :, 0])

    def largest(self, weights: FloatArray | None, most: int) -> tuple[IntArray, FloatArray]:
        """Return the rows that mixtures see, sorted, and their powers: (c, m) and (c, m, j)."""
        c, m, _ = self.powers.shape
        if most <= FEW:
            where = np.broadcast_to(np.minimum(np.arange(most), m - 1), (c, most))
        else:
            mixed = np.mean(self.powers, axis=2) if weights is None else self.mixed(weights)
            along = np.argmax(self.powers, axis=1)
            where = np.sort(np.concatenate([along, np.argmax(mixed, axis=1)[:, None]], axis=1), axis=1)
        rows = np.take_along_axis(self.rows, where, axis=1)
        return rows, np.take_along_axis(self.powers, where[..., None], axis=1)

    def maxima(self, weights: FloatArray) -> FloatArray:
        """Return upper bounds under each node's dual weights, (b, s)."""
        supports = self.pieces.supports
        if supports.bent:
            found = mixed_supports(supports, self.cells, self.powers, self.twists, weights[self.owner])
            return np.asarray(found[self.back])
        return np.asarray(np.max(self.mixed(weights), axis=1)[self.back])

    def along(self) -> FloatArray:
        """Return upper bounds along each direction alone, (b, s, j)."""
        return single_supports(self.pieces.supports, self.cells, self.powers, self.twists)[self.back]


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
    look = _SupportInterval(
        supports, np.max(mixed, axis=1), excess_tolerance(supports, cells), *_weighted_directions(twists, weights)
    )
    for patches, parts, rows, bends, owner in _parts_by_face(supports, cells):
        more = excess_inside_parts(supports, bends, largest[owner], speed[owner], turning[owner])
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
    more = excess_inside_parts(supports, bends, largest, *supports.speeds(cells, twists))
    return np.asarray((most + more) * (1.0 + ARITHMETIC_MARGIN * excess_tolerance(supports, cells))[:, None])


def excess_tolerance(supports: Supports, cells: IntArray) -> FloatArray:
    """Return the accepted relative excess over the largest support met, (c,)."""
    radii = supports.radii(cells)
    return np.asarray(np.maximum(ENOUGH, COARSE * (radii / max(supports.widest, 1e-300)) ** 2))


def excess_inside_parts(
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


def _weighted_directions(twists: FloatArray, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the directions with weights, (b, j, d), padded to the same number, and the weights, (b, j)."""
    most = int(np.max(np.count_nonzero(weights, axis=1)))
    if most == weights.shape[1]:
        return twists, weights
    used = np.argpartition(-weights, most, axis=1)[:, :most]
    return np.take_along_axis(twists, used[..., None], axis=1), np.take_along_axis(weights, used, axis=1)


def _parts_by_face(
    supports: Supports, cells: IntArray
) -> list[tuple[CurvedFace, FloatArray, IntArray, FloatArray, IntArray]]:
    """Return the parts of cells by kind of face: patches, corners (n, c, q), rows (n, c), bends, and cells."""
    kinds: dict[tuple[int, int], list[tuple[CurvedParts, int]]] = {}
    for i, cell in enumerate(cells.tolist()):
        for one in supports.curved[cell]:
            kinds.setdefault((id(one.patches), one.rows.shape[1]), []).append((one, i))
    found = []
    for some in kinds.values():
        parts, rows, bends = (np.concatenate([getattr(b, n) for b, _ in some]) for n in ("parts", "rows", "bends"))
        owner = np.repeat([i for _, i in some], [len(b.parts) for b, _ in some])
        found.append((some[0][0].patches, parts, rows, bends, owner))
    return found


class _SupportInterval:
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

    def at(self, patches: CurvedFace, parts: FloatArray, owner: IntArray, upper: FloatArray) -> None:
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
        self, patches: CurvedFace, parts: FloatArray, owner: IntArray
    ) -> tuple[FloatArray, IntArray, FloatArray]:
        """Return the quarters (n r, c, q) of parts (n, c, q), their cells, and upper bounds on them, (n r,)."""
        vertices, into = patches.subdivide(parts)
        n, v, q = vertices.shape
        supports, weights = self._supports, self._weights[owner][:, None]
        points, normals = (x.reshape(n, v, 3) for x in patches.contacts(vertices.reshape(n * v, q)))
        powers, speed, turning = supports.at(points, normals, self._twists[owner])
        supports.looked += powers.size
        np.maximum.at(self._met, owner, np.max(np.sum(powers * weights, axis=2), axis=1))
        quarters = vertices[:, into].reshape(-1, into.shape[1], q)
        bends = patches.bends(quarters).reshape(n, len(into), 1, 2, 3)
        largest = powers ** (1.0 / supports.measure.power)
        more = excess_inside_parts(supports, bends, largest[:, into], speed[:, into], turning[:, None, None])
        upper = np.sum((powers[:, into] + more) * weights[:, None], axis=3)
        return quarters, np.repeat(owner, len(into)), np.max(upper, axis=2).ravel()

    def result(self) -> FloatArray:
        """Return the upper bounds, (c,), with a margin for rounding."""
        return np.asarray(np.maximum(self._upper, self._met) * (1.0 + ARITHMETIC_MARGIN * self._enough))
