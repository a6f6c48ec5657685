"""Bounding strategy for meshes: sets of dual weights shared by all nodes, optimised for a few of the loosest nodes.

Any set of dual weights bounds every placement. The maxima of its weighted supports over all clusters of the mesh are
computed once (``ClusterMaxima``), by matrix products over the mesh's corners (``CornerContacts``), so that a node is
bounded in microseconds by the least of many short sums.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.common.validation import FloatArray, IntArray
from nlpgrasp.contacts import Work
from nlpgrasp.global_bound.cell_supports import TORSION, Supports
from nlpgrasp.global_bound.contact_cells import NONE, ContactClusters
from nlpgrasp.global_bound.dual_weights import LEAST, DualWeights, optimal_dual_weights, round_weights
from nlpgrasp.global_bound.node_tree import BoundingStrategy, FractionalPlacement, NodeArrays, NodeTree, children
from nlpgrasp.global_bound.scope import BoundScope
from nlpgrasp.global_bound.support_table import ROUNDING_MARGIN
from nlpgrasp.global_bound.weak_twists import NumberedDirections

Single = NDArray[np.float32]
RealArray = FloatArray | Single  # double or single precision

CHUNK = 80_000  # corners times directions at a time, to fit the processor's cache
EVERY = slice(0, None)  # all rows
ROOT_ROUNDS, ROUNDS = 30, 5  # rounds of linear programs for the root and for a node
TOP, CUT = 512, 0.5  # loosest nodes whose bounds are recomputed at a time, and the fraction of these that is split
LOOKED = 4  # nodes for which dual weights are optimised at a time
APART = 2  # least number of slots in which these nodes differ
DIRECTIONS = 24  # directions of a linear program
ROWS = 24  # initial rows per cell of a linear program
NEAR = 4  # sets of dual weights from which a linear program takes its initial directions
MOST_OPEN, MOST_WEIGHTS = 2_000_000, 6000  # largest numbers of open nodes and of sets of dual weights
MOST_LEAVES = 40_000  # largest number of recorded leaves
BATCH = 512  # nodes of the recorded tree that are split at a time
AGAIN = np.float32(1e-6)  # relative excess over the search's bound above which a recorded node is split
FIRST = 64  # initial capacity for sets of dual weights
WORK = 2_000_000  # nodes times sets of dual weights at a time
ROUNDING = np.float32(3e-5)  # relative margin above the rounding of a single-precision sum over contacts


class SharedWeightStrategy(BoundingStrategy):
    """Bounding strategy for meshes, in which all nodes share their sets of dual weights.

    A node's bound is the least of those by all sets. A set is optimal for the maximal rows of earlier sets
    (``optimal_dual_weights``). The certificate records a new tree, bounded by all of them, with a tenth of the nodes.

    Parameters
    ----------
    scope : BoundScope
        On a mesh.
    """

    drops_copies, max_open = False, MOST_OPEN

    def __init__(self, scope: BoundScope) -> None:
        super().__init__(scope, DIRECTIONS)
        self.power, self.maxima = scope.rule.power, ClusterMaxima(scope, self.twists, self.dual_weights)

    def bound_nodes(self, cells: IntArray, parents: NodeArrays | None, target: float) -> NodeArrays:
        """Return nodes (n, k) with their least bounds over all sets of dual weights.

        The first sets are computed for the root node.
        """
        del target
        if not self.dual_weights:
            initial = self.twists.draw_initial()
            self.maxima.add(DualWeights(initial, np.full(len(initial), 1.0 / len(initial))))
            self.placements = self._add_optimal_weights(cells, ROOT_ROUNDS)
        bounds, dual_index = self.maxima.bounds(cells)
        if parents is not None:
            dual_index = np.where(bounds <= parents.bounds, dual_index, parents.dual_index)
            bounds = np.minimum(bounds, parents.bounds)
        return NodeArrays(cells, bounds, dual_index)

    def select_nodes(self, nodes: NodeArrays, count: int, target: float) -> IntArray:
        """Return the indices of the loosest open nodes, the largest bounds first."""
        del count, target
        indices = self._refresh_bounds(nodes)
        bounds = nodes.bounds[indices]
        return indices[bounds >= np.quantile(bounds, CUT)]

    def _refresh_bounds(self, nodes: NodeArrays) -> IntArray:
        """Lower the bounds of the loosest nodes in place, and return their indices, the largest bounds first."""
        indices = np.arange(len(nodes))
        loosest = indices if len(nodes) <= TOP else np.argpartition(-nodes.bounds, TOP - 1)[:TOP]
        bounds, dual_index = self.maxima.bounds(nodes.cells[loosest])
        is_lower = bounds < nodes.bounds[loosest]
        nodes.bounds[loosest[is_lower]], nodes.dual_index[loosest[is_lower]] = bounds[is_lower], dual_index[is_lower]
        return loosest[np.argsort(-nodes.bounds[loosest], kind="stable")]

    def select_slots(self, nodes: NodeArrays) -> IntArray:
        """Return for each node the position of the contact whose split gives the least mean bound.

        ``NONE`` where no cell can be split.
        """
        chosen, score = np.full(len(nodes), NONE), np.full(len(nodes), np.inf)
        for slot in range(nodes.cells.shape[1]):
            is_splittable = nodes.cells[:, slot] < self.maxima.clusters.first_leaf
            if slot and self.scope.group_of[slot] is self.scope.group_of[slot - 1]:
                is_splittable &= nodes.cells[:, slot] != nodes.cells[:, slot - 1]
            indices = np.flatnonzero(is_splittable)
            if not len(indices):
                continue
            children_cells, parent = children(self.scope.groups, nodes.cells[indices], np.full(len(indices), slot))
            bounds = np.maximum(np.minimum(self.maxima.bounds(children_cells)[0], nodes.bounds[indices[parent]]), 0.0)
            mean_bound = np.bincount(parent, bounds, len(indices)) / np.maximum(
                np.bincount(parent, minlength=len(indices)), 1
            )
            is_better = mean_bound < score[indices]
            score[indices[is_better]], chosen[indices[is_better]] = mean_bound[is_better], slot
        return chosen

    def improve(self, nodes: NodeArrays, target: float) -> IntArray:
        """Add sets of dual weights for a few of the loosest nodes, and return the indices of nodes that can be closed.

        These are among the loosest nodes, and have a bound on mu of at most ``target``.
        """
        indices = self._refresh_bounds(nodes)
        is_low = nodes.bounds[indices] <= target**self.power
        selected = self._select_different(nodes.cells[indices[~is_low]])
        self.placements = self._add_optimal_weights(selected, ROUNDS) if len(selected) else []
        return np.asarray(indices[is_low])

    def _select_different(self, nodes: IntArray) -> IntArray:
        """Return the first few of nodes (n, k) that differ from each other in several cells."""
        chosen = list[IntArray]()
        for node in nodes:
            if len(chosen) < LOOKED and all(np.sum(node != other) >= APART for other in chosen):
                chosen.append(node)
        return np.array(chosen, dtype=np.int64)

    def _add_optimal_weights(self, nodes: IntArray, rounds: int) -> list[FractionalPlacement]:
        """Add a set of dual weights for each of some nodes (b, k), and return their fractional placements.

        They follow from rounds of linear programs. The weights of a round are evaluated over the node's own cells, and
        those of the best round are kept; the placements are those of the last round.
        """
        directions = np.stack([self._directions(node) for node in nodes])
        rows = np.stack([self._rows(node) for node in nodes])
        best = [(np.inf, DualWeights(directions[0], np.zeros(0)))] * len(nodes)
        weights, fractions, rule = np.zeros(directions.shape), np.zeros(rows.shape), self.scope.rule
        bounds = np.array([np.min(self.maxima.bounds_by_weights(node)) for node in nodes], dtype=float)
        for remaining in reversed(range(rounds)):
            rows, thresholds = np.sort(rows, axis=2), rule.thresholds(bounds, remaining)
            powers = rule.excess(self._powers(rows, directions), thresholds[:, None, None, None])
            weights, fractions = optimal_dual_weights(powers)
            maximal = np.empty((*nodes.shape, 1), dtype=np.int64)
            for i, (node, node_directions, node_weights) in enumerate(zip(nodes, directions, weights, strict=True)):
                is_used = node_weights > LEAST
                dual = DualWeights(node_directions[is_used], round_weights(node_weights[is_used]), float(thresholds[i]))
                maximal[i, :, 0], bound = self.maxima.largest_rows(node, dual)
                if bound < best[i][0]:
                    best[i] = bound, dual
                bounds[i] = min(bounds[i], bound)
            if remaining:
                directions = self.twists.renew(self.scope.groups, directions, weights, rows, fractions)
                rows = np.concatenate([rows, maximal], axis=2)
        for _, dual in best:
            self.maxima.add(dual)
        roots = [bound ** (1.0 / self.power) for bound, _ in best]
        return [FractionalPlacement(*values) for values in zip(roots, rows, fractions, strict=True)]

    def _powers(self, rows: IntArray, directions: IntArray) -> FloatArray:
        """Return the powers ``s^p`` (b, k, m, j) at sorted mesh corners (b, k, m), with zeros for duplicates."""
        parts = []
        for group, slots in self.scope.groups:
            group_rows = rows[:, slots]
            powers = group.supports.powers(group_rows.reshape(len(group_rows), -1), self.twists[directions])
            parts.append(powers.reshape(*group_rows.shape, -1))
        is_copy = np.diff(rows, axis=2, prepend=-1) == 0
        return np.where(is_copy[..., None], 0.0, np.concatenate(parts, axis=1))

    def _directions(self, node: IntArray) -> IntArray:
        """Return the indices (DIRECTIONS,) of the directions for a node's first linear program.

        They are the heaviest in the sets of dual weights with the tightest bounds on the node, then initial ones.
        """
        tightest = [
            self.dual_weights[i] for i in np.argsort(self.maxima.bounds_by_weights(node), kind="stable")[:NEAR].tolist()
        ]
        directions, weights = (np.concatenate([dual[part] for dual in tightest]) for part in (0, 1))
        by_weight = directions[np.argsort(-weights, kind="stable")]
        distinct = by_weight[np.sort(np.unique(by_weight, return_index=True)[1])]
        return np.concatenate([distinct, self.twists.draw_initial()])[:DIRECTIONS]

    def _rows(self, node: IntArray) -> IntArray:
        """Return the mesh corners (k, ROWS) of largest weighted support in each cell of a node.

        They are those of the node's tightest sets of dual weights.
        """
        tightest = np.argsort(self.maxima.bounds_by_weights(node), kind="stable")[:ROWS]
        return self.maxima.rows(node, np.resize(tightest, ROWS))

    def is_full(self, count: int) -> bool:
        """Return whether ``count`` open nodes, or the sets of dual weights, reach the memory limit."""
        return super().is_full(count) or len(self.dual_weights) >= MOST_WEIGHTS

    def certified_tree(self, tree: NodeTree) -> NodeTree:
        """Return a new tree, split until it proves the bound of a search's tree or has ``MOST_LEAVES`` leaves."""
        result = NodeTree(self, MOST_LEAVES)
        result.begin(0.0)
        goal = np.float32(tree.upper**self.power) * (1 + AGAIN)
        while result.complete and len(loose := np.flatnonzero(result.open.bounds > goal)):
            remaining = max(1, MOST_LEAVES - result.leaf_count)
            result.split(loose[np.argsort(-result.open.bounds[loose], kind="stable")[: min(BATCH, remaining)]], 0.0)
        return result

    def recompute_bounds(self, nodes: NodeArrays) -> FloatArray:
        """Return bounds recomputed in double precision from recorded weights, with a margin for rounding."""
        result = np.empty(len(nodes))
        for index in np.unique(nodes.dual_index).tolist():
            indices = np.flatnonzero(nodes.dual_index == index)
            maxima = self.maxima.maxima_over_clusters(self.dual_weights[index].rounded())
            result[indices] = np.sum(maxima[nodes.cells[indices] + self.maxima.offsets], axis=1)
        return np.asarray(result ** (1.0 / self.power) * (1.0 + ROUNDING_MARGIN))


