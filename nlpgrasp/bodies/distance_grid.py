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
    body is named here. Beyond the grid it is that of the grid's nearest point and the distance from there.

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
        axes = [self._corner[i] + self.spacing * np.arange(self._shape[i]) for i in range(3)]
        edges, smooth = body.edge_distance_on_grid(axes), body.smooth_distance_on_grid(axes)
        self._values: Field = body.distance_on_grid(axes).astype(np.float32).ravel()
        self._edges: Field | None = None if edges is None else edges.astype(np.float32).ravel()
        self._smooth: Field = np.empty((smooth.size, 13), dtype=np.float32)  # value, slopes, curvatures
        self._smooth[:, 0] = smooth.ravel()
        for i in range(3):
            slope = np.gradient(smooth, self.spacing, axis=i)
            self._smooth[:, 1 + i] = slope.ravel()
            for j in range(3):
                self._smooth[:, 4 + 3 * i + j] = np.gradient(slope, self.spacing, axis=j).ravel()

    def nearest(self, points: FloatArray) -> FloatArray:
        """Return the distance at the grid point nearest to each point (..., 3), metres: quick, and off by a cell."""
        index = np.zeros(points.shape[:-1], dtype=np.int32)
        for axis in range(3):
            cell = points[..., axis] * (1.0 / self.spacing) + (0.5 - self._corner[axis] / self.spacing)
            np.clip(cell, 0.0, self._shape[axis] - 0.5, out=cell)
            index += cell.astype(np.int32) * np.int32(self._strides[axis])
        return np.asarray(self._values[index])

    def distance(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the distance (n,), metres, at points (n, 3), and its gradient, (n, 3)."""
        value, gradient = self._trilinear(self._values, points)
        return value + self._beyond(points), gradient

    def edge_distance(self, points: FloatArray) -> tuple[FloatArray, FloatArray] | None:
        """Return the distance (n,) from sharp edges, metres, and its gradient (n, 3); None without a field of it."""
        return None if self._edges is None else self._trilinear(self._edges, points)

    def smooth_distance(self, points: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the distance (n,) from the smooth surface, metres, its gradient (n, 3) and Hessian (n, 3, 3)."""
        base, w = self._cells(points)
        total = np.zeros((len(points), 13))
        for corner, offset in enumerate(self._offsets):
            sides = [w[:, axis] if corner >> (2 - axis) & 1 else 1.0 - w[:, axis] for axis in range(3)]
            total += (sides[0] * sides[1] * sides[2])[:, None] * self._smooth[base + offset]
        hessian = total[:, 4:].reshape(-1, 3, 3)
        return total[:, 0] + self._beyond(points), total[:, 1:4], 0.5 * (hessian + hessian.transpose(0, 2, 1))

    def _trilinear(self, field: Field, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the interpolation (n,) of a field at points (n, 3), and its gradient, (n, 3)."""
        base, w = self._cells(points)
        corners = np.stack([field[base + offset] for offset in self._offsets], axis=1).astype(float)
        corners = corners.reshape(-1, 2, 2, 2)
        along_x = corners[:, 1] - corners[:, 0]
        over_x = corners[:, 0] + w[:, 0, None, None] * along_x
        along_y = over_x[:, 1] - over_x[:, 0]
        over_y = over_x[:, 0] + w[:, 1, None] * along_y
        slopes = [
            _between(_between(along_x, w[:, 1, None]), w[:, 2]),
            _between(along_y, w[:, 2]),
            over_y[:, 1] - over_y[:, 0],
        ]
        return _between(over_y, w[:, 2]), np.stack(slopes, axis=1) / self.spacing

    @property
    def _offsets(self) -> list[int]:
        """Offsets of a cell's corners from its first one; the bits of their numbers are x, y and z."""
        return [int(np.dot(self._strides, [c >> 2, c >> 1 & 1, c & 1])) for c in range(8)]

    def _cells(self, points: FloatArray) -> tuple[IntArray, FloatArray]:
        """Return the first corner (n,) of each point's cell, and the point's place in it, (n, 3) shares."""
        cells = np.clip((points - self._corner) / self.spacing, 0.0, self._shape - 1.001)
        first = cells.astype(np.int64)
        return first @ self._strides, cells - first

    def _beyond(self, points: FloatArray) -> FloatArray:
        """Return the distances of points (n, 3) from the grid's box, metres."""
        far = self._corner + self.spacing * (self._shape - 1)
        return np.asarray(np.linalg.norm(points - np.clip(points, self._corner, far), axis=1))


def _between(ends: FloatArray, w: FloatArray) -> FloatArray:
    """Return the linear interpolation between values ``ends[:, 0]`` and ``ends[:, 1]`` at shares w."""
    return np.asarray(ends[:, 0] + w * (ends[:, 1] - ends[:, 0]))
