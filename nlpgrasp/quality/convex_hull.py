"""Incremental convex hull by the beneath-beyond method (Barber et al. 1996, doi:10.1145/235815.235821).

Qhull fails on degenerate points, its incremental mode with the whole process, and rebuilding each round would take most
of a certificate's time. Bounds do not rely on exact combinatorics: the cells are simplices with vertices in the set
that surround the centre, and replacing any set of cells by the cone of the new point over that set's boundary surrounds
it again. Rounding can therefore only widen a bound.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.common.validation import BoolArray, FloatArray, IntArray

LEAST_DROP = 1e-3  # difference of two heights below which planes are solved for directly
FLAT = 1e-13  # distance from the others' affine hull, relative to the first, below which points are flat
AT_ORIGIN = 1e-9  # offset of a plane, relative to the centre's distance, below which it passes through the origin
LEAST_HEIGHT = 0.5  # least height of a cell over its plane's nominal height 1
BEYOND = 1e-9  # relative height above a plane from which a point counts as beyond it
MOST_NEW_CELLS = (
    8_000  # cells per new vertex above which rounding has failed (in 6 dimensions some hundreds are normal)
)


class IncrementalHull:
    """Incremental convex hull, as simplicial cells around a centre, that is to contain a multiple of a set A.

    A cell's plane is ``{x : <a, x - centre> = 1}``.

    Parameters
    ----------
    points : (m, d) array
        First vertices, d at least 2.
    variables : (m, l) array
        Of the finger forces that exert the first vertices.
    reach : callable
        Support function of A: maps directions (f, d) to values (f,).
    sizes : (l, d) array
        Rounding errors of a vertex for unit variables.

    Attributes
    ----------
    centre : (d,) array
        Mean of the corners of a large simplex of the first vertices.
    planes : (f, d) array
        Rows a; zero for removed cells.
    values : (f,) array
        ``phi_A(a)`` of the cells' planes; zero for removed cells; those of new cells are set when ``insert`` returns.
    is_sound : bool
        Whether all cells that were ever made are off the centre in spite of rounding. Only then do the cells surround
        the centre: a vertex may replace those alone (docs/proof_format.md).

    Raises
    ------
    numpy.linalg.LinAlgError
        When the first points are (nearly) flat.
    """

    def __init__(
        self,
        points: FloatArray,
        variables: FloatArray,
        reach: Callable[[FloatArray], FloatArray],
        sizes: FloatArray,
    ) -> None:
        self._reach, self._sizes = reach, sizes
        self._error: FloatArray = np.max(np.abs(variables), axis=0) @ sizes
        corners = _large_simplex(points)
        self._variables = [variables[corners]]
        self._dimension: int = points.shape[1]
        self._count = size = len(corners)
        self.centre: FloatArray = np.mean(points[corners], axis=0)
        self._points = points[corners] - self.centre
        self._random = np.random.default_rng(0)
        self._names = self._new_names(size)
        # the cell opposite a vertex has the others as corners; across the ridge opposite each is the cell opposite it
        self._cells: IntArray = np.array([[i for i in range(size) if i != j] for j in range(size)], dtype=np.intp)
        self._neighbours = self._cells.copy()
        self._other_slots: IntArray = self._cells[:-1, :-1].copy()  # of each slot of a cell
        self.planes: FloatArray = np.linalg.solve(self._points[self._cells], np.ones((size, size - 1, 1)))[:, :, 0]
        self.values = reach(self.planes)
        self.is_sound, self._made = True, [(self._cells.copy(), self.planes.copy())]
        self._marked = np.zeros(size, dtype=bool)
        self._size = size
        self._free: IntArray = np.zeros(0, dtype=np.intp)
        self.insert(np.delete(points, corners, axis=0), np.delete(variables, corners, axis=0))

    def __len__(self) -> int:
        """Return the number of vertices."""
        return self._count

    def cell_planes(self) -> FloatArray:
        """Return the planes (f, d) of the cells."""
        return self.planes[: self._size][np.any(self.planes[: self._size] != 0.0, axis=1)]

    def exceeded(self, scale: float, limit: int) -> tuple[IntArray, FloatArray]:
        """Return at most ``limit`` cells above whose planes ``scale A`` reaches, worst first, and their shares.

        A share is that of ``scale`` whose multiple of A is below the plane. Planes through the origin allow no multiple
        of A; these are ranked by one over the height ``max <a, x - centre>`` of ``scale A``, seen from the centre.
        """
        planes, reach = self.planes[: self._size], self.values[: self._size]
        offsets = 1.0 + planes @ self.centre
        cells = np.flatnonzero(scale * reach > offsets)
        offsets, required = offsets[cells], scale * reach[cells]
        is_positive = (offsets > AT_ORIGIN) & (required > 0.0)
        shares = np.where(is_positive, offsets / np.where(is_positive, required, 1.0), 1.0 / (1.0 + required - offsets))
        if cells.size > limit:
            worst = np.argpartition(shares, limit - 1)[:limit]
            cells, shares = cells[worst], shares[worst]
        order = np.argsort(shares)
        return cells[order], shares[order]

    def normals(self, cells: IntArray) -> FloatArray:
        """Return the unit normals of cells, (m, d)."""
        planes = self.planes[cells]
        return np.asarray(planes / np.linalg.norm(planes, axis=1, keepdims=True))

    def vertices(self) -> tuple[FloatArray, IntArray]:
        """Return the variables (v, l) of the forces that exert the vertices, and each cell's vertices (f, d)."""
        live = np.any(self.planes[: self._size] != 0.0, axis=1)
        return np.concatenate(self._variables), self._cells[: self._size][live]

    def insert(self, points: FloatArray, variables: FloatArray) -> bool:
        """Insert vertices (m, d) exerted by forces of variables (m, l); return whether any was outside."""
        added = [self._insert(p) for p in points - self.centre]
        self._variables.append(variables[added])
        if any(added):
            self._check_heights(np.max(np.abs(variables), axis=0) @ self._sizes)
        new = np.flatnonzero(np.isnan(self.values[: self._size]))
        self.values[new] = self._reach(self.planes[new])
        return any(added)

    def _check_heights(self, error: FloatArray) -> None:
        """Note whether new cells are off the centre in spite of rounding, at most ``error`` (d,) at a vertex."""
        self._error = np.maximum(self._error, error)
        cells, planes = (np.concatenate(parts) for parts in zip(*self._made, strict=True))
        self._made.clear()
        self.is_sound &= bool(np.all(are_off_centre(self._points[cells], planes, self._error)))

    def _insert(self, p: FloatArray) -> bool:
        """Insert a vertex without computing the new cells' values; return whether it was inserted.

        The vertex is relative to the centre.
        """
        height = self.planes[: self._size] @ p
        visible = (height > 1.0 + BEYOND).nonzero()[0]
        if not visible.size:
            return False
        self._marked[visible] = True
        neighbours = self._neighbours[visible]
        row, slot = (~self._marked[neighbours]).nonzero()
        self._marked[visible] = False
        if len(row) > MOST_NEW_CELLS:
            return False
        # the horizon: cells on either side of each of its ridges
        visible_cells, hidden_cells = visible[row], neighbours[row, slot]
        index = np.arange(len(visible_cells))
        cells = self._cells[visible_cells]
        cells[index, slot] = self._count
        self._append(p)
        pairs = self._match_ridges(cells, slot)
        if pairs is None:  # rounding tore the horizon: leave everything as it was
            self._count -= 1
            return False
        back_slots = (self._neighbours[hidden_cells] == visible_cells[:, None]).argmax(axis=1)
        planes = self._new_planes(height, visible_cells, hidden_cells, cells)
        self._made.append((cells, planes))
        new = self._slots(visible, len(visible_cells))
        rows, slots, partner = pairs
        self._neighbours[new, slot] = hidden_cells
        self._neighbours[new[rows], slots] = new[partner]
        self._neighbours[hidden_cells, back_slots] = new
        self._cells[new] = cells
        self.planes[new] = planes
        self.values[new] = np.nan
        return True

    def _new_planes(
        self, height: FloatArray, visible_cells: IntArray, hidden_cells: IntArray, cells: IntArray
    ) -> FloatArray:
        """Return the planes through the horizon's ridges and the new point, interpolated from adjacent cells."""
        drop = height[visible_cells] - height[hidden_cells]
        fraction = ((height[visible_cells] - 1.0) / drop)[:, None]
        planes = (1.0 - fraction) * self.planes[visible_cells] + fraction * self.planes[hidden_cells]
        nearly_equal = (drop < LEAST_DROP).nonzero()[0]
        if nearly_equal.size:  # the two planes hardly differ at the new point: solve for the vertices themselves
            with contextlib.suppress(np.linalg.LinAlgError):
                corners = self._points[cells[nearly_equal]]
                solved = np.linalg.solve(corners, np.ones((*corners.shape[:2], 1)))[:, :, 0]
                is_finite = np.all(np.isfinite(solved), axis=1)
                planes[nearly_equal[is_finite]] = solved[is_finite]
        return planes

    def _match_ridges(self, cells: IntArray, outer: IntArray) -> tuple[IntArray, IntArray, IntArray] | None:
        """Return the pairs of new cells that share a ridge; None if some ridge is unmatched.

        For each ridge of each cell but the one opposite the slot ``outer``: row of the cell, slot of the vertex
        opposite, and row of the other cell.
        """
        names = self._names[cells]
        slots = self._other_slots[outer]
        rows = np.arange(len(cells)).repeat(slots.shape[1])
        slots = slots.ravel()
        keys = names.sum(axis=1)[rows] - names[rows, slots]  # of the ridge opposite each vertex
        order = keys.argsort()
        first, second = order[0::2], order[1::2]
        if len(first) != len(second) or not np.array_equal(keys[first], keys[second]):
            return None
        partner = np.empty(len(rows), dtype=np.intp)
        partner[first], partner[second] = rows[second], rows[first]
        return rows, slots, partner

    def _slots(self, removed: IntArray, count: int) -> IntArray:
        """Return storage indices for new cells, reusing those of removed cells."""
        self.planes[removed] = 0.0
        self.values[removed] = 0.0
        pool = np.concatenate([removed, self._free])
        if pool.size < count:
            end = self._size + count - pool.size
            if end > len(self.planes):
                self._enlarge(2 * end)
            pool = np.concatenate([pool, np.arange(self._size, end)])
            self._size = end
        self._free = pool[count:]
        return pool[:count]

    def _enlarge(self, size: int) -> None:
        extra = size - len(self.planes)
        self.planes = np.concatenate([self.planes, np.zeros((extra, self._dimension))])
        self.values = np.concatenate([self.values, np.zeros(extra)])
        for name in ("_cells", "_neighbours"):
            old = getattr(self, name)
            setattr(self, name, np.concatenate([old, np.zeros((extra, self._dimension), dtype=np.intp)]))
        self._marked = np.zeros(size, dtype=bool)

    def _append(self, p: FloatArray) -> None:
        if self._count == len(self._points):
            self._points = np.concatenate([self._points, np.zeros_like(self._points)])
            self._names = np.concatenate([self._names, self._new_names(self._count)])
        self._points[self._count] = p
        self._count += 1

    def _new_names(self, count: int) -> NDArray[np.uint64]:
        return self._random.integers(0, 2**63, size=count, dtype=np.uint64)


