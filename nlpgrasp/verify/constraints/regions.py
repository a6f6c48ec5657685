"""Regions of space as numbers."""

from __future__ import annotations

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array, number
from nlpgrasp.verify.check import NotMadeError


def inside(region: Json, point: FloatArray) -> float:
    """Return how deep a point (space,) is in a region, metres, negative outside; of a box to its nearest side.

    Raises
    ------
    NotMadeError
        On a region that a script gave as a function: the file holds its text alone.
    """
    if region["type"] == "half_space":
        normal = array("normal", region["normal"], (len(point),))
        return float(normal @ point) - number("offset", region["offset"])
    if region["type"] == "box_region":
        lower, upper = corners(region)
        return float(np.min(np.minimum(point - lower, upper - point)))
    raise NotMadeError(f"a region of type {region['type']!r} stays in the script that made it")


def corners(region: Json) -> tuple[FloatArray, FloatArray]:
    """Return the lower and upper corner of a box region, (space,) each."""
    return array("lower", region["lower"], (None,)), array("upper", region["upper"], (None,))
