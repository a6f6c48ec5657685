"""Certified bounds on mu for stacks: the sandwich algorithm on the inner hulls of many grasps side by side.

The method is that of ``sandwich``: support points span an inner polytope whose cells, cones around a centre, bound mu
from below. All grasps of a chunk take a step together, as arrays of shape (grasps, cells, ...), and a step gives each
of them one new vertex. Ridges are matched by keys, without neighbours, and the inverse of a cell's vertex matrix is
kept, so that a new cell's plane is a rank-one update. As in ``convex_hull`` the bounds rely on neither: replacing cells
by the cone of the new point over their boundary leaves the centre surrounded, and ``provable_ends`` computes heights
anew from the cells' vertices. Grasps that are not settled here (flat or nearly degenerate wrench sets, closure that is
nearly lost, many vertices) are left to ``sandwich``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from nlpgrasp.budgets.base import ForceSet
from nlpgrasp.common.unit_directions import directions, directions_around
from nlpgrasp.common.validation import BoolArray, FloatArray, IntArray
from nlpgrasp.quality.bounds import Bounds
from nlpgrasp.quality.convex_hull import BEYOND, are_off_centre
from nlpgrasp.quality.force_closure import ZERO_SUPPORT
from nlpgrasp.quality.grasp import GraspStack
from nlpgrasp.quality.provable_ends import ForceCones, provable_lower, provable_upper, trust_in_task, vertex_rounding
from nlpgrasp.quality.ratio_minimisation import minimise_by_inverse_iteration
from nlpgrasp.quality.sandwich import NO_WORK, SHRINK
from nlpgrasp.quality.screening import GraspBatch, second_moment
from nlpgrasp.quality.wrench_set import WrenchSet
from nlpgrasp.tasks import Task

CHUNK = 256  # grasps side by side: enough to pay for calls of numpy, few enough for the processor's cache
DESCENTS, STEPS = 4, 10  # descents per grasp, and their steps
PLANAR = 60  # sampled directions for planar grasps
MOST_POINTS, MOST_CELLS = 90, 6000  # vertices and cells of a hull beyond which a grasp is left
TAIL_POINTS, TAIL = 50, 2  # vertices from which on this many remaining grasps are left: steps pay side by side only
LEAST_QUALITY = 1e-6  # of the median: below it a grasp is left, as its closure is nearly lost
LEAST_PIVOT = 1e-9  # coordinate of a new vertex below which a cell would be degenerate
FLAT = 1e-12  # volume of a cell over that of a rectangular one below which it is flat
COMPACT = 0.75  # share of unfinished grasps below which finished ones are removed

Mask = BoolArray


def certify_side_by_side(
    stack: GraspStack, task: Task, rtol: float, force_set: ForceSet, seed: int
) -> list[Bounds | None]:
    """Return certified bounds on mu for each grasp of a stack; None for grasps left to ``sandwich``.

    Parameters
    ----------
    stack : GraspStack
    task : Task
        About the stack's torque origin.
    rtol : float
        Relative width of the bounds.
    force_set : ForceSet
        Of a budget that does not depend on the contacts' frames.
    seed : int
        Of the vertices' shrinking.
    """
    moment = second_moment(stack, task)
    matrix = np.linalg.inv(np.linalg.cholesky(moment))  # of the coordinates in which the task is round
    result: list[Bounds | None] = []
    for start in range(0, len(stack), CHUNK):
        rows = range(start, min(start + CHUNK, len(stack)))
        result += _Chunk(stack, rows, force_set, task, matrix, rtol, np.random.default_rng(seed)).certify()
    return result


class _Chunk:
    """Grasps that are certified side by side: their upper bounds, worst directions and inner hulls.

    Wrenches and directions are in the coordinates of ``matrix``, those of the result as given.
    """

    def __init__(
        self,
        stack: GraspStack,
        rows: range,
        force_set: ForceSet,
        task: Task,
        matrix: FloatArray,
        rtol: float,
        random: np.random.Generator,
    ) -> None:
        grasps, self.given_task = [stack[i] for i in rows], task
        self.wrenches = [WrenchSet(grasp.G, force_set, grasp.G_sizes) for grasp in grasps]
        self.domain = ForceCones.of(self.wrenches[0])
        self.batch = GraspBatch(matrix @ stack.G[rows.start : rows.stop], force_set)
        self.task, self.matrix, self.rtol = task.transformed(matrix), matrix, rtol
        self.shrink, self.random, self.trust = min(SHRINK, 0.01 * rtol), random, trust_in_task(task)
        self.result: list[Bounds | None] = [None] * len(rows)
        self.indices = np.arange(len(rows))  # of the remaining grasps
        self.upper, self.worst = np.zeros(0), np.zeros((0, 0))

    def certify(self) -> list[Bounds | None]:
        """Return the bounds of each grasp; None for grasps left to ``sandwich``."""
        low = self._descend()
        self._settle_without_closure()
        d = low.shape[2]
        axes = np.broadcast_to(directions(d, 0), (len(self.indices), 2 * d, d))
        points, variables = self._inner_points(np.concatenate([low[self.indices], axes], axis=1))[1:]
        rounding = [vertex_rounding(self.wrenches[i].transformed(self.matrix)) for i in self.indices]
        hulls = StackedHulls(points, variables, np.reshape(rounding, (len(rounding), variables.shape[2], d)))
        while len(self.indices):
            hulls.measure(self.task)
            least, normals = hulls.lowest()
            is_done = least >= self._target()
            remaining = ~hulls.failed & ~is_done
            few = TAIL if hulls.count >= TAIL_POINTS else 0
            is_last = hulls.count >= MOST_POINTS or np.sum(remaining) <= few
            if is_last or np.sum(remaining) < COMPACT * len(remaining):
                self._settle(hulls, is_done & ~hulls.failed)
                self._keep(remaining)
                hulls.keep(remaining)
                normals, least, remaining = normals[remaining], least[remaining], remaining[remaining]
            if is_last:
                break
            ratio, points, variables = self._inner_points(normals[:, None])
            self._improve(ratio[:, 0], normals)
            is_inserted = hulls.insert(points[:, 0], variables[:, 0], remaining)
            hulls.failed |= remaining & ~is_inserted & (least < self._target())
        return self.result

    def _target(self) -> FloatArray:
        """Return the lower bounds, (b,), at which grasps are settled, with a margin for the certificate."""
        return np.asarray(self.upper / (1.0 + 0.8 * self.rtol))

    def _ratios(self, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return ``phi / phi_A`` (b, m), and variables (b, m, l) of maximising forces, along unit u (b, m, d)."""
        phi, variables = self.batch.variables(u)
        reach = self.task.support(u.reshape(-1, u.shape[2]))[0].reshape(phi.shape)
        is_positive = reach > 1e-12
        return np.where(is_positive, phi / np.where(is_positive, reach, 1.0), np.inf), variables

    def _descend(self) -> FloatArray:
        """Set the first upper bounds by descents from the weakest sampled directions; return the descents' ends."""
        b, d = self.batch.G.shape[:2]
        spread = directions_around(np.eye(3)[0], PLANAR) if d == 3 else directions(d, 2)
        ratios = self._ratios(np.broadcast_to(spread, (b, *spread.shape)))[0]
        weakest = np.argpartition(ratios, DESCENTS, axis=1)[:, :DESCENTS]
        low, _ = minimise_by_inverse_iteration(lambda u: self.batch.quadratic(u, self.task), spread[weakest], STEPS)
        low /= np.linalg.norm(low, axis=2, keepdims=True)
        values = self._ratios(low)[0]
        best = np.argmin(values, axis=1)
        self.upper, self.worst = values[np.arange(b), best], low[np.arange(b), best]
        return np.asarray(low)

    def _settle_without_closure(self) -> None:
        """Settle the grasps whose worst direction proves that mu is 0, and drop those of almost no quality.

        Dropped grasps have no bounds and are left to ``sandwich``.
        """
        is_separated = self.batch.positive_share(self.worst[:, None])[:, 0] <= ZERO_SUPPORT
        is_finite = np.isfinite(self.upper)
        for i in np.flatnonzero(is_separated & is_finite).tolist():
            self.result[i] = Bounds(0.0, 0.0, self._direction(i), trust=NO_WORK)
        middle = float(np.median(self.upper[is_finite])) if is_finite.any() else 0.0
        self._keep(is_finite & ~is_separated & (self.upper > LEAST_QUALITY * middle))

    def _inner_points(self, u: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return ratios (b, m), support points (b, m, d) and their variables (b, m, l) in unit directions (b, m, d).

        Points and variables are shrunk towards the origin by small random factors.
        """
        ratio, variables = self._ratios(u)
        variables = variables * (1.0 - self.shrink * self.random.random((*u.shape[:2], 1)))
        return ratio, self.batch.exert(variables), variables

    def _improve(self, ratio: FloatArray, normals: FloatArray) -> None:
        is_better = ratio < self.upper
        self.upper = np.where(is_better, ratio, self.upper)
        self.worst = np.where(is_better[:, None], normals, self.worst)

    def _settle(self, hulls: StackedHulls, is_done: Mask) -> None:
        """Certify the hulls of settled grasps, and record bounds that are as narrow as ``rtol``."""
        done = np.flatnonzero(is_done)
        variables = hulls.variables(done)
        inside = self.domain.into(variables.reshape(-1, variables.shape[2])).reshape(variables.shape)
        for row, u in zip(done.tolist(), inside, strict=True):
            wrenches, y = self.wrenches[self.indices[row]], self._direction(row)
            if self.upper[row] == 0.0:
                self.result[self.indices[row]] = Bounds(0.0, 0.0, y, trust=NO_WORK)
                continue
            cells, planes = hulls.cells(row)
            lower = provable_lower(wrenches, u, cells, planes @ self.matrix, self.given_task)
            upper, _ = provable_upper(wrenches, self.domain, y, self.given_task)
            if upper <= lower * (1.0 + self.rtol):
                self.result[self.indices[row]] = Bounds(min(lower, upper), upper, y, trust=self.trust)

    def _direction(self, row: int) -> FloatArray:
        """Return a grasp's worst direction, (d,), as a unit vector in the coordinates as given."""
        y = self.worst[row] @ self.matrix
        return np.asarray(y / np.linalg.norm(y))

    def _keep(self, rows: Mask) -> None:
        self.indices, self.upper, self.worst = self.indices[rows], self.upper[rows], self.worst[rows]
        self.batch = self.batch.of(rows)


@dataclass(frozen=True)
class _Horizon:
    """Ridges between removed and remaining cells, each as a side of a removed cell."""

    row: IntArray  # (r,), of grasps
    slot: IntArray  # (r,), of the removed cells
    cells: IntArray  # (r, d), vertices of the removed cells
    corner: IntArray  # (r,), corners of these cells that are opposite the ridges


class StackedHulls:
    """Inner hulls of b grasps as in ``IncrementalHull``, in shared arrays.

    Parameters
    ----------
    points : (b, m, d) array
        First vertices.
    variables : (b, m, l) array
        Of the finger forces that exert them.
    sizes : (b, l, d) array
        Rounding errors of a vertex for unit variables.

    Attributes
    ----------
    centre : (b, d) array
        Means of the first vertices.
    planes : (b, f, d) array
        Rows a of ``{x : <a, x - centre> = 1}``; zero for removed cells.
    values : (b, f) array
        The alpha that each cell allows; infinite for removed cells.
    failed : (b,) array of bool
        Hulls that are flat or degenerate.
    """

    def __init__(self, points: FloatArray, variables: FloatArray, sizes: FloatArray) -> None:
        b, self.count, d = points.shape
        self._rounding = sizes
        self._error: FloatArray = np.max(np.abs(variables) @ sizes, axis=1, initial=0.0)
        self.centre = points.mean(axis=1)
        self.failed = np.zeros(b, dtype=bool)
        self._points = np.zeros((b, MOST_POINTS + 1, d))
        self._points[:, : self.count] = points - self.centre[:, None]
        self._variables = np.zeros((b, MOST_POINTS + 1, variables.shape[2]))
        self._variables[:, : self.count] = variables
        random = np.random.default_rng(0)
        self._names = _random_keys(random, MOST_POINTS + 1)  # of vertices
        self._marks = _random_keys(random, b)  # of grasps: no two have a key in common
        first = [_facets(p) for p in points]
        self._sizes = np.array([len(cells) for cells in first], dtype=np.intp)
        most = max((len(cells) for cells in first), default=0) or 1
        self._cells = np.zeros((b, most, d), dtype=np.intp)
        for i, cells in enumerate(first):
            self._cells[i, : len(cells)] = cells
        self._inverses, self.planes = np.zeros((b, most, d, d)), np.zeros((b, most, d))
        self.values = np.full((b, most), np.inf)
        self._new: tuple[IntArray, ...] = np.nonzero(np.arange(most) < self._sizes[:, None])
        row, slot = self._new
        corners = self._points[row[:, None], self._cells[row, slot]]
        volume = np.prod(np.linalg.norm(corners, axis=2), axis=1)
        is_singular = np.abs(np.linalg.det(corners)) <= FLAT * volume
        self.failed[row[is_singular]] = True
        self.failed[row[self._odd_ridges(row, self._cells[row, slot]) // d]] = True  # facets that do not close
        self.failed |= self._sizes == 0
        self._inverses[row, slot] = np.linalg.inv(np.where(is_singular[:, None, None], np.eye(d), corners))
        self.planes[row, slot] = self._inverses[row, slot].sum(axis=2)
        self._check_heights(row, self._cells[row, slot], self.planes[row, slot])
        # the first cells surround the centre: an odd number of them meets a ray
        coordinates = random.standard_normal(d) @ self._inverses[row, slot]
        least = np.min(coordinates, axis=1) / np.max(np.abs(coordinates), axis=1)
        self.failed |= np.bincount(row[least > 0.0], minlength=b) % 2 == 0
        self.failed[row[np.abs(least) < LEAST_PIVOT]] = True

    def _check_heights(self, row: IntArray, cells: IntArray, planes: FloatArray) -> None:
        """Note hulls with cells that rounding may turn over the centre: a vertex may replace no such cell."""
        self.failed[row[~are_off_centre(self._points[row[:, None], cells], planes, self._error[row])]] = True

    def measure(self, task: Task) -> None:
        """Set the values of new cells: the largest multiple of the task that each cell allows."""
        row, slot = self._new
        planes = self.planes[row, slot]
        self.values[row, slot] = _values(task, planes, 1.0 + np.sum(planes * self.centre[row], axis=1))

    def lowest(self) -> tuple[FloatArray, FloatArray]:
        """Return the least value of each hull, (b,), and its cell's unit normal, (b, d)."""
        row = np.arange(len(self.values))
        slot = np.argmin(self.values, axis=1)
        planes = self.planes[row, slot]
        return self.values[row, slot], planes / np.maximum(np.linalg.norm(planes, axis=1, keepdims=True), 1e-300)

    def insert(self, points: FloatArray, variables: FloatArray, chosen: Mask) -> Mask:
        """Insert a vertex (b, d) of variables (b, l) into each chosen hull; return where it was outside, (b,)."""
        p = points - self.centre
        height = (self.planes @ p[:, :, None])[:, :, 0]
        removed_row, removed_slot = np.nonzero((height > 1.0 + BEYOND) & chosen[:, None])
        removed = removed_row, removed_slot
        horizon = self._horizon(*removed)
        row, corner = horizon.row, horizon.corner
        index = np.arange(len(row))
        inverse = self._inverses[row, horizon.slot]
        coordinates = (p[row][:, None, :] @ inverse)[:, 0]  # of the new vertex in each removed cell's vertices
        pivot = coordinates[index, corner]
        is_degenerate = np.abs(pivot) < LEAST_PIVOT
        self.failed[row[is_degenerate]] = True
        column = inverse[index, :, corner] / np.where(is_degenerate, 1.0, pivot)[:, None]
        coordinates[index, corner] -= 1.0
        planes = self.planes[row, horizon.slot] + (1.0 - height[row, horizon.slot])[:, None] * column
        horizon.cells[index, corner] = self.count
        self._points[:, self.count], self._variables[:, self.count] = p, variables
        self._error = np.maximum(self._error, (np.abs(variables)[:, None] @ self._rounding)[:, 0])
        self._check_heights(row, horizon.cells, planes)
        self.count += 1
        slot = self._slots(removed, row)
        self._cells[row, slot] = horizon.cells
        self._inverses[row, slot] = inverse - column[:, :, None] * coordinates[:, None, :]
        self.planes[row, slot] = planes
        self._new = row, slot
        return np.asarray(np.bincount(removed_row, minlength=len(p)) > 0)

    def _horizon(self, row: IntArray, slot: IntArray) -> _Horizon:
        """Return the ridges around the removed cells, sorted by grasp."""
        cells = self._cells[row, slot]
        single = self._odd_ridges(row, cells)
        cell, corner = np.divmod(single, cells.shape[1])
        return _Horizon(row[cell], slot[cell], cells[cell], corner)

    def _odd_ridges(self, row: IntArray, cells: IntArray) -> IntArray:
        """Return the ridges that an odd number of cells (m, d) of a grasp share.

        They are indexed by cell and corner.
        """
        names = self._names[cells]
        keys = ((names.sum(axis=1) + self._marks[row])[:, None] - names).ravel()  # of the ridge opposite each vertex
        order = np.argsort(keys)
        is_first = np.ones(len(keys), dtype=bool)
        is_first[1:] = keys[order[1:]] != keys[order[:-1]]
        first = np.flatnonzero(is_first)
        return np.sort(order[first[np.diff(first, append=len(keys)) % 2 == 1]])

    def _slots(self, removed: tuple[IntArray, IntArray], row: IntArray) -> IntArray:
        """Return storage slots of new cells, sorted by grasp: those of removed cells first."""
        self.planes[removed], self.values[removed] = 0.0, np.inf
        removed_counts, counts = (np.bincount(rows, minlength=len(self.planes)) for rows in (removed[0], row))
        position = np.arange(len(row)) - (np.cumsum(counts) - counts)[row]
        first_removed = (np.cumsum(removed_counts) - removed_counts)[row]
        slot = self._sizes[row] + position - removed_counts[row]
        is_reused = position < removed_counts[row]
        slot[is_reused] = removed[1][(first_removed + position)[is_reused]]
        self._sizes += np.maximum(counts - removed_counts, 0)
        self.failed |= self._sizes > MOST_CELLS
        extra = int(np.max(self._sizes)) - self.planes.shape[1]
        if extra > 0:
            b, _, d = self.planes.shape
            extra += self.planes.shape[1] // 2
            self._cells = np.concatenate([self._cells, np.zeros((b, extra, d), dtype=np.intp)], axis=1)
            self._inverses = np.concatenate([self._inverses, np.zeros((b, extra, d, d))], axis=1)
            self.planes = np.concatenate([self.planes, np.zeros((b, extra, d))], axis=1)
            self.values = np.concatenate([self.values, np.full((b, extra), np.inf)], axis=1)
        return slot

    def keep(self, rows: Mask) -> None:
        """Keep the hulls in a mask, and remove the others."""
        self.centre, self.failed = self.centre[rows], self.failed[rows]
        self._points, self._variables = self._points[rows], self._variables[rows]
        self._rounding, self._error = self._rounding[rows], self._error[rows]
        self._marks, self._sizes = self._marks[rows], self._sizes[rows]
        most = int(np.max(self._sizes, initial=1))
        self._cells, self._inverses = self._cells[rows, :most], self._inverses[rows, :most]
        self.planes, self.values = self.planes[rows, :most], self.values[rows, :most]

    def variables(self, rows: IntArray) -> FloatArray:
        """Return the variables (len(rows), v, l) of the forces that exert the vertices of hulls."""
        return self._variables[rows, : self.count]

    def cells(self, row: int) -> tuple[IntArray, FloatArray]:
        """Return the vertices (f, d) of a hull's cells, and their planes (f, d)."""
        live = np.any(self.planes[row] != 0.0, axis=1)
        return self._cells[row, live], self.planes[row, live]


def _values(task: Task, planes: FloatArray, offsets: FloatArray) -> FloatArray:
    """Return the largest multiples of a task, (f,), that half-spaces contain with all smaller ones."""
    reach = task.support(planes)[0]
    is_beyond = reach > 0.0
    beside = np.where(offsets < -BEYOND, 0.0, np.inf)
    return np.where(is_beyond, np.maximum(offsets, 0.0) / np.where(is_beyond, reach, 1.0), beside)


def _random_keys(random: np.random.Generator, count: int) -> NDArray[np.uint64]:
    """Return random keys, (count,), whose sums identify sets of vertices."""
    return random.integers(0, 2**63, size=count, dtype=np.uint64)


def _facets(points: FloatArray) -> IntArray:
    """Return the facets (f, d) of the hull of points (n, d); an empty array for flat points."""
    try:
        return np.asarray(ConvexHull(points).simplices, dtype=np.intp)
    except QhullError:
        return np.zeros((0, points.shape[1]), dtype=np.intp)
