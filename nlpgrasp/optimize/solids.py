"""Distance of all that a hand's links avoid: the body and its surroundings."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from scipy.ndimage import map_coordinates

from nlpgrasp.bodies.distance_grid import DistanceGrid
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.motion.distance_fields import Distance, build_distance_fields, distance_to_all
from nlpgrasp.problem.problem import GraspProblem


class HasDistance(Protocol):
    """Distance of solids, such as a grid of it."""

    spacing: float

    def nearest(self, points: FloatArray) -> FloatArray:
        """Return the distance of points (..., 3), metres, up to the spacing."""

    def distance(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the distance (n,), metres, of points (n, 3), and its gradient (n, 3)."""


class Solids:
    """Distance of the body and of what else links have to avoid, with the interface of a grid of distances.

    Parameters
    ----------
    grid : DistanceGrid
        Of the body.
    others : callable
        Distance of the nearest other solid, less the clearance from it, metres.
    """

    def __init__(self, grid: DistanceGrid, others: Distance, box: FloatArray, count: int = 48) -> None:
        self._grid, self._others, self.spacing = grid, others, grid.spacing
        self._corner, self._step = box[0], (box[1] - box[0]) / (count - 1)
        axes = [np.linspace(low, high, count) for low, high in box.T]
        coarse = others(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3))
        self._coarse = coarse.reshape(count, count, count)

    @classmethod
    def around(cls, grid: DistanceGrid, problem: GraspProblem, reach: float = 0.2) -> Solids | DistanceGrid:
        """Return body and surroundings of a problem, as far as ``reach`` from it; the grid itself without any."""
        body = problem.body
        others = build_distance_fields(body, problem.constraints, len(problem.models))[1:]
        box = body.bounds + reach * np.array([[-1.0], [1.0]])
        return cls(grid, distance_to_all(others), box) if others else grid

    def nearest(self, points: FloatArray) -> FloatArray:
        """Return about the distance of points (..., 3), metres, of the surroundings between points of a coarse grid."""
        cells = np.moveaxis((points - self._corner) / self._step, -1, 0)
        return np.minimum(self._grid.nearest(points), map_coordinates(self._coarse, cells, order=1, mode="nearest"))

    def distance(self, points: FloatArray, step: float = 1e-6) -> tuple[FloatArray, FloatArray]:
        """Return the distance (n,), metres, of points (n, 3), and its gradient (n, 3)."""
        value, slope = self._grid.distance(points)
        other = self._others(points)
        near = np.flatnonzero(other < value)
        value[near] = other[near]
        for axis, e in enumerate(np.eye(3)):
            slope[near, axis] = (self._others(points[near] + step * e) - other[near]) / step
        return value, slope
