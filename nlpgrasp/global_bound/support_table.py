"""Support tables over the cells of many nodes, with adaptive subdivision of curved cells.

A table holds ``s^p`` of every contact at the rows of its cell, along the directions of each node. Linear programs for
dual weights use a selection of these rows, and bounds follow from the largest weighted sums. Over flat cells a row is
the maximum; over curved cells ``weighted_supports`` bounds the increase between rows.

Inside a part of a curved cell the work z of a contact deviates from a linear interpolation of the corners' by at most
Z, and from any corner's by at most X (``CurvedSurface.deviations``). ``s^p`` is convex in z, with Lipschitz constant
``p M^(p-1) L`` where no support exceeds M, with L the length of the largest force of one unit. So over a part

    s^p  <=  max over corners of  min(s^p + p (s + L X)^(p-1) L Z, (s + L X)^p) ,

where ``L Z`` and ``L X`` are sums over the force and moment parts of z, each with its own L.

Z falls with the square of a part's size: parts that could exceed the largest known support by more than a tolerance are
quartered. Optimal dual weights level the largest supports, so that all parts of a cell may need it: the tolerance falls
with the square of the cell's size, and the number of quartered parts stays the same.

Under the shared budget excesses ``(s - theta)_+`` over the node's threshold replace ``s^p`` (``CombinationRule``). They
are convex in z as well, and change by no more than s.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from nlpgrasp.common.validation import FloatArray, IntArray
from nlpgrasp.global_bound.cell_supports import Supports
from nlpgrasp.global_bound.cells.cell import CurvedParts, CurvedSurface
from nlpgrasp.global_bound.contact_cells import ContactCells

ENOUGH, COARSE = 3e-3, 0.1  # relative tolerance, least and for the largest cell
ROUNDS = 3  # largest number of subdivisions
BLOCK = 256  # parts subdivided at a time, to fit the processor's cache
ARITHMETIC_MARGIN = 0.3  # fraction of the tolerance left for independent arithmetic (``verify.bound``)
FEW = 8  # largest number of rows per cell that linear programs use without selection
ROUNDING_MARGIN = 1e-9  # relative margin for rounding in a bound
THRESHOLD_SHARE = 0.25  # share of the threshold that counts, with one contact's support, as the scale of tolerances


class SupportTable:
    """Table of support powers ``s^p`` by node, contact, representative contact and direction.

    Parameters
    ----------
    groups : sequence of (ContactCells, slice)
        Groups of identical contacts, and their slots.
    cells : (b, k) array
        Cells of each node.
    twists : (b, j, d) array
    thresholds : (b,) array
        Zero but under the shared budget.

    Attributes
    ----------
    rows : (b, k, m) array
        Representative contacts of a linear program, sorted; empty before ``select_rows``.
    excesses : (b, k, m, j) array
        Their excesses over the thresholds, or ``s^p`` for rules without thresholds.
    """

    def __init__(
        self,
        groups: Sequence[tuple[ContactCells, slice]],
        cells: IntArray,
        twists: FloatArray,
        thresholds: FloatArray,
    ) -> None:
        self._rule, self._thresholds = groups[0][0].supports.rule, thresholds
        self._parts = [GroupTable.over_cells(group, cells[:, slots], twists, thresholds) for group, slots in groups]
        self.rows = np.zeros((0, 0, 0), dtype=np.int64)
        self.excesses = np.zeros((0, 0, 0, 0))

    def upper_bounds(self, weights: FloatArray | None) -> FloatArray:
        """Return upper bounds (b, k) on the contacts' supports weighted by dual weights (b, j).

        Without weights: upper bounds (b, k, j) on the supports along each single direction.
        """
        if weights is None:
            return np.concatenate([part.single_upper_bounds() for part in self._parts], axis=1)
        return np.concatenate([part.upper_bounds(weights) for part in self._parts], axis=1)

    def bounds(self, weights: FloatArray) -> FloatArray:
        """Return the nodes' bounds (b,) on mu by dual weights (b, j), with a margin for rounding."""
        total = np.sum(self.upper_bounds(weights), axis=1) ** (1.0 / self._rule.power)
        return np.asarray((self._thresholds + total) * (1.0 + ROUNDING_MARGIN))

    def tighten(self, weights: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the nodes' bounds (b,) on mu, with the dual weights (b, j) and thresholds (b,) that prove them.

        Under the shared budget the largest support along any single direction is a bound too. Where the least of these
        is below the bound by the given weights it replaces that, with the direction's unit weight, and with itself as
        the threshold.
        """
        bounds, thresholds = self.bounds(weights), self._thresholds
        if not self._rule.takes_largest:
            return bounds, weights, thresholds
        single = np.max(self.upper_bounds(None), axis=1)
        direction = np.argmin(single, axis=1)
        least = single[np.arange(len(direction)), direction]
        is_lower = least * (1.0 + ROUNDING_MARGIN) < bounds
        unit_weights = np.eye(weights.shape[1])[direction]
        return (
            np.where(is_lower, least * (1.0 + ROUNDING_MARGIN), bounds),
            np.where(is_lower[:, None], unit_weights, weights),
            np.where(is_lower, least, thresholds),
        )

    def select_rows(self, weights: FloatArray | None) -> None:
        """Select the representative contacts of a linear program, and store them in ``rows`` and ``excesses``.

        All representative contacts of a cell are selected if there are few, otherwise those of largest supports.
        """
        max_rows = max(part.powers.shape[1] for part in self._parts)
        rows, excesses = [], []
        for part in self._parts:
            selected, selected_excesses = part.select_rows(weights, max_rows)
            rows_by_slot, excesses_by_slot = selected[part.pair_of], selected_excesses[part.pair_of]
            # rows are sorted, so that copies are neighbours; they count once
            is_copy = np.diff(rows_by_slot, axis=2, prepend=-1) == 0
            rows.append(rows_by_slot)
            excesses.append(np.where(is_copy[..., None], 0.0, excesses_by_slot))
        self.rows, self.excesses = (np.concatenate(_pad_rows(parts), axis=1) for parts in (rows, excesses))


def _pad_rows(parts: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Return arrays (b, s, m, ...) padded with zeros to the same m."""
    max_rows = max(part.shape[2] for part in parts)
    return [
        np.pad(part, [(0, 0), (0, 0), (0, max_rows - part.shape[2])] + [(0, 0)] * (part.ndim - 3)) for part in parts
    ]


@dataclass(frozen=True)
class GroupTable:
    """Table of supports of identical contacts, by distinct pair of node and cell.

    Parameters
    ----------
    group : ContactCells
    cells : (c,) array
        Cell of each pair.
    rows : (c, m) array
        Rows of each pair's cell.
    twists : (c, j, d) array
    powers : (c, m, j) array
    thresholds : (c,) array
    owner : (c,) array
        The node of each pair.
    pair_of : (b, s) array
        The pair of each node and slot.
    """

    group: ContactCells
    cells: IntArray
    rows: IntArray
    twists: FloatArray
    powers: FloatArray
    thresholds: FloatArray
    owner: IntArray
    pair_of: IntArray

    @classmethod
    def over_cells(cls, group: ContactCells, cells: IntArray, twists: FloatArray, thresholds: FloatArray) -> GroupTable:
        """Return the table for nodes with cells (b, s), twists (b, j, d) and thresholds (b,)."""
        pairs = np.arange(len(cells))[:, None] * len(group.cells) + cells
        distinct, pair_of = np.unique(pairs, return_inverse=True)
        owner, pair_cells = np.divmod(distinct, len(group.cells))
        rows = group.supports.rows_of(pair_cells)
        powers = group.supports.powers(rows, twists[owner])
        return cls(
            group, pair_cells, rows, twists[owner], powers, thresholds[owner], owner, pair_of.reshape(cells.shape)
        )

    @cached_property
    def excesses(self) -> FloatArray:
        """Excesses over the thresholds, (c, m, j); powers ``s^p`` for rules without thresholds."""
        return self.group.supports.rule.excess(self.powers, self.thresholds[:, None, None])

    def weighted(self, weights: FloatArray) -> FloatArray:
        """Return the sums (c, m) over directions, weighted by each node's dual weights (b, j)."""
        return np.asarray((self.excesses @ weights[self.owner][:, :, None])[:, :, 0])

    def select_rows(self, weights: FloatArray | None, max_rows: int) -> tuple[IntArray, FloatArray]:
        """Return the selected representative contacts (c, m), sorted, and their excesses (c, m, j).

        With at most ``max_rows`` per cell, and few of these, all are selected. Otherwise they are those of the largest
        support along each direction, and of the largest weighted support.
        """
        c, m, _ = self.powers.shape
        if max_rows <= FEW:
            indices = np.broadcast_to(np.minimum(np.arange(max_rows), m - 1), (c, max_rows))
        else:
            weighted = np.mean(self.excesses, axis=2) if weights is None else self.weighted(weights)
            along = np.argmax(self.powers, axis=1)
            indices = np.sort(np.concatenate([along, np.argmax(weighted, axis=1)[:, None]], axis=1), axis=1)
        rows = np.take_along_axis(self.rows, indices, axis=1)
        return rows, np.take_along_axis(self.excesses, indices[..., None], axis=1)

    def upper_bounds(self, weights: FloatArray) -> FloatArray:
        """Return upper bounds (b, s) on the supports weighted by each node's dual weights (b, j)."""
        supports = self.group.supports
        if supports.has_curved:
            maxima = weighted_supports(
                supports, self.cells, self.powers, self.twists, weights[self.owner], self.thresholds
            )
            return np.asarray(maxima[self.pair_of])
        return np.asarray(np.max(self.weighted(weights), axis=1)[self.pair_of])

    def single_upper_bounds(self) -> FloatArray:
        """Return upper bounds (b, s, j) on the powers of supports along each single direction."""
        return single_supports(self.group.supports, self.cells, self.powers, self.twists)[self.pair_of]


def weighted_supports(
    supports: Supports,
    cells: IntArray,
    powers: FloatArray,
    twists: FloatArray,
    weights: FloatArray,
    thresholds: FloatArray,
) -> FloatArray:
    """Return upper bounds (c,) on the weighted supports of contacts anywhere in cells (c,).

    Parameters
    ----------
    supports : Supports
    cells : (c,) array
        Indices of cells.
    powers : (c, m, j) array
        ``s^p`` of each cell's rows along its directions.
    twists : (c, j, d) array
    weights : (c, j) array
        Dual weights of each cell's node.
    thresholds : (c,) array
    """
    weighted = (supports.rule.excess(powers, thresholds[:, None, None]) @ weights[:, :, None])[:, :, 0]
    largest = np.max(powers, axis=1) ** (1.0 / supports.rule.power)
    speed, turning = supports.speed_bounds(cells, twists)
    interval = _SupportInterval(
        supports,
        np.max(weighted, axis=1),
        bound_tolerance(supports, cells),
        *_weighted_directions(twists, weights),
        thresholds,
    )
    for surface, parts, rows, deviations, owner in _parts_by_surface(supports, cells):
        increase = increase_inside_parts(
            supports, deviations, largest[owner], speed[owner], turning[owner], thresholds[owner, None]
        )
        upper = np.max(weighted[owner[:, None], rows], axis=1) + np.sum(weights[owner] * increase, axis=1)
        interval.refine(surface, parts, owner, upper)
    return interval.upper_bounds()


def single_supports(supports: Supports, cells: IntArray, powers: FloatArray, twists: FloatArray) -> FloatArray:
    """Return upper bounds (c, j) on the support powers ``s^p`` anywhere in cells along each direction.

    See ``weighted_supports``.
    """
    maxima = np.max(powers, axis=1)
    curved = [supports.curved[c] for c in cells.tolist()]
    if not any(curved):
        return np.asarray(maxima)
    none = np.zeros((2, 3))
    deviations = np.stack([np.max([p.max_deviations for p in parts], axis=0) if parts else none for parts in curved])
    largest = maxima ** (1.0 / supports.rule.power)
    increase = increase_inside_parts(supports, deviations, largest, *supports.speed_bounds(cells, twists), np.zeros(1))
    return np.asarray((maxima + increase) * (1.0 + ARITHMETIC_MARGIN * bound_tolerance(supports, cells))[:, None])


def bound_tolerance(supports: Supports, cells: IntArray) -> FloatArray:
    """Return the accepted relative excess (c,) of each cell's bound over the largest known support."""
    radii = supports.radii(cells)
    return np.asarray(np.maximum(ENOUGH, COARSE * (radii / max(supports.largest_radius, 1e-300)) ** 2))


def increase_inside_parts(
    supports: Supports,
    deviations: FloatArray,
    largest: FloatArray,
    speed: FloatArray,
    turning: FloatArray,
    thresholds: FloatArray,
) -> FloatArray:
    """Return bounds (..., j) on how much a support's power or excess is larger inside a part than at its corners.

    The power is ``s^p``, the excess that of the support s over a threshold.

    Parameters
    ----------
    supports : Supports
    deviations : (..., 2, 3) array
        Coefficients of each part; see ``CurvedSurface.deviations``.
    largest, speed, turning : (..., j) arrays
        Upper bounds on s, ``|v|`` and ``|tau|`` at the corners along each direction.
    thresholds : (..., 1) array
    """
    p, (force, moment) = supports.rule.power, supports.lipschitz
    linear = force * deviations[..., 1] + moment * deviations[..., 2]
    change, corner_change = (
        force * deviations[..., i, 0, None] * speed + linear[..., i, None] * turning for i in (0, 1)
    )
    largest_inside = largest + corner_change
    by_corners = supports.rule.excess(largest_inside**p, thresholds) - supports.rule.excess(largest**p, thresholds)
    return np.asarray(np.minimum(p * largest_inside ** (p - 1.0) * change, by_corners))


def _weighted_directions(twists: FloatArray, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the directions of positive weight, (b, j, d), and their weights (b, j), padded to the same j."""
    count = int(np.max(np.count_nonzero(weights, axis=1)))
    if count == weights.shape[1]:
        return twists, weights
    heaviest = np.argpartition(-weights, count, axis=1)[:, :count]
    return np.take_along_axis(twists, heaviest[..., None], axis=1), np.take_along_axis(weights, heaviest, axis=1)


def _parts_by_surface(
    supports: Supports, cells: IntArray
) -> list[tuple[CurvedSurface, FloatArray, IntArray, FloatArray, IntArray]]:
    """Return the curved parts of cells, grouped by surface.

    Each group has its surface, corners (n, c, q), rows (n, c), deviations, and the parts' cells (n,).
    """
    kinds: dict[tuple[int, int], list[tuple[CurvedParts, int]]] = {}
    for pair, cell in enumerate(cells.tolist()):
        for curved in supports.curved[cell]:
            kinds.setdefault((id(curved.surface), curved.rows.shape[1]), []).append((curved, pair))
    result = []
    for members in kinds.values():
        parts, rows, deviations = (
            np.concatenate([getattr(curved, name) for curved, _ in members]) for name in ("parts", "rows", "deviations")
        )
        owner = np.repeat([pair for _, pair in members], [len(curved.parts) for curved, _ in members])
        result.append((members[0][0].surface, parts, rows, deviations, owner))
    return result


class _SupportInterval:
    """Lower and upper bounds on the largest weighted support over each cell.

    Parameters
    ----------
    supports : Supports
    lower : (c,) array
        Largest weighted support at the rows.
    tolerance : (c,) array
        Relative tolerance.
    twists : (c, j, d) array
    weights : (c, j) array
    thresholds : (c,) array
    """

    def __init__(
        self,
        supports: Supports,
        lower: FloatArray,
        tolerance: FloatArray,
        twists: FloatArray,
        weights: FloatArray,
        thresholds: FloatArray,
    ) -> None:
        self._supports, self._tolerance, self._twists, self._weights = supports, tolerance, twists, weights
        self._lower, self._upper, self._thresholds = lower, lower.copy(), thresholds

    def refine(self, surface: CurvedSurface, parts: FloatArray, owner: IntArray, upper: FloatArray) -> None:
        """Bound the largest weighted support over cells by their parts (n, c, q), subdivided where necessary.

        ``owner`` are the parts' cells, ``upper`` their upper bounds. Parts that may contain a maximum are subdivided,
        which raises the cells' lower bounds.
        """
        for _ in range(ROUNDS):
            is_open = upper > (self._lower + self._tolerances(self._lower))[owner]
            np.maximum.at(self._upper, owner[~is_open], upper[~is_open])
            if not np.any(is_open):
                return
            count = -(-np.count_nonzero(is_open) // BLOCK)  # rounded up
            blocks = np.array_split(np.flatnonzero(is_open), count)
            results = [self._subdivide(surface, parts[block], owner[block]) for block in blocks]
            parts, owner, upper = (np.concatenate([result[i] for result in results]) for i in range(3))
        np.maximum.at(self._upper, owner, upper)

    def _subdivide(
        self, surface: CurvedSurface, parts: FloatArray, owner: IntArray
    ) -> tuple[FloatArray, IntArray, FloatArray]:
        """Return the quarters (n r, c, q) of parts (n, c, q), their cells' indices, and upper bounds, (n r,)."""
        vertices, corner_indices = surface.subdivide(parts)
        n, v, q = vertices.shape
        supports, weights = self._supports, self._weights[owner][:, None]
        points, normals = (x.reshape(n, v, 3) for x in surface.contacts(vertices.reshape(n * v, q)))
        powers, speed, turning = supports.evaluate(points, normals, self._twists[owner])
        supports.evaluations += powers.size
        thresholds = self._thresholds[owner][:, None, None]
        excesses = supports.rule.excess(powers, thresholds)
        np.maximum.at(self._lower, owner, np.max(np.sum(excesses * weights, axis=2), axis=1))
        quarters = vertices[:, corner_indices].reshape(-1, corner_indices.shape[1], q)
        deviations = surface.deviations(quarters).reshape(n, len(corner_indices), 1, 2, 3)
        supports_at = powers ** (1.0 / supports.rule.power)
        at_corners = (supports_at[:, corner_indices], speed[:, corner_indices], turning[:, None, None])
        increase = increase_inside_parts(supports, deviations, *at_corners, thresholds[:, None])
        upper = np.sum((excesses[:, corner_indices] + increase) * weights[:, None], axis=3)
        return quarters, np.repeat(owner, len(corner_indices)), np.max(upper, axis=2).ravel()

    def upper_bounds(self) -> FloatArray:
        """Return the upper bounds (c,), with a margin for independent recomputation."""
        largest = np.maximum(self._upper, self._lower)
        return np.asarray(largest + ARITHMETIC_MARGIN * self._tolerances(largest))

    def _tolerances(self, supports: FloatArray) -> FloatArray:
        """Return the absolute tolerances (c,) for weighted supports (c,)."""
        return np.asarray(self._tolerance * (supports + THRESHOLD_SHARE * self._thresholds))
