"""Validation of angles in radians, with hints about degrees."""

from __future__ import annotations

import numpy as np

from nlpgrasp.common.validation import FloatArray, number
from nlpgrasp.errors import InputError

TURN = 2.0 * np.pi * (1.0 + 1e-6)  # rad, a full turn with tolerance for rounding in files


def angle(field: str, value: object, at_most: float, limit: str) -> float:
    """Return a validated angle above zero; the ``InputError`` hints at degrees where likely.

    Parameters
    ----------
    field : str
    value : float
        Radians.
    at_most : float
        Radians.
    limit : str
        The same as text: ``"pi"``.
    """
    found = number(field, value, above=0.0)
    if found > at_most:
        raise InputError(field, found, f"radians, at most {limit}{_hint(found)}")
    return found


def angles(field: str, values: FloatArray) -> FloatArray:
    """Return angles of any shape, radians; raise beyond a full turn, which suggests degrees."""
    worst = float(np.max(np.abs(values), initial=0.0))
    if worst > TURN:
        raise InputError(field, values.tolist(), f"radians{_hint(worst)}")
    return values


def _hint(size: float) -> str:
    """Return a conversion hint for an angle that is probably in degrees, else an empty text."""
    degrees = size > TURN or (size >= 5.0 and size == round(size))
    return f": {size:g} degrees are {np.radians(size):.4g}" if degrees else ""
