"""Distance between a mesh and its smoothed surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlpgrasp.bodies.base import Body
from nlpgrasp.common.validation import FloatArray

STEPS = 12
MOST_OF_IT = 0.8  # quantile over the surface


@dataclass(frozen=True)
class SmoothOffset:
    """Distances between a mesh and its smoothed surface.

    Parameters
    ----------
    most : float
        The 80th percentile, metres.
    largest : float
        The largest over the sampled points, metres.
    """

    most: float
    largest: float


def smooth_offset(body: Body, start: FloatArray, cell: float, wall: float) -> SmoothOffset:
    """Return the distances of sampled mesh points from the smoothed surface.

    Newton steps of at most a grid cell lead from each point to the smoothed surface. Where they do not end on it, none
    is nearby, and the distance counts as at least half the wall thickness.

    Parameters
    ----------
    body : Body
        With the smooth surface as its face ``surface``.
    start : (m, 3) array
        Points of the mesh, uniform by area, metres.
    cell : float
        Metres.
    wall : float
        Thickness of the mesh's walls, metres.
    """
    points = start
    for _ in range(STEPS):
        h, slope, normals, _ = body.evaluate("surface", points)
        points = points - np.clip(h / np.maximum(slope, 1e-12), -cell, cell)[:, None] * normals
    away = np.linalg.norm(points - start, axis=1)
    away = np.where(body.is_on("surface", points), away, np.maximum(away, wall / 2.0))
    return SmoothOffset(float(np.quantile(away, MOST_OF_IT)), float(np.max(away)))
