"""Validation of user input: numbers, arrays, lengths, angles, masses, names."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from copy import copy
from difflib import get_close_matches
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.common.user_warnings import warn_once
from nlpgrasp.errors import InputError

LARGEST = 1e100  # largest accepted magnitude, against overflow
SMALLEST = 1e-100  # smallest accepted positive number, against overflow of its reciprocal
SHORTEST_BODY, LONGEST_BODY = 1e-3, 10.0  # m, plausible sizes: beyond them the unit is probably wrong
SHARE = "a share above 0, at most 1"
TURN = 2.0 * np.pi * (1.0 + 1e-6)  # rad, a full turn with tolerance for rounding in files
LARGEST_TIP = 1.0  # m, largest fingertip radius
UNITS = {"m": 1.0, "dm": 0.1, "cm": 0.01, "mm": 0.001, "in": 0.0254, "ft": 0.3048}
LENGTHS = {  # names of UNITS by the words of files, in lower case
    **{name: name for name in UNITS},
    **{
        f"{prefix}met{ending}": f"{short}m"
        for prefix, short in (("", ""), ("deci", "d"), ("centi", "c"), ("milli", "m"))
        for ending in ("er", "ers", "re", "res")
    },
    **{"inch": "in", "inches": "in", "foot": "ft", "feet": "ft"},
}
HEAVY = 50.0  # kg, mass above which grams are suspected
MOST, NEAREST = 16, 4  # most names listed in a message, most suggestions
CLOSE, LONG = 0.6, 3  # least similarity ratio of similar names; least letters of a significant word


FloatArray = NDArray[np.float64]
IntArray = NDArray[np.integer]
BoolArray = NDArray[np.bool_]

Item = TypeVar("Item")


def number(field: str, value: object, *, above: float | None = None, at_least: float | None = None) -> float:
    """Return ``value`` as a finite float, or raise ``InputError`` naming ``field``.

    Parameters
    ----------
    field : str
        Name shown in the message.
    value : float
        The candidate.
    above, at_least : float, optional
        Strict and inclusive lower limits.
    """
    allowed = "a finite number"
    if above is not None:
        allowed = f"a number greater than {above:g}"
    if at_least is not None:
        allowed = f"a number of at least {at_least:g}"
    if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
        raise InputError(field, repr(value), allowed + (", without quotes" if isinstance(value, str) else ""))
    if not -LARGEST <= value <= LARGEST:  # false for NaN
        raise InputError(field, value, f"{allowed}, finite and at most {LARGEST:g}")
    result = float(value)
    if above is not None and above < result < above + SMALLEST:
        raise InputError(field, value, f"{allowed}, by at least {SMALLEST:g}")
    if (above is not None and result <= above) or (at_least is not None and result < at_least):
        raise InputError(field, value, allowed)
    return result


def check_body_size(field: str, quantity: str, longest: float, mistake: str, has_unit: bool = True) -> None:
    """Raise ``InputError`` if the size of a body is implausible for grasping.

    Parameters
    ----------
    field : str
    quantity : str
        Name of the length, for messages.
    longest : float
        Longest side of its bounding box, metres.
    mistake : str
        Message about the likely mistake, with ``{}`` for "smaller" or "larger".
    has_unit : bool
        Whether the body takes a ``unit``.
    """
    if not SHORTEST_BODY <= longest <= LONGEST_BODY:
        message, large = mistake.format("smaller" if longest > 1.0 else "larger"), has_unit and longest > 1.0
        cure = ': unit="mm" says that they are millimetres' if large else ""
        if longest < SHORTEST_BODY:
            cure = ", or the body is too small for fingertips"
        allowed = f"{SHORTEST_BODY:g} m to {LONGEST_BODY:g} m: {message}{cure}"
        raise InputError(field, f"{quantity} of {longest:.3g} m", allowed)


def share(field: str, value: object) -> float:
    """Return ``value`` as a float above 0 and at most 1, or raise ``InputError``."""
    try:
        result = number(field, value, above=0.0)
    except InputError as error:
        raise InputError(field, error.given, SHARE) from None
    if result > 1.0:
        raise InputError(field, value, SHARE)
    return result


def integer(field: str, value: object, *, at_least: int, at_most: int = 10**9) -> int:
    """Return ``value`` as an int within inclusive limits, or raise ``InputError``."""
    allowed = f"a whole number from {at_least} to {at_most}"
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or not at_least <= value <= at_most:
        raise InputError(field, repr(value) if isinstance(value, str) else value, allowed)
    return int(value)


def array(field: str, value: object, shape: tuple[int | None, ...]) -> FloatArray:
    """Return ``value`` as a finite float array of the given shape (``None`` matches any length).

    Raises
    ------
    InputError
        When the shape differs, an entry is not a number, or an entry is NaN, infinite or above 1e100.
    """
    required = "(" + ", ".join("any" if s is None else str(s) for s in shape) + ("," if len(shape) == 1 else "") + ")"
    try:
        values = np.asarray(value)
        if isinstance(value, np.ma.MaskedArray) or (values.size and values.dtype.kind not in "iuf"):
            raise TypeError
        result = np.array(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise InputError(field, value, f"real numbers of shape {required}") from None
    if result.ndim != len(shape) or any(s is not None and s != n for s, n in zip(shape, result.shape, strict=True)):
        raise InputError(field, f"shape {result.shape}", f"shape {required}")
    if not np.all(np.abs(result) <= LARGEST):  # false for NaN
        raise InputError(field, value, f"finite numbers (no NaN, no infinity, at most {LARGEST:g})")
    return result


def read_only(values: FloatArray) -> FloatArray:
    """Return an array of any shape after making it read-only."""
    values.setflags(write=False)
    return values


def face_names(field: str, value: str | Iterable[str] | None) -> tuple[str, ...] | None:
    """Return one or several face names as a tuple; ``None``, for all faces, is returned unchanged."""
    if value is None:
        return None
    try:
        result = (value,) if isinstance(value, str) else tuple(value)
    except TypeError:
        result = ()
    if not result or not all(isinstance(item, str) for item in result):
        raise InputError(field, value, "a face name or several, or None for all faces")
    return result


@contextmanager
def prefix_errors(prefix: str) -> Iterator[None]:
    """Put a prefix, such as a file's name, before the field of any ``InputError`` raised in a ``with`` block."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{prefix}{error.field}", error.given, error.allowed) from None