def are_off_centre(corners: FloatArray, planes: FloatArray, error: FloatArray) -> BoolArray:
    """Return which cells (f,) are off the centre in spite of rounding.

    Their vertices (f, d, d), off by at most ``error`` (d,) or (f, d), are well above 0 along their planes (f, d).
    """
    heights = np.min((corners @ planes[:, :, None])[:, :, 0], axis=1)
    return np.asarray((heights > LEAST_HEIGHT) & (np.sum(np.abs(planes) * error, axis=1) < LEAST_HEIGHT / 2.0))


def _large_simplex(points: FloatArray) -> list[int]:
    """Return indices of d + 1 of the points (m, d), each the farthest from the affine hull of those before."""
    corners = [int(np.argmax(np.linalg.norm(points - points.mean(axis=0), axis=1)))]
    rest = points - points[corners[0]]
    size = np.max(np.linalg.norm(rest, axis=1))
    for _ in range(points.shape[1]):
        distances = np.linalg.norm(rest, axis=1)
        corners.append(int(np.argmax(distances)))
        if not distances[corners[-1]] > FLAT * size:
            raise np.linalg.LinAlgError("points that are flat")
        axis = rest[corners[-1]] / distances[corners[-1]]
        rest = rest - np.outer(rest @ axis, axis)
    return corners
