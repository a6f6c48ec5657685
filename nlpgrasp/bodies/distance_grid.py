"""Distance of a body on a grid: values for thousands of points at once, and a smooth surface with two derivatives."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.bodies.base import Body
from nlpgrasp.common.validation import FloatArray, IntArray

Field = NDArray[np.float32]  # one value for each grid point


def distance_grid(body: Body) -> DistanceGrid:
    """Return the distance of a body in space on a grid that reaches 30 mm beyond it, made once a body."""
    kept = vars(body)  # bodies leave it out of their state
    if "distance_grid" not in kept:
        kept["distance_grid"] = DistanceGrid(body, 0.03)
    grid: DistanceGrid = kept["distance_grid"]
    return grid


class DistanceGrid:
    """Signed distance of a body on a regular grid about it, metres, negative inside.

    It is known from the body's own fields on tensor grids (``Body.distance_on_grid`` and the like), so that no kind of
    body is named here. Beyond the grid it is at most the true one: as the grid's box is convex, that of a point x is at
    least the root of ``d(c)^2 + |x - c|^2`` with the box's nearest point c.

    Parameters
    ----------
    body : Body
        In space.
    margin : float
        How far the grid reaches beyond the body, metres.
    points : int
        Number of grid points, about.
    """

    def __init__(self, body: Body, margin: float, points: int = 300_000) -> None:
        sides = np.ptp(body.bounds, axis=0) + 2.0 * margin
        self.spacing = float((np.prod(sides) / points) ** (1.0 / 3.0))
        self._corner = body.bounds[0] - margin
        self._shape = np.ceil(sides / self.spacing).astype(np.int64) + 1
        self._strides = np.array([self._shape[1] * self._shape[2], self._shape[2], 1])
        # of a cell's corners from its first one; the bits of their numbers are x, y and z
        self._offsets = np.array([np.dot(self._strides, [c >> 2, c >> 1 & 1, c & 1]) for c in range(8)])
        axes = [self._corner[i] + self.spacing * np.arange(self._shape[i]) for i in range(3)]
        edges, smooth = body.edge_distance_on_grid(axes), body.smooth_distance_on_grid(axes)
        self._values: Field = body.distance_on_grid(axes).astype(np.float32).ravel()
        self._edges: Field | None = None if edges is None else edges.astype(np.float32).ravel()
        # value, slopes and the upper triangle of curvatures
        self._smooth: Field = np.empty((smooth.size, 10), dtype=np.float32)
        self._smooth[:, 0] = smooth.ravel()
        for i, slope in enumerate(np.gradient(smooth, self.spacing)):
            self._smooth[:, 1 + i] = slope.ravel()
        for k, (row, column) in enumerate(zip(*np.triu_indices(3), strict=True), start=4):
            slope = np.gradient(smooth, self.spacing, axis=row)
            self._smooth[:, k] = np.gradient(slope, self.spacing, axis=column).ravel()

    def nearest(self, points: FloatArray) -> FloatArray:
        """Return the distance at the grid point nearest to each point (..., 3), metres: quick, and off by a cell."""
        index = np.zeros(points.shape[:-1], dtype=np.int32)
        for axis in range(3):
            cell = points[..., axis] * (1.0 / self.spacing) + float(0.5 - self._corner[axis] / self.spacing)
            np.clip(cell, 0.0, self._shape[axis] - 0.5, out=cell)
            index += cell.astype(np.int32) * np.int32(self._strides[axis])
        return np.asarray(self._values[index])

    def beyond(self, points: FloatArray) -> FloatArray:
        """Return the distance of points (..., 3) from the grid's box, metres, (...,); 0 inside."""
        outer = self._corner + self.spacing * (self._shape - 1.001)
        return np.asarray(np.linalg.norm(np.maximum(np.maximum(self._corner - points, points - outer), 0.0), axis=-1))

    def distance(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the distance (n,), metres, at points (n, 3), and its gradient, (n, 3)."""
        return self._trilinear(self._values, points, True)

    def edge_distance(self, points: FloatArray) -> tuple[FloatArray, FloatArray] | None:
        """Return the distance (n,) from sharp edges, metres, and its gradient (n, 3); None without a field of it."""
        return None if self._edges is None else self._trilinear(self._edges, points, False)

    def smooth_distance(self, points: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the distance (n,) from the smooth surface, metres, its gradient (n, 3) and Hessian (n, 3, 3)."""
        base, w, beyond = self._cells(points)
        z = np.stack([1.0 - w[:, 2], w[:, 2]], axis=1)
        y = np.stack([1.0 - w[:, 1], w[:, 1]], axis=1)
        x = np.stack([1.0 - w[:, 0], w[:, 0]], axis=1)
        weights = (x[:, :, None, None] * y[:, None, :, None] * z[:, None, None, :]).reshape(-1, 1, 8)
        total = (weights.astype(np.float32) @ self._smooth[base[:, None] + self._offsets])[:, 0].astype(float)
        return total[:, 0] + beyond, total[:, 1:4], total[:, [4, 5, 6, 5, 7, 8, 6, 8, 9]].reshape(-1, 3, 3)

    def _trilinear(self, field: Field, points: FloatArray, goes_on: bool) -> tuple[FloatArray, FloatArray]:
        """Return the interpolation (n,) of a field at points (n, 3), and its gradient, (n, 3).

        Beyond the grid's box it grows with the distance from there if it ``goes_on``.
        """
        base, w, beyond = self._cells(points)
        x, y, z = w.T
        corners = field[self._offsets[:, None] + base].astype(float).reshape(2, 2, 2, -1)
        along_x = corners[1] - corners[0]
        over_x = corners[0] + x * along_x
        along_y = over_x[1] - over_x[0]
        over_y = over_x[0] + y * along_y
        along_x = along_x[0] + y * (along_x[1] - along_x[0])
        along_z = over_y[1] - over_y[0]
        slopes = along_x[0] + z * (along_x[1] - along_x[0]), along_y[0] + z * (along_y[1] - along_y[0]), along_z
        value = over_y[0] + z * along_z
        if goes_on:
            value = np.where(beyond > 0.0, np.hypot(value, beyond), value)
        return value, np.stack(slopes, axis=1) / self.spacing

    def _cells(self, points: FloatArray) -> tuple[IntArray, FloatArray, FloatArray]:
        """Return the first corner (n,) of each point's cell, the point's place in it, and its distance from the box.

        Places are shares, (n, 3), distances metres, (n,).
        """
        place = (points - self._corner) * (1.0 / self.spacing)
        cells = np.minimum(np.maximum(place, 0.0), self._shape - 1.001)
        first = cells.astype(np.int64)
        beyond = self.spacing * np.sqrt(np.einsum("nx,nx->n", place - cells, place - cells))
        return first @ self._strides, cells - first, beyond
