"""How far a mesh is from the smooth surface that the solver sees in its place."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlpgrasp.bodies.base import Body
from nlpgrasp.common.validation import FloatArray

STEPS = 12
MOST_OF_IT = 0.8  # of the mesh


@dataclass(frozen=True)
class SmoothOffset:
    """Distances between points of a mesh and the smooth surface.

    Parameters
    ----------
    most : float
        Four fifths of the mesh are nearer than this, metres.
    largest : float
        Of all points looked at, metres.
    """

    most: float
    largest: float


def smooth_offset(body: Body, start: FloatArray, cell: float, wall: float) -> SmoothOffset:
    """Return how far points of a mesh are from the smooth surface.

    Newton steps of at most a grid cell lead from each to the smooth surface. Where they do not end on it, there is none
    nearby, and the point counts as half a wall off at least.

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