class ClusterMaxima:
    """Maxima of weighted supports over the clusters of a mesh, for each shared set of dual weights.

    Dual weights w of directions y bound every placement, ``mu^p <= sum_i g_i(p_i)`` with
    ``g_i(p) = sum_j w_j s_i(p, y_j)^p``. Under the shared budget ``g_i(p) = theta / k + sum_j w_j (s_i - theta)_+`` for
    k contacts. The maxima of g over each cluster are stored for each group of identical contacts, in single precision
    and rounded up; final bounds are recomputed in double precision.

    Parameters
    ----------
    scope : BoundScope
        On a mesh, with the same clusters for every contact.
    twists : NumberedDirections
    dual_weights : list of DualWeights
        Extended by ``add``.

    Attributes
    ----------
    offsets : (k,) array
        Offsets of the slots' groups in the stored maxima, added to the cells of nodes.
    """

    def __init__(self, scope: BoundScope, twists: NumberedDirections, dual_weights: list[DualWeights]) -> None:
        self._scope, self._twists, self._dual_weights = scope, twists, dual_weights
        first_group = scope.contact_cells[0]
        if not isinstance(first_group, ContactClusters):
            raise TypeError("dual weights are shared over the clusters of a mesh alone")
        self.clusters = clusters = first_group.clusters
        self._single = self._corners(single=True)
        self._group = np.array(
            [i for i, group in enumerate(scope.contact_cells) for _ in group.contact_indices], dtype=np.int64
        )
        self.offsets = clusters.node_limit * self._group
        self._maxima = np.zeros((clusters.node_limit * len(scope.contact_cells), FIRST), dtype=np.float32)
        self._maximal_rows = np.zeros((clusters.first_leaf * len(scope.contact_cells), FIRST), dtype=np.int32)
        self._cluster = np.repeat(np.arange(clusters.first_leaf), np.diff(clusters.row_offsets))

    def add(self, dual: DualWeights) -> None:
        """Add a set of dual weights, and compute the maxima of its weighted supports over all clusters."""
        k, last = len(self._dual_weights), self.clusters.first_leaf
        if k == self._maxima.shape[1]:
            self._maxima, self._maximal_rows = (
                np.concatenate([a, np.zeros_like(a)], axis=1) for a in (self._maxima, self._maximal_rows)
            )
        for i, corners in enumerate(self._single):
            values = self._weighted_powers(corners, dual)
            maxima = self._over_clusters(values)
            attained = np.flatnonzero(values == maxima[last:][self._cluster])
            self._maximal_rows[last * i + self._cluster[attained], k] = attained
            maxima += self._threshold_per_contact(dual)
            with np.errstate(over="ignore"):  # infinity is a valid bound
                self._maxima[2 * last * i : 2 * last * (i + 1), k] = maxima.astype(np.float32) * (1 + ROUNDING)
        self._dual_weights.append(dual)

    def maxima_over_clusters(self, dual: DualWeights) -> FloatArray:
        """Return the largest weighted support of a contact on each cluster, by group, in double precision."""
        maxima = [self._over_clusters(self._weighted_powers(corners, dual)) for corners in self._double]
        return np.concatenate(maxima) + self._threshold_per_contact(dual)

    def _threshold_per_contact(self, dual: DualWeights) -> float:
        """Return the part of a threshold that each contact contributes to a bound."""
        return dual.threshold / len(self._group)

    def largest_rows(self, node: IntArray, dual: DualWeights) -> tuple[IntArray, float]:
        """Return the corner of largest weighted support in each cell of a node (k,), and the node's bound."""
        maxima: dict[tuple[int, int], tuple[int, float]] = {}
        pairs = list(zip(node.tolist(), self._group.tolist(), strict=True))
        for cell, group in pairs:
            if (cell, group) not in maxima:
                rows = self.clusters.rows_of(cell)
                values = self._weighted_powers(self._single[group], dual, rows)
                row = int(np.argmax(values))
                maxima[cell, group] = rows.start + row, float(values[row]) + self._threshold_per_contact(dual)
        return np.array([maxima[pair][0] for pair in pairs]), sum(maxima[pair][1] for pair in pairs)

    @cached_property
    def _double(self) -> list[CornerContacts]:
        return self._corners(single=False)

    def _corners(self, single: bool) -> list[CornerContacts]:
        rows = slice(0, len(self.clusters.rows.points))
        return [CornerContacts(group.supports, rows, single) for group in self._scope.contact_cells]

    def _weighted_powers(self, corners: CornerContacts, dual: DualWeights, rows: slice = EVERY) -> FloatArray:
        weights = dual.weights / np.sum(dual.weights)
        return corners.weighted_powers(self._twists[dual.indices], weights, rows, dual.threshold)

    def _over_clusters(self, values: FloatArray) -> FloatArray:
        """Return the maximum over each cluster of values at all corners."""
        first = self.clusters.first_leaf
        maxima = np.zeros(2 * first)
        maxima[first:] = np.maximum.reduceat(values, self.clusters.row_offsets[:-1])
        while first > 1:
            first //= 2
            halves = maxima[2 * first : 4 * first]
            maxima[first : 2 * first] = np.maximum(halves[::2], halves[1::2])
        return maxima

    def bounds_by_weights(self, node: IntArray) -> Single:
        """Return the bounds on a node (k,) by each set of dual weights.

        Bounds are on mu to the rule's power, one for each set.
        """
        return np.asarray(np.sum(self._maxima[node + self.offsets, : len(self._dual_weights)], axis=0))

    def bounds(self, nodes: IntArray) -> tuple[Single, IntArray]:
        """Return the least bounds (n,) on nodes (n, k) over all sets of dual weights, and these sets' indices (n,).

        Bounds are on mu to the rule's power.
        """
        least, best = np.empty(len(nodes), dtype=np.float32), np.empty(len(nodes), dtype=np.int64)
        maxima, indices = self._maxima[:, : len(self._dual_weights)], nodes + self.offsets
        step = max(1, WORK // len(self._dual_weights))
        for begin in range(0, len(nodes), step):
            batch = indices[begin : begin + step]
            total = maxima[batch[:, 0]]
            for slot in range(1, batch.shape[1]):
                total += maxima[batch[:, slot]]
            best[begin : begin + step] = smallest = np.argmin(total, axis=1)
            least[begin : begin + step] = total[np.arange(len(batch)), smallest]
        return least, best

    def rows(self, node: IntArray, dual_indices: IntArray) -> IntArray:
        """Return the corners (k, n) of largest weighted support in each cell of a node (k,), by n sets of dual weights.

        The sets are those with given indices.
        """
        result = np.empty((len(node), len(dual_indices)), dtype=np.int64)
        last, count = self.clusters.first_leaf, self.clusters.node_limit
        for slot, (cell, offset) in enumerate(zip(node.tolist(), self.offsets.tolist(), strict=True)):
            clusters = np.full(len(dual_indices), cell)
            while clusters[0] < last:
                left, right = (self._maxima[offset + 2 * clusters + i, dual_indices] for i in (0, 1))
                clusters = 2 * clusters + (right > left)
            result[slot] = self._maximal_rows[clusters - last + offset // count * last, dual_indices]
        return result


class CornerContacts:
    """Contacts at mesh corners, whose work is evaluated by matrix products.

    With the arm a from the middle of all rows and the inward normal n, the twist's force part taken about that middle,
    the work along the normal is ``n . f + (a x n) . tau``, and the squared velocity ``|f + tau x a|^2`` is linear in 1,
    a and the products of a's components. The rest is tangential.

    Parameters
    ----------
    supports : Supports
    rows : slice or (m,) array
        Rows of the supports.
    single : bool
        Whether to use single precision.
    """

    def __init__(self, supports: Supports, rows: slice | IntArray, single: bool = False) -> None:
        self.supports, self._rows, self._type = supports, rows, np.dtype(np.float32 if single else np.float64)
        points, normals = supports.points[rows], supports.normals[rows]
        centre = points.mean(axis=0)
        self._arm, arms = centre - supports.origin, points - centre
        x, y, z = arms.T
        self._along = self._convert(np.concatenate([normals, np.cross(arms, normals)], axis=1).T)
        self._products = self._convert(np.stack([np.ones_like(x), x, y, z, x * x, y * y, z * z, x * y, y * z, z * x]))
        self._normals = self._convert(normals.T)
        self.torsion = TORSION in supports.contact.axes(3)

    def __deepcopy__(self, memo: dict[int, object]) -> CornerContacts:
        """Return the same contacts, which do not change: copies of a search share them."""
        return self

    @cached_property
    def _maps(self) -> RealArray:
        """Grasp maps of supports without a closed form, (6, m, n_i)."""
        points, normals = self.supports.points[self._rows], self.supports.normals[self._rows]
        return self._convert(self.supports.maps_at(points - self._arm, normals).transpose(1, 0, 2))

    def __len__(self) -> int:
        """Return the number of rows."""
        return int(self._along.shape[1])

    def _convert(self, values: FloatArray) -> RealArray:
        return np.ascontiguousarray(values, dtype=self._type)

    def weighted_powers(
        self, twists: FloatArray, weights: FloatArray, rows: slice = EVERY, threshold: float = 0.0
    ) -> FloatArray:
        """Return ``sum_j w_j s_j^p`` of the supports s at each corner, or of their excesses, (m,).

        Parameters
        ----------
        twists : (j, 6) array
        weights : (j,) array
        rows : slice
        threshold : float
        """
        first, last, _ = rows.indices(len(self))
        result = np.empty(last - first)
        shifted = np.concatenate([twists[:, :3] + np.cross(twists[:, 3:], self._arm), twists[:, 3:]], axis=1)
        converted, squares, single_weights = (
            self._convert(shifted),
            self._convert(_squares(shifted)),
            self._convert(weights),
        )
        step = max(1, CHUNK // len(twists))
        for begin in range(first, last, step):
            end = min(last, begin + step)
            powers = self._powers(converted, squares, slice(begin, end))
            result[begin - first : end - first] = single_weights @ self.supports.rule.excess(powers, threshold)
        return result

    def _powers(self, twists: RealArray, squares: RealArray, rows: slice) -> RealArray:
        """Return the powers ``s^p`` (j, m) of supports along twists (j, 6) at a range of m corners.

        ``squares`` are the coefficients of the squared lengths of the work, from which the tangential part follows.
        """
        contact, rule = self.supports.contact, self.supports.rule
        if rule.lengths:  # a small difference of squares is inexact, but hardly the support's square
            along = twists @ self._along[:, rows]
            squared = squares @ self._products[:, rows]
            squared -= along**2
            across = np.sqrt(np.maximum(squared, 0.0, out=squared), out=squared)
            square = contact.squared_support(self._work(along, across, twists, rows), np)
            if square is not None:
                return np.asarray(square if rule.power == 2.0 else square ** (0.5 * rule.power))
        maps = self._maps[:, rows]
        z = (twists @ maps.reshape(6, -1)).reshape(len(twists), -1, maps.shape[2])
        return np.asarray(rule.support(contact, np.asarray(z, dtype=float)) ** rule.power)

    def _work(self, along: RealArray, across: RealArray, twists: RealArray, rows: slice) -> Work:
        if not self.torsion:
            return Work(along, across, np.zeros(1))
        return Work(along, across, np.abs(twists[:, 3:] @ self._normals[:, rows]))


def _squares(twists: FloatArray) -> FloatArray:
    """Return the coefficients of ``|f + tau x a|^2`` as a quadratic polynomial in a, (j, 10).

    They are those of 1, a, and the products of a's components.
    """
    force, (x, y, z) = twists[:, :3], twists[:, 3:].T
    square = x * x + y * y + z * z
    parts = [square - x * x, square - y * y, square - z * z, -2.0 * x * y, -2.0 * y * z, -2.0 * z * x]
    linear = 2.0 * np.cross(force, twists[:, 3:])
    return np.column_stack([np.sum(force**2, axis=1), linear, *parts])