def replace_unchecked(item: Item, **fields: object) -> Item:
    """Return a copy of a frozen object with some fields replaced, without validation.

    For finite differences, which may step beyond a field's limits, and for parts that were checked before. Otherwise
    use ``dataclasses.replace``, which validates.

    Parameters
    ----------
    item : object
        Of a frozen dataclass.
    **fields
        Their new values.
    """
    result = copy(item)
    for name, value in fields.items():
        object.__setattr__(result, name, value)
    return result


def angle(field: str, value: object, at_most: float, limit: str) -> float:
    """Return an angle, radians, validated to be above zero.

    The ``InputError`` hints at degrees where likely.

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
    result = number(field, value, above=0.0)
    if result > at_most:
        raise InputError(field, result, f"radians, at most {limit}{_degree_hint(result)}")
    return result


def check_angles(field: str, values: FloatArray) -> FloatArray:
    """Return angles of any shape, radians, validated to be within a full turn.

    Larger angles suggest degrees.
    """
    worst = float(np.max(np.abs(values), initial=0.0))
    if worst > TURN:
        raise InputError(field, values.tolist(), f"radians{_degree_hint(worst)}")
    return values


def _degree_hint(size: float) -> str:
    """Return a hint about conversion from degrees if an angle is probably in degrees, else an empty text."""
    degrees = size > TURN or (size >= 5.0 and size == round(size))
    return f": {size:g} degrees are {np.radians(size):.4g}" if degrees else ""


def metres_per(field: str, unit: object) -> float:
    """Return the length of a unit in metres, or raise ``InputError`` if the unit is unknown.

    A unit is a name of ``UNITS`` or, as mesh files may state, a number of metres: ``"0.9144 m"``.
    """
    text = unit if isinstance(unit, str) else repr(unit)
    if text in UNITS:
        return UNITS[text]
    length, _, name = text.partition(" ")
    try:
        return number(field, float(length if name == "m" else "nan"), above=0.0)
    except (ValueError, InputError):
        raise InputError(field, text, "one of " + ", ".join(UNITS)) from None


def in_metres(field: str, lengths: FloatArray, unit: object) -> FloatArray:
    """Return lengths of any shape converted to metres, correctly rounded.

    35 mm give exactly 0.035.

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


def length_in_metres(field: str, name: str, length: object, unit: object) -> float:
    """Return a length in metres, validated to be above zero.

    Errors name ``field.name`` or ``field.unit``.
    """
    value = number(f"{field}.{name}", length, above=0.0)
    return number(f"{field}.{name}", float(in_metres(f"{field}.unit", np.asarray(value), unit)), above=0.0)


def hand_length(field: str, length: float, most: float = LONGEST_BODY) -> float:
    """Return a length of a hand, metres, validated to be at most ``most``.

    A larger length suggests another unit.

    Raises
    ------
    InputError
        Naming the field.
    """
    if length > most:
        allowed = f"metres, at most {most:g}: {length:g} mm are {length / 1000.0:g}"
        raise InputError(field, f"{length:g} m", allowed)
    return length


def kilograms(mass: object) -> float:
    """Return a mass, kg, validated to be above zero; warn once about an implausible mass.

    Raises
    ------
    InputError
        On anything but a number above zero.
    """
    result = number("mass", mass, above=0.0)
    if result > HEAVY:
        warn_once(f"mass: {result:g} kg; if grams were meant, {result / 1e3:g}")
    return result


def similar_names(name: str, names: Iterable[str]) -> list[str]:
    """Return known names that are similar to an unknown one, most similar first, ignoring case.

    Parameters
    ----------
    name : str
        The unknown name.
        names : iterable of str
        Known names.
    """
    by_case = {folded.casefold(): folded for folded in names}
    similar = [by_case[folded] for folded in get_close_matches(name.casefold(), by_case, NEAREST, CLOSE)]
    words = [word for word in name.casefold().replace("_", " ").split() if len(word) >= LONG]
    shared = [
        spelling
        for folded, spelling in by_case.items()
        if spelling not in similar and any(word in folded for word in words)
    ]
    return [*similar, *shared][:NEAREST]


def format_known_names(unknown: Iterable[object], names: Iterable[str]) -> str:
    """Return a text that lists at most sixteen known names and suggests some for unknown ones.

    Parameters
    ----------
    unknown : iterable
        Unknown names.
    names : iterable of str
        Known names.
    """
    listed = list(names)
    remainder = f" and {len(listed) - MOST} more" if len(listed) > MOST else ""
    suggestions = dict.fromkeys(similar[0] for name in unknown if (similar := similar_names(str(name), listed)))
    question = f"; did you mean {' and '.join(suggestions)}?" if suggestions else ""
    return f"{', '.join(listed[:MOST])}{remainder}{question}"
