"""Incremental convex hull by the beneath-beyond method (Barber et al. 1996, doi:10.1145/235815.235821).

Qhull's incremental mode aborts the process on degenerate input, and rebuilding each round would take most of a
certificate's time. Bounds do not rely on exact combinatorics: the cells are simplices with vertices in the set that
surround the centre, and replacing any set of cells by the cone of the new point over that set's boundary surrounds it
again. Rounding can therefore only widen a bound.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from nlpgrasp.common.validation import FloatArray

Indices = NDArray[np.intp]
ILL = 1e-3  # difference of two heights below which planes are solved for directly
BEYOND = 1e-9  # relative height above a plane from which a point counts as beyond it
MOST_NEW = 8_000  # cells per new vertex above which rounding has failed (some hundreds are normal in 6 dimensions)


class Hull:
    """Incremental hull: simplicial cells around a centre, with planes ``{x : <a, x - centre> = 1}`` and values.

    Parameters
    ----------
    points : (m, d) array
        First vertices, d at least 2.
    measure : callable
        Maps planes (f, d) and the centre (d,) to the cells' values (f,); the smallest are refined first.

    Attributes
    ----------
    centre : (d,) array
        Mean of the first vertices.
    planes : (f, d) array
        Rows a; zero for removed cells.
    values : (f,) array
        Infinite for removed cells; those of new cells are set when ``insert`` returns.

    Raises
    ------
    scipy.spatial.QhullError
        When the first points are (nearly) flat.
    """

    def __init__(self, points: FloatArray, measure: Callable[[FloatArray, FloatArray], FloatArray]) -> None:
        self._measure = measure
        self.centre: FloatArray = np.mean(points, axis=0)
        self._points = points - self.centre
        self._count: int = len(points)
        self._dimension: int = points.shape[1]
        self._random = np.random.default_rng(0)
        self._names = self._new_names(self._count)
        self._cells: Indices = np.asarray(ConvexHull(points).simplices, dtype=np.intp)
        self._near = self._first_neighbours()
        try:
            corners = self._points[self._cells]
            self.planes: FloatArray = np.linalg.solve(corners, np.ones((*self._cells.shape, 1)))[:, :, 0]
        except np.linalg.LinAlgError:
            raise QhullError("a facet whose plane passes through the centre") from None
        self.values = measure(self.planes, self.centre)
        self._marked = np.zeros(len(self.planes), dtype=bool)
        self._size = len(self.planes)
        self._free: Indices = np.zeros(0, dtype=np.intp)

    def __len__(self) -> int:
        """Return the number of vertices."""
        return self._count

    def corners(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the cells' vertices relative to the centre (f, d, d), their planes (f, d) and heights (f,).

        A height is the least ``<a, v - centre>`` over a cell's own vertices: 1 up to rounding.
        """
        live = np.any(self.planes[: self._size] != 0.0, axis=1)
        corners = self._points[self._cells[: self._size][live]]
        planes = self.planes[: self._size][live]
        return corners, planes, np.min(np.einsum("fvd,fd->fv", corners, planes), axis=1)

    def worst(self, below: float, most: int) -> Indices:
        """Return the indices of at most ``most`` cells with values below a threshold, smallest first."""
        values = self.values[: self._size]
        cells = np.flatnonzero(values < below)
        if cells.size > most:
            cells = cells[np.argpartition(values[cells], most - 1)[:most]]
        return cells[np.argsort(values[cells])]

    def normals(self, cells: Indices) -> FloatArray:
        """Return the unit normals of cells, (m, d)."""
        planes = self.planes[cells]
        return np.asarray(planes / np.linalg.norm(planes, axis=1, keepdims=True))

    def insert(self, points: FloatArray) -> bool:
        """Insert vertices (m, d); return whether any was outside and could be inserted."""
        added = [self._insert(p) for p in points - self.centre]
        new = np.flatnonzero(np.isnan(self.values[: self._size]))
        self.values[new] = self._measure(self.planes[new], self.centre)
        return any(added)

    def _insert(self, p: FloatArray) -> bool:
        """Insert a vertex relative to the centre, leaving its cells' values unset; return whether it was inserted."""
        height = self.planes[: self._size] @ p
        seen = np.flatnonzero(height > 1.0 + BEYOND)
        if not seen.size:
            return False
        self._marked[seen] = True
        near = self._near[seen]
        row, slot = np.nonzero(~self._marked[near])
        self._marked[seen] = False
        if len(row) > MOST_NEW:
            return False
        old, outer = seen[row], near[row, slot]  # the horizon: cells on either side of each of its ridges
        index = np.arange(len(old))
        cells = self._cells[old]
        cells[index, slot] = self._count
        self._append(p)
        inner = np.ones(cells.shape, dtype=bool)
        inner[index, slot] = False
        pairs = self._pairs(cells, inner)
        if pairs is None:  # rounding tore the horizon: leave everything as it was
            self._count -= 1
            return False
        back = np.argmax(self._near[outer] == old[:, None], axis=1)
        planes = self._new_planes(height, old, outer, cells)
        new = self._slots(seen, len(old))
        rows, slots, partner = pairs
        self._near[new, slot] = outer
        self._near[new[rows], slots] = new[partner]
        self._near[outer, back] = new
        self._cells[new] = cells
        self.planes[new] = planes
        self.values[new] = np.nan
        return True

    def _new_planes(self, height: FloatArray, old: Indices, outer: Indices, cells: Indices) -> FloatArray:
        """Return the planes through the horizon's ridges and the new point, interpolated from adjacent cells."""
        drop = height[old] - height[outer]
        share = ((height[old] - 1.0) / drop)[:, None]
        planes = (1.0 - share) * self.planes[old] + share * self.planes[outer]
        close = np.flatnonzero(drop < ILL)
        if close.size:  # the two planes hardly differ at the new point: solve for the vertices themselves
            with contextlib.suppress(np.linalg.LinAlgError):
                corners = self._points[cells[close]]
                solved = np.linalg.solve(corners, np.ones((*corners.shape[:2], 1)))[:, :, 0]
                good = np.all(np.isfinite(solved), axis=1)
                planes[close[good]] = solved[good]
        return planes

    def _pairs(self, cells: Indices, inner: NDArray[np.bool_]) -> tuple[Indices, Indices, Indices] | None:
        """Match the ridges shared by cells: rows, slots and opposite rows; None if some ridge is unmatched."""
        names = self._names[cells]
        keys = names.sum(axis=1)[:, None] - names  # of the ridge opposite each vertex
        rows, slots = np.nonzero(inner)
        keys = keys[rows, slots]
        order = np.argsort(keys)
        one, other = order[0::2], order[1::2]
        if len(one) != len(other) or not np.array_equal(keys[one], keys[other]):
            return None
        partner = np.empty(len(rows), dtype=np.intp)
        partner[one], partner[other] = rows[other], rows[one]
        return rows, slots, partner

    def _first_neighbours(self) -> Indices:
        """Return the neighbour across the ridge opposite each vertex, for Qhull's cells."""
        cells = self._cells
        pairs = self._pairs(cells, np.ones(cells.shape, dtype=bool))
        if pairs is None:
            raise QhullError("facets that do not close")
        rows, slots, partner = pairs
        near = np.empty(cells.shape, dtype=np.intp)
        near[rows, slots] = partner
        return near

    def _slots(self, gone: Indices, wanted: int) -> Indices:
        """Return storage indices for new cells, reusing those of removed cells."""
        self.planes[gone] = 0.0
        self.values[gone] = np.inf
        pool = np.concatenate([gone, self._free])
        if pool.size < wanted:
            end = self._size + wanted - pool.size
            if end > len(self.planes):
                self._enlarge(2 * end)
            pool = np.concatenate([pool, np.arange(self._size, end)])
            self._size = end
        self._free = pool[wanted:]
        return pool[:wanted]

    def _enlarge(self, size: int) -> None:
        extra = size - len(self.planes)
        self.planes = np.concatenate([self.planes, np.zeros((extra, self._dimension))])
        self.values = np.concatenate([self.values, np.full(extra, np.inf)])
        for name in ("_cells", "_near"):
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
