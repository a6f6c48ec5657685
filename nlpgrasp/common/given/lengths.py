"""Conversion of lengths to metres."""

from __future__ import annotations

import numpy as np

from nlpgrasp.common.validation import LONGEST_BODY, FloatArray, number
from nlpgrasp.errors import InputError

LARGEST_TIP = 1.0  # m, largest fingertip radius
UNITS = {"m": 1.0, "dm": 0.1, "cm": 0.01, "mm": 0.001, "in": 0.0254, "ft": 0.3048}


def metres_per(field: str, unit: object) -> float:
    """Return the length of a unit in metres, or raise ``InputError`` that lists the known units."""
    if not isinstance(unit, str) or unit not in UNITS:
        raise InputError(field, unit if isinstance(unit, str) else repr(unit), "one of " + ", ".join(UNITS))
    return UNITS[unit]


def in_metres(field: str, lengths: FloatArray, unit: object) -> FloatArray:
    """Return lengths of any shape in metres, correctly rounded: 35 mm give exactly 0.035.

    Parameters
    ----------
    field : str
        Field of the unit, for messages: ``"Box.unit"``.
    lengths : (...) array
    unit : {"m", "dm", "cm", "mm", "in", "ft"}

    Raises
    ------
    InputError
        On an unknown unit.
    """
    factor = metres_per(field, unit)
    parts = round(1.0 / factor)
    # powers of ten divide: a product with 0.001 is rounded twice
    return lengths / parts if parts * factor == 1.0 else lengths * factor


def one_in_metres(field: str, name: str, length: object, unit: object) -> float:
    """Return a validated length above zero in metres; errors name ``field.name`` or ``field.unit``."""
    stated = number(f"{field}.{name}", length, above=0.0)
    return number(f"{field}.{name}", float(in_metres(f"{field}.unit", np.asarray(stated), unit)), above=0.0)


def of_a_hand(field: str, length: float, most: float = LONGEST_BODY) -> float:
    """Return a length of a hand, metres; raise above ``most``, which suggests another unit.

    Raises
    ------
    InputError
        Naming the field.
    """
    if length > most:
        allowed = f"metres, at most {most:g}: {length:g} mm are {length / 1000.0:g}"
        raise InputError(field, f"{length:g} m", allowed)
    return length
