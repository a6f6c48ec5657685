"""Regions of space as numbers."""

from __future__ import annotations

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array, number
from nlpgrasp.errors import InputError
from nlpgrasp.verify.check import NotMadeError

UNIT = 1e-9  # of a length: files state unit vectors to rounding


def inside(region: Json, point: FloatArray) -> float:
    """Return how deep a point (space,) is in a region, metres, negative outside; of a box to its nearest side.

    Raises
    ------
    NotMadeError
        On a region that a script gave as a function: the file holds its text alone.
    """
    if region["type"] == "half_space":
        normal = unit("normal", region["normal"], len(point))
        return float(normal @ point) - number("offset", region["offset"])
    if region["type"] == "box_region":
        lower, upper = corners(region)
        return float(np.min(np.minimum(point - lower, upper - point)))
    raise NotMadeError(f"a region of type {region['type']!r} stays in the script that made it")


def corners(region: Json) -> tuple[FloatArray, FloatArray]:
    """Return the lower and upper corner of a box region, (space,) each."""
    return array("lower", region["lower"], (None,)), array("upper", region["upper"], (None,))


def unit(field: str, value: object, space: int) -> FloatArray:
    """Return a unit vector (space,) of a file; another length would scale the row that it is in."""
    vector = array(field, value, (space,))
    if not abs(float(np.linalg.norm(vector)) - 1.0) <= UNIT:
        raise InputError(field, value, "a vector of length 1")
    return vector
