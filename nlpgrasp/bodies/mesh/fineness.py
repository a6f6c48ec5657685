"""Grid resolution and smoothing of a mesh's signed distance, from its wall thickness."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlpgrasp.common.validation import FloatArray

LONGEST_SIDE, SHORTEST_SIDE = 48, 16  # least number of grid cells along these sides
MOST_POINTS = 600_000
AROUND = 5  # grid cells beyond the mesh (a CasADi B-spline is zero outside its grid, so normals are NaN)
FINEST = 400  # largest number of cells along the longest side
SMOOTHING, LEAST_SMOOTHING = 1.5, 0.75  # cells, Gaussian's deviation: default, and least before the grid is refined
DEVIATIONS = 2.4  # standard deviations of the Gaussian per wall thickness, at least


@dataclass(frozen=True)
class Fineness:
    """Resolution of a distance grid and standard deviation of its Gaussian filter.

    Parameters
    ----------
    smoothing : float
        Standard deviation, in cells.
    resolution : int
        Cells along the longest side.
    """

    smoothing: float
    resolution: int


def automatic_fineness(
    extents: FloatArray, wall: float, smoothing: float | None = None, resolution: int | None = None
) -> Fineness:
    """Choose resolution and smoothing such that 2.4 standard deviations of the Gaussian fit into a wall.

    Given values are kept. The Gaussian lifts the distance inside a wall from both sides, so a wide one moves the smooth
    surface inwards: by a sixteenth of an even wall's thickness at 2.4 deviations, and at less than 1.6 the wall
    vanishes. Thick walls get a Gaussian of 1.5 cells on the default grid. For thinner walls the smoothing is reduced
    first, which costs nothing; below 0.75 cells the grid is refined, up to 600,000 points, and where these do not
    suffice the smoothing is reduced further.

    Parameters
    ----------
    extents : (3,) array
        Sides of the bounding box, metres.
    wall : float
        Thickness, metres.
    smoothing : float, optional
        In cells.
    resolution : int, optional
        Cells along the longest side.
    """
    cells = DEVIATIONS * float(np.max(extents)) / wall  # along the longest side, for a Gaussian of one cell
    if resolution is None:
        least = max(LEAST_SMOOTHING, 0.0 if smoothing is None else smoothing)
        usual = automatic_resolution(extents)
        resolution = max(usual, _within(int(np.ceil(min(cells * least, FINEST))), extents, usual))
    if smoothing is None:
        smoothing = min(SMOOTHING, np.floor(100.0 * resolution / cells) / 100.0)
    return Fineness(float(smoothing), resolution)


def automatic_resolution(extents: FloatArray) -> int:
    """Return the number of grid cells along the longest side: enough for the shortest, at most 600,000 points.

    On a grid too coarse for a slender part, smoothing dissolves it: at 48 cells a hammer's handle moved by 13 mm.

    Parameters
    ----------
    extents : (3,) array
        Sides of the bounding box, metres.
    """
    longest, shortest = float(np.max(extents)), float(max(np.min(extents), 1e-6))
    wanted = max(LONGEST_SIDE, int(np.ceil(SHORTEST_SIDE * longest / shortest)))
    return _within(wanted, extents, LONGEST_SIDE)


def _within(resolution: int, extents: FloatArray, least: int) -> int:
    """Return the resolution, reduced to at most 600,000 grid points but not below ``least``."""
    while resolution > least:
        if np.prod(extents / np.max(extents) * resolution + 1 + 2 * AROUND) <= MOST_POINTS:
            break
        resolution -= max(1, resolution // 20)
    return max(resolution, least)
