"""How fine the distance grid of a mesh is and how far it is smoothed, from the thickness of the mesh's walls."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlpgrasp.common.validation import FloatArray

LONGEST_SIDE, SHORTEST_SIDE = 48, 16  # grid cells at least
MOST_POINTS = 600_000
AROUND = 5  # cells beyond the mesh: a CasADi B-spline is zero outside its grid, hence NaN normals there
FINEST = 400  # cells along the longest side, whoever asks
SMOOTHING, LEAST_SMOOTHING = 1.5, 0.75  # cells: the usual one, and the least before the grid is made finer instead
DEVIATIONS = 2.4  # of the Gaussian, that fit into a wall at least


@dataclass(frozen=True)
class Fineness:
    """A grid's resolution and the Gaussian over it.

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
    """Return what is given, and the rest so that 2.4 standard deviations of the Gaussian fit into a wall.

    The Gaussian lifts the distance inside a wall from both sides, so one that is wide for it moves the smooth surface
    inwards: of an even wall by a sixteenth of its thickness at 2.4 deviations, and at less than 1.6 nothing is left of
    it. Where walls are thick it is a Gaussian of 1.5 cells over the usual grid. Where they are not, less smoothing
    comes first, which costs nothing; below 0.75 cells the grid becomes finer, up to 600,000 points, and where these do
    not suffice there is less smoothing still.

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
    """Return grid cells along the longest side: fine enough for the shortest, within 600,000 grid points.

    A grid that is coarse for a slender part lets the smoothing dissolve it: at 48 cells a hammer's handle moved
    by 13 mm.

    Parameters
    ----------
    extents : (3,) array
        Sides of the bounding box, metres.
    """
    longest, shortest = float(np.max(extents)), float(max(np.min(extents), 1e-6))
    wanted = max(LONGEST_SIDE, int(np.ceil(SHORTEST_SIDE * longest / shortest)))
    return _within(wanted, extents, LONGEST_SIDE)


def _within(resolution: int, extents: FloatArray, least: int) -> int:
    """Return the resolution, or as much of it as 600,000 grid points allow, at least ``least``."""
    while resolution > least:
        if np.prod(extents / np.max(extents) * resolution + 1 + 2 * AROUND) <= MOST_POINTS:
            break
        resolution -= max(1, resolution // 20)
    return max(resolution, least)
