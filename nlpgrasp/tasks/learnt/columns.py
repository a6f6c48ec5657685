"""Wrench columns and units of recorded tables."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import InputError

FORCES = {"N": 1.0, "mN": 1e-3, "kN": 1e3, "lbf": 4.4482216152605, "kgf": 9.80665}
TORQUES = {"Nm": 1.0, "mNm": 1e-3, "Nmm": 1e-3, "Ncm": 1e-2, "kNm": 1e3, "lbfin": 0.1129848290276167}
TORQUES |= {"lbfft": 1.3558179483314004}
SPATIAL = (("f", "x"), ("f", "y"), ("f", "z"), ("m", "x"), ("m", "y"), ("m", "z"))
PLANAR = (("f", "x"), ("f", "y"), ("m", "z"))
QUANTITIES = {"f": "f", "force": "f", "m": "m", "t": "m", "torque": "m", "moment": "m"}
UNIT = re.compile(r"[\[(]([^\])]*)[\])]")
ONE_WORD = re.compile(r"(force|torque|moment|f|m|t)(x|y|z)")


def columns_of(header: Sequence[str] | None, given: object, width: int, table: str, wrench_size: int = 6) -> list[int]:
    """Return the indices of the columns f_x, f_y, f_z, m_x, m_y, m_z, or f_x, f_y, m_z.

    Parameters
    ----------
    header : sequence of str or None
        Names to recognise if ``given`` is None: ``fx``, ``Tx [Nm]``, ``force_x``, ``/ft/wrench.torque.z``, in any case.
    given : sequence of str or int, or None
        Explicit column names or indices.
    width : int
        Number of columns.
    table : str
        Name of the table, for messages.
    wrench_size : int
        6, or 3 in the plane.

    Raises
    ------
    InputError
        When columns are missing or ambiguous, as with two sensors.
    """
    have = "columns " + ", ".join(header) if header else f"{width} columns without names"
    if given is not None:
        return _named(header, given, width, have, wrench_size)
    wanted = SPATIAL if wrench_size == 6 else PLANAR
    known = [_component(name) for name in header or ()]
    places = [[i for i, own in enumerate(known) if own is not None and own[1:] == one] for one in wanted]
    sensors = {own[0] for own in known if own is not None and own[1:] in wanted}
    if any(len(found) != 1 for found in places) or len(sensors) > 1:
        several = len(sensors) > 1 or any(len(found) > 1 for found in places)
        names = ", ".join(a + b for a, b in wanted)
        allowed = f"one each of {names} (or wrench.force.x ... wrench.torque.z), or columns="
        raise InputError(f"{table}: columns", have, allowed + (" with the sensor's own" if several else ""))
    return [found[0] for found in places]


def _named(header: Sequence[str] | None, given: object, width: int, have: str, wrench_size: int) -> list[int]:
    """Return the indices of columns given by name or index."""
    if not isinstance(given, Sequence) or isinstance(given, str) or len(given) != wrench_size:
        raise InputError("columns", given, f"{'six' if wrench_size == 6 else 'three'} names or numbers")
    result = []
    for one in given:
        if isinstance(one, int) and not isinstance(one, bool) and 0 <= one < width:
            result.append(one)
        elif isinstance(one, str) and header and list(header).count(one) == 1:
            result.append(list(header).index(one))
        else:
            raise InputError("columns", repr(one), have)
    return result


def _component(name: str) -> tuple[str, str, str] | None:
    """Return prefix, quantity (``"f"`` or ``"m"``) and axis of a wrench column's name; None for other columns."""
    words = [word for word in re.split(r"[\s_./:-]+", UNIT.split(name)[0].lower()) if word]
    if len(words) > 1 and words[-1] in "xyz" and words[-2] in QUANTITIES:
        return ".".join(words[:-2]), QUANTITIES[words[-2]], words[-1]
    found = ONE_WORD.fullmatch(words[-1]) if words else None
    return None if found is None else (".".join(words[:-1]), QUANTITIES[found[1]], found[2])


def scales_of(header: Sequence[str] | None, chosen: Sequence[int], units: object, table: str) -> FloatArray:
    """Return factors to newtons and newton-metres, one per column, from given units or the header.

    Raises
    ------
    InputError
        On unknown or missing units.
    """
    if units is not None and (not isinstance(units, list | tuple) or len(units) != 2):
        raise InputError("units", units, 'a pair such as ("N", "Nm")')
    factors, forces = [], 3 if len(chosen) == 6 else 2
    for i, column in enumerate(chosen):
        known = FORCES if i < forces else TORQUES
        if isinstance(units, list | tuple):
            text = str(units[0 if i < forces else 1])
        else:
            found = UNIT.search(header[column]) if header else None
            if found is None:
                allowed = 'units=("N", "Nm"), which ROS messages are in, or a header such as Fx [N]'
                raise InputError(f"{table}: units", "none in the header", allowed)
            text = found.group(1)
        key = re.sub(r"[\s*\u00b7.-]", "", text)
        if key not in known:
            raise InputError("units", repr(text), "one of " + ", ".join(known))
        factors.append(known[key])
    return np.array(factors)


def states_units(header: Sequence[str], chosen: Sequence[int]) -> bool:
    """Return whether any of the columns states its unit."""
    return any(UNIT.search(header[column]) for column in chosen)
