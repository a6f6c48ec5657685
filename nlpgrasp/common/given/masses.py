"""Validation of masses in kilograms."""

from __future__ import annotations

from nlpgrasp.common.shown.once import say_once
from nlpgrasp.common.validation import number

HEAVY = 50.0  # kg, mass above which grams are suspected


def kilograms(mass: object) -> float:
    """Return a validated mass above zero; warn once about an implausible one.

    Raises
    ------
    InputError
        On anything but a number above zero.
    """
    found = number("mass", mass, above=0.0)
    if found > HEAVY:
        say_once(f"mass: {found:g} kg; if grams were meant, {found / 1e3:g}")
    return found
