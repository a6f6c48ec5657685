"""Bounding strategy for meshes: dual weights shared by all nodes, optimised for a few of the loosest.

A mixture, which is a set of directions with dual weights, bounds every placement. Its largest values over all clusters
of the mesh are computed once (``ClusterMaxima``), by matrix products over the mesh's corners (``CornerContacts``), so
that a node is bounded in microseconds by the least of many short sums.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts import Work
from nlpgrasp.global_bound.cell_supports import TORSION, Supports
from nlpgrasp.global_bound.cells.cell import IntArray
from nlpgrasp.global_bound.contact_cells import NONE, ContactClusters
from nlpgrasp.global_bound.dual_weights import LEAST, DualWeights, optimal_dual_weights, round_weights
from nlpgrasp.global_bound.node_tree import BoundingStrategy, FractionalPlacement, NodeArrays, NodeTree, children
from nlpgrasp.global_bound.scope import BoundScope
from nlpgrasp.global_bound.support_table import ROUNDING_MARGIN
from nlpgrasp.global_bound.weak_twists import WeightedDirections

Single = NDArray[np.float32]
Numbers = FloatArray | Single  # double or single precision

CHUNK = 80_000  # corners times directions at a time: what a processor's cache holds
EVERY = slice(0, None)  # all rows
ROOT_ROUNDS, ROUNDS = 30, 5  # of linear programs, for the whole surface and for a node
TOP, CUT = 512, 0.5  # nodes that are looked at again at a time, and the share of these that is cut
LOOKED = 4  # nodes that new mixtures are made for at a time
APART = 2  # least number of cells in which these nodes differ
DIRECTIONS = 24  # of a node that a mixture is made for
ROWS = 24  # of a cell that a linear program sees to begin with
NEAR = 4  # mixtures whose directions such a node begins with
MOST_OPEN, MOST_MIXTURES = 2_000_000, 6000  # open nodes, and dual weights, at which a search ends
MOST_LEAVES = 40_000  # recorded leaves, at most
BATCH = 512  # nodes of the recorded tree that are cut at a time
AGAIN = np.float32(1e-6)  # relative: a node of the recorded tree whose bound exceeds the search's by less is not cut
FIRST = 64  # mixtures that there is room for to begin with
WORK = 2_000_000  # nodes times mixtures at a time
ROUNDING = np.float32(3e-5)  # relative: more than what single precision takes from a sum over contacts


class SharedWeightStrategy(BoundingStrategy):
    """Bounding strategy for meshes: a node's bound is the least over shared dual weights.

    Mixtures come from the linear program of ``dual_weights.mixtures``, over the rows that known mixtures point
    to. The tree that is recorded is grown anew from all of them: it needs a tenth of the nodes.

    Parameters
    ----------
    scope : BoundScope
        Of contacts that may be on one mesh.
    """

    by_parent, most_open = False, MOST_OPEN

    def __init__(self, scope: BoundScope) -> None:
        super().__init__(scope, DIRECTIONS)
        self.power, self.maxima = scope.measure.power, ClusterMaxima(scope, self.twists, self.mixtures)

    def bound_nodes(self, cells: IntArray, parents: NodeArrays | None, target: float) -> NodeArrays:
        """Return nodes (n, k) with their least bounds over all dual weights; computes the first if there are none."""
        del target
        if not self.mixtures:
            first = self.twists.first()
            self.maxima.add(DualWeights(first, np.full(len(first), 1.0 / len(first))))
            self.placements = self._improve(cells, ROOT_ROUNDS)
        bounds, mixture = self.maxima.bounds(cells)
        if parents is not None:
            mixture = np.where(bounds <= parents.bounds, mixture, parents.mixtures)
            bounds = np.minimum(bounds, parents.bounds)
        return NodeArrays(cells, bounds, mixture)

    def loosest(self, nodes: NodeArrays, count: int, target: float) -> IntArray:
        """Return the looser half of the open nodes with the largest bounds, the largest first."""
        del count, target
        where = self._renewed(nodes)
        bounds = nodes.bounds[where]
        return where[bounds >= np.quantile(bounds, CUT)]

    def _renewed(self, nodes: NodeArrays) -> IntArray:
        """Return the indices of nodes with the largest bounds, the largest first, by all dual weights known now."""
        every = np.arange(len(nodes))
        where = every if len(nodes) <= TOP else np.argpartition(-nodes.bounds, TOP - 1)[:TOP]
        found, mixture = self.maxima.bounds(nodes.cells[where])
        lower = found < nodes.bounds[where]
        nodes.bounds[where[lower]], nodes.mixtures[where[lower]] = found[lower], mixture[lower]
        return where[np.argsort(-nodes.bounds[where], kind="stable")]

    def slots(self, nodes: NodeArrays) -> IntArray:
        """Return the slot whose split lowers the children's mean bound most; ``NONE`` where no cell can be split."""
        chosen, score = np.full(len(nodes), NONE), np.full(len(nodes), np.inf)
        for slot in range(nodes.cells.shape[1]):
            can = nodes.cells[:, slot] < self.maxima.clusters.last
            if slot and self.scope.group_of[slot] is self.scope.group_of[slot - 1]:
                can &= nodes.cells[:, slot] != nodes.cells[:, slot - 1]
            own = np.flatnonzero(can)
            if not len(own):
                continue
            parts, parent = children(self.scope.groups, nodes.cells[own], np.full(len(own), slot))
            found = np.maximum(np.minimum(self.maxima.bounds(parts)[0], nodes.bounds[own[parent]]), 0.0)
            mean = np.bincount(parent, found, len(own)) / np.maximum(np.bincount(parent, minlength=len(own)), 1)
            better = mean < score[own]
            score[own[better]], chosen[own[better]] = mean[better], slot
        return chosen

    def improve(self, nodes: NodeArrays, target: float) -> IntArray:
        """Add dual weights for a few of the loosest nodes; return which of the others are at most the target."""
        where = self._renewed(nodes)
        low = nodes.bounds[where] <= target**self.power
        few = self._apart(nodes.cells[where[~low]])
        self.placements = self._improve(few, ROUNDS) if len(few) else []
        return np.asarray(where[low])

    def _apart(self, nodes: IntArray) -> IntArray:
        """Return a few of some nodes (n, k), the first of them first, none like those before it."""
        chosen = list[IntArray]()
        for node in nodes:
            if len(chosen) < LOOKED and all(np.sum(node != other) >= APART for other in chosen):
                chosen.append(node)
        return np.array(chosen, dtype=np.int64)

    def _improve(self, nodes: IntArray, rounds: int) -> list[FractionalPlacement]:
        """Add dual weights for nodes (b, k) in some rounds; return the last relaxed placements.

        A round's mixture is looked at over the node's own cells alone, and the best of them is kept.
        """
        numbers = np.stack([self._directions(node) for node in nodes])
        rows = np.stack([self._rows(node) for node in nodes])
        best = [(np.inf, DualWeights(numbers[0], np.zeros(0)))] * len(nodes)
        weights, shares = np.zeros(numbers.shape), np.zeros(rows.shape)
        for left in reversed(range(rounds)):
            rows = np.sort(rows, axis=2)
            weights, shares = optimal_dual_weights(self._powers(rows, numbers))
            found = np.empty((*nodes.shape, 1), dtype=np.int64)
            for i, (node, own, spread) in enumerate(zip(nodes, numbers, weights, strict=True)):
                kept = spread > LEAST
                mixture = DualWeights(own[kept], round_weights(spread[kept]))
                found[i, :, 0], bound = self.maxima.largest_rows(node, mixture)
                if bound < best[i][0]:
                    best[i] = bound, mixture
            if left:
                numbers = self.twists.renewed(self.scope.groups, numbers, weights, rows, shares)
                rows = np.concatenate([rows, found], axis=2)
        for _, mixture in best:
            self.maxima.add(mixture)
        bounds = [bound ** (1.0 / self.power) for bound, _ in best]
        return [FractionalPlacement(*own) for own in zip(bounds, rows, shares, strict=True)]

    def _powers(self, rows: IntArray, numbers: IntArray) -> FloatArray:
        """Return powers of supports at rows (b, k, m), sorted, (b, k, m, j); zero for one that is there twice."""
        parts = []
        for pieces, where in self.scope.groups:
            own = rows[:, where]
            found = pieces.supports.powers(own.reshape(len(own), -1), self.twists[numbers])
            parts.append(found.reshape(*own.shape, -1))
        again = np.diff(rows, axis=2, prepend=-1) == 0
        return np.where(again[..., None], 0.0, np.concatenate(parts, axis=1))

    def _directions(self, node: IntArray) -> IntArray:
        """Return the directions of the dual weights that bound a node best, the heaviest first, (DIRECTIONS,)."""
        near = [self.mixtures[i] for i in np.argsort(self.maxima.each(node))[:NEAR].tolist()]
        numbers, weights = (np.concatenate(parts) for parts in zip(*near, strict=True))
        heavy = numbers[np.argsort(-weights, kind="stable")]
        once = heavy[np.sort(np.unique(heavy, return_index=True)[1])]
        return np.concatenate([once, self.twists.first()])[:DIRECTIONS]

    def _rows(self, node: IntArray) -> IntArray:
        """Return the rows of each cell with the largest weighted supports in a node, (k, ROWS)."""
        near = np.argsort(self.maxima.each(node))[:ROWS]
        return self.maxima.rows(node, np.resize(near, ROWS))

    def is_full(self, count: int) -> bool:
        """Return whether so many open nodes, or the dual weights, exceed the memory limit."""
        return super().is_full(count) or len(self.mixtures) >= MOST_MIXTURES

    def recorded(self, tree: NodeTree) -> NodeTree:
        """Return a new tree, cut until no node's bound exceeds the search's, or there are too many nodes."""
        result = NodeTree(self, MOST_LEAVES)
        result.begin(0.0)
        goal = np.float32(tree.upper**self.power) * (1 + AGAIN)
        while result.complete and len(loose := np.flatnonzero(result.open.bounds > goal)):
            left = max(1, MOST_LEAVES - result.size)
            result.cut(loose[np.argsort(-result.open.bounds[loose], kind="stable")[: min(BATCH, left)]], 0.0)
        return result

    def recomputed(self, nodes: NodeArrays) -> FloatArray:
        """Return bounds in double precision from weights as they are written, with a margin for rounding."""
        result = np.empty(len(nodes))
        for number in np.unique(nodes.mixtures).tolist():
            own = np.flatnonzero(nodes.mixtures == number)
            most = self.maxima.largest(self.mixtures[number].written())
            result[own] = np.sum(most[nodes.cells[own] + self.maxima.offsets], axis=1)
        return np.asarray(result ** (1.0 / self.power) * (1.0 + ROUNDING_MARGIN))


