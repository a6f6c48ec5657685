"""Numeric regions of space: depth of points in boxes, half-spaces and other shapes."""

from __future__ import annotations

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array, number
from nlpgrasp.errors import InputError
from nlpgrasp.verify.check import NotMadeError

UNIT = 1e-9  # tolerance of the length of unit vectors


def inside(region: Json, point: FloatArray) -> float:
    """Return the depth of a point (space,) in a region, metres, negative outside; in a box to its nearest side.

    Raises
    ------
    NotMadeError
        On a region given by a script's function: the file contains its text alone.
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
    """Return a unit vector (space,) of a file; refuse another length, which would scale its constraint."""
    vector = array(field, value, (space,))
    if not abs(float(np.linalg.norm(vector)) - 1.0) <= UNIT:
        raise InputError(field, value, "a vector of length 1")
    return vector
