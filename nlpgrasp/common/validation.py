"""Input validators, whose errors name the field and the received value."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.errors import InputError

FloatArray = NDArray[np.float64]
LARGEST = 1e100  # largest accepted magnitude, against overflow
SMALLEST = 1e-100  # smallest accepted positive number, against overflow of its reciprocal
SHORTEST_BODY, LONGEST_BODY = 1e-3, 10.0  # m, plausible sizes: beyond them the unit is probably wrong
SHARE = "a share above 0, at most 1"


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


def likely_size(field: str, what: str, longest: float, wrong: str, has_unit: bool = True) -> None:
    """Raise for a body whose size is implausible for grasping.

    Parameters
    ----------
    field : str
    what : str
        Name of the length, for messages.
    longest : float
        Longest side of its bounding box, metres.
    wrong : str
        Message about the likely mistake, with ``{}`` for "smaller" or "larger".
    has_unit : bool
        Whether the body takes a ``unit``.
    """
    if not SHORTEST_BODY <= longest <= LONGEST_BODY:
        told, large = wrong.format("smaller" if longest > 1.0 else "larger"), has_unit and longest > 1.0
        cure = ': unit="mm" says that they are millimetres' if large else ""
        allowed = f"{SHORTEST_BODY:g} m to {LONGEST_BODY:g} m: {told}{cure}"
        raise InputError(field, f"{what} of {longest:.3g} m", allowed)


def share(field: str, value: object) -> float:
    """Return a share above 0, at most 1, or raise ``InputError``."""
    try:
        found = number(field, value, above=0.0)
    except InputError as error:
        raise InputError(field, error.given, SHARE) from None
    if found > 1.0:
        raise InputError(field, value, SHARE)
    return found


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
    wanted = "(" + ", ".join("any" if s is None else str(s) for s in shape) + ("," if len(shape) == 1 else "") + ")"
    try:
        given = np.asarray(value)
        if isinstance(value, np.ma.MaskedArray) or (given.size and given.dtype.kind not in "iuf"):
            raise TypeError
        result = np.array(given, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise InputError(field, value, f"real numbers of shape {wanted}") from None
    if result.ndim != len(shape) or any(s is not None and s != n for s, n in zip(shape, result.shape, strict=True)):
        raise InputError(field, f"shape {result.shape}", f"shape {wanted}")
    if not np.all(np.abs(result) <= LARGEST):  # false for NaN
        raise InputError(field, value, f"finite numbers (no NaN, no infinity, at most {LARGEST:g})")
    return result


def read_only(values: FloatArray) -> FloatArray:
    """Return ``values``, of any shape, set to read-only."""
    values.setflags(write=False)
    return values


def names(field: str, value: str | Iterable[str] | None) -> tuple[str, ...] | None:
    """Return a tuple of names from one or several names, or ``None`` (all)."""
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
def within(place: str) -> Iterator[None]:
    """Prefix the field of an ``InputError`` raised inside with a place, such as a file's name."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{place}{error.field}", error.given, error.allowed) from None