class ClusterMaxima:
    """Largest weighted supports over the clusters of a mesh, for all shared dual weights.

    A mixture w of directions y bounds every placement, ``mu^p <= sum_i g_i(p_i)`` with
    ``g_i(p) = sum_j w_j s_i(p, y_j)^p``. Kept are the largest g over each cluster, for contacts that are alike. They
    are in single precision, from above: what is claimed in the end is computed anew.

    Parameters
    ----------
    scope : BoundScope
        Of which every contact has the same clusters.
    twists : WeightedDirections
    mixtures : list of DualWeights
        Grows by those that are added.

    Attributes
    ----------
    offsets : (k,) array
        To be added to the cells of nodes: the clusters of contacts that are alike come one group after another.
    """

    def __init__(self, scope: BoundScope, twists: WeightedDirections, mixtures: list[DualWeights]) -> None:
        self._scope, self._twists, self._mixtures = scope, twists, mixtures
        first = scope.pieces[0]
        if not isinstance(first, ContactClusters):
            raise TypeError("mixtures are shared over the clusters of a mesh alone")
        self.clusters = clusters = first.clusters
        self._single = self._corners(single=True)
        self._group = np.array([i for i, pieces in enumerate(scope.pieces) for _ in pieces.slots], dtype=np.int64)
        self.offsets = clusters.count * self._group
        self._most = np.zeros((clusters.count * len(scope.pieces), FIRST), dtype=np.float32)
        self._where = np.zeros((clusters.last * len(scope.pieces), FIRST), dtype=np.int32)
        self._cluster = np.repeat(np.arange(clusters.last), np.diff(clusters.begin))

    def add(self, mixture: DualWeights) -> None:
        """Add dual weights."""
        k, last = len(self._mixtures), self.clusters.last
        if k == self._most.shape[1]:
            self._most, self._where = (np.concatenate([a, np.zeros_like(a)], axis=1) for a in (self._most, self._where))
        for i, corners in enumerate(self._single):
            mixed = self._mixed(corners, mixture)
            most = self._over_clusters(mixed)
            hit = np.flatnonzero(mixed == most[last:][self._cluster])
            self._where[last * i + self._cluster[hit], k] = hit
            with np.errstate(over="ignore"):  # inf is a bound too
                self._most[2 * last * i : 2 * last * (i + 1), k] = most.astype(np.float32) * (1 + ROUNDING)
        self._mixtures.append(mixture)

    def largest(self, mixture: DualWeights) -> FloatArray:
        """Return the largest g of a mixture over every cluster, for one group of contacts after another."""
        return np.concatenate([self._over_clusters(self._mixed(corners, mixture)) for corners in self._double])

    def largest_rows(self, node: IntArray, mixture: DualWeights) -> tuple[IntArray, float]:
        """Return the row of each cell of a node (k,) that has most of a mixture, (k,), and the bound that it gives."""
        found: dict[tuple[int, int], tuple[int, float]] = {}
        places = list(zip(node.tolist(), self._group.tolist(), strict=True))
        for cell, group in places:
            if (cell, group) not in found:
                part = self.clusters.rows_of(cell)
                mixed = self._mixed(self._single[group], mixture, part)
                best = int(np.argmax(mixed))
                found[cell, group] = part.start + best, float(mixed[best])
        return np.array([found[place][0] for place in places]), sum(found[place][1] for place in places)

    @cached_property
    def _double(self) -> list[CornerContacts]:
        return self._corners(single=False)

    def _corners(self, single: bool) -> list[CornerContacts]:
        every = slice(0, len(self.clusters.rows.points))
        return [CornerContacts(pieces.supports, every, single) for pieces in self._scope.pieces]

    def _mixed(self, corners: CornerContacts, mixture: DualWeights, part: slice = EVERY) -> FloatArray:
        shares = mixture.weights / np.sum(mixture.weights)
        return corners.mixed(self._twists[mixture.numbers], shares, part)

    def _over_clusters(self, mixed: FloatArray) -> FloatArray:
        """Return the largest of a value at every row over every cluster."""
        first = self.clusters.last
        most = np.zeros(2 * first)
        most[first:] = np.maximum.reduceat(mixed, self.clusters.begin[:-1])
        while first > 1:
            first //= 2
            halves = most[2 * first : 4 * first]
            most[first : 2 * first] = np.maximum(halves[::2], halves[1::2])
        return most

    def each(self, node: IntArray) -> Single:
        """Return what every mixture bounds mu to the measure's power by over a node (k,)."""
        return np.asarray(np.sum(self._most[node + self.offsets, : len(self._mixtures)], axis=0))

    def bounds(self, nodes: IntArray) -> tuple[Single, IntArray]:
        """Return the least bounds over nodes (n, k), (n,), on mu to the measure's power, and of which mixtures."""
        least, best = np.empty(len(nodes), dtype=np.float32), np.empty(len(nodes), dtype=np.int64)
        most, own = self._most[:, : len(self._mixtures)], nodes + self.offsets
        step = max(1, WORK // len(self._mixtures))
        for begin in range(0, len(nodes), step):
            some = own[begin : begin + step]
            total = most[some[:, 0]]
            for slot in range(1, some.shape[1]):
                total += most[some[:, slot]]
            best[begin : begin + step] = chosen = np.argmin(total, axis=1)
            least[begin : begin + step] = total[np.arange(len(some)), chosen]
        return least, best

    def rows(self, node: IntArray, mixtures: IntArray) -> IntArray:
        """Return the rows of a node's cells (k,) that have most of some mixtures (n,), (k, n)."""
        result = np.empty((len(node), len(mixtures)), dtype=np.int64)
        last, count = self.clusters.last, self.clusters.count
        for slot, (cell, offset) in enumerate(zip(node.tolist(), self.offsets.tolist(), strict=True)):
            at = np.full(len(mixtures), cell)
            while at[0] < last:
                left, right = (self._most[offset + 2 * at + i, mixtures] for i in (0, 1))
                at = 2 * at + (right > left)
            result[slot] = self._where[at - last + offset // count * last, mixtures]
        return result


class CornerContacts:
    """Contacts at mesh corners, whose work is evaluated by matrix products.

    With the arm a from the middle of all rows and the inward normal n, the twist's force part taken about that middle,
    the work along the normal is ``n . f + (a x n) . tau``, and the squared velocity ``|f + tau x a|^2`` is linear in 1,
    a and the products of a's components. The rest is across the normal.

    Parameters
    ----------
    supports : Supports
        Of which these rows are.
    rows : slice or (m,) array
    single : bool
        Whether single precision is enough.
    """

    def __init__(self, supports: Supports, rows: slice | IntArray, single: bool = False) -> None:
        self.supports, self._type = supports, np.dtype(np.float32 if single else np.float64)
        points, normals = supports.points[rows], supports.normals[rows]
        middle = points.mean(axis=0)
        self._arm, arms = middle - supports.origin, points - middle
        x, y, z = arms.T
        self._along = self._made(np.concatenate([normals, np.cross(arms, normals)], axis=1).T)
        self._products = self._made(np.stack([np.ones_like(x), x, y, z, x * x, y * y, z * z, x * y, y * z, z * x]))
        self._normals = self._made(normals.T)
        self._maps = self._made(supports.maps_at(points - self._arm, normals).transpose(1, 0, 2))
        self.torsion = TORSION in supports.contact.axes(3)

    def __len__(self) -> int:
        """Return how many rows there are."""
        return int(self._along.shape[1])

    def _made(self, values: FloatArray) -> Numbers:
        return np.ascontiguousarray(values, dtype=self._type)

    def mixed(self, twists: FloatArray, weights: FloatArray, part: slice = EVERY) -> FloatArray:
        """Return ``sum over j of w_j s^p`` at rows, (m,), for twists (j, 6) and weights (j,)."""
        first, last, _ = part.indices(len(self))
        result = np.empty(last - first)
        moved = np.concatenate([twists[:, :3] + np.cross(twists[:, 3:], self._arm), twists[:, 3:]], axis=1)
        own, squares, shares = self._made(moved), self._made(_squares(moved)), self._made(weights)
        step = max(1, CHUNK // len(twists))
        for begin in range(first, last, step):
            end = min(last, begin + step)
            result[begin - first : end - first] = shares @ self._powers(own, squares, slice(begin, end))
        return result

    def _powers(self, twists: Numbers, squares: Numbers, part: slice) -> Numbers:
        """Return ``s^p`` at some rows along twists, (j, m)."""
        contact, measure = self.supports.contact, self.supports.measure
        if measure.lengths:  # the square is as exact as its parts, though what is across the normal may not be
            along = twists @ self._along[:, part]
            across = squares @ self._products[:, part]
            across -= along**2
            across = np.sqrt(np.maximum(across, 0.0, out=across), out=across)
            square = contact.squared_support(self._work(along, across, twists, part), np)
            if square is not None:
                return np.asarray(square if measure.power == 2.0 else square ** (0.5 * measure.power))
        maps = self._maps[:, part]
        z = (twists @ maps.reshape(6, -1)).reshape(len(twists), -1, maps.shape[2])
        return np.asarray(measure.support(contact, np.asarray(z, dtype=float)) ** measure.power)

    def _work(self, along: Numbers, across: Numbers, twists: Numbers, part: slice) -> Work:
        if not self.torsion:
            return Work(along, across, np.zeros(1))
        return Work(along, across, np.abs(twists[:, 3:] @ self._normals[:, part]))


def _squares(twists: FloatArray) -> FloatArray:
    """Return the coefficients of ``|f + tau x a|^2`` in 1, a, and the products of a's components, (j, 10)."""
    force, (x, y, z) = twists[:, :3], twists[:, 3:].T
    square = x * x + y * y + z * z
    parts = [square - x * x, square - y * y, square - z * z, -2.0 * x * y, -2.0 * y * z, -2.0 * z * x]
    once = 2.0 * np.cross(force, twists[:, 3:])
    return np.column_stack([np.sum(force**2, axis=1), once, *parts])
