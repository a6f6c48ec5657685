"""Masses that a user states, in kilograms."""

from __future__ import annotations

from nlpgrasp.common.shown.once import say_once
from nlpgrasp.common.validation import number

HEAVY = 50.0  # kilograms: what no hand carries was probably stated in grams


def kilograms(mass: object) -> float:
    """Return a mass above zero; one that no hand carries is asked about, once.

    Raises
    ------
    InputError
        On what is no number above zero.
    """
    found = number("mass", mass, above=0.0)
    if found > HEAVY:
        say_once(f"mass: {found:g} kg; if grams were meant, {found / 1e3:g}")
    return found
