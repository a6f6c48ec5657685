"""Angles in radians, and those that were probably given in degrees."""

from __future__ import annotations

import numpy as np

from nlpgrasp.common.validation import FloatArray, number
from nlpgrasp.errors import InputError

TURN = 2.0 * np.pi * (1.0 + 1e-6)  # a full turn, rounded as files round it


def angle(field: str, value: object, at_most: float, limit: str) -> float:
    """Return an angle above zero, or raise ``InputError`` that says what it is in radians if it looks like degrees.

    Parameters
    ----------
    field : str
    value : float
        Radians.
    at_most : float
        Radians.
    limit : str
        The same in words: ``"pi"``.
    """
    found = number(field, value, above=0.0)
    if found > at_most:
        raise InputError(field, found, f"radians, at most {limit}{_hint(found)}")
    return found


def angles(field: str, values: FloatArray) -> FloatArray:
    """Return angles, of any shape, radians, refusing those beyond a full turn: they were probably given in degrees."""
    worst = float(np.max(np.abs(values), initial=0.0))
    if worst > TURN:
        raise InputError(field, values.tolist(), f"radians{_hint(worst)}")
    return values


def _hint(size: float) -> str:
    """Return what an angle is in radians, where it is more than a full turn or a usual number of degrees."""
    degrees = size > TURN or (size >= 5.0 and size == round(size))
    return f": {size:g} degrees are {np.radians(size):.4g}" if degrees else ""
