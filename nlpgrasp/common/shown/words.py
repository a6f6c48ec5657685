"""Forces, moments and wrenches in words: one table of labels and units for tasks, pages and pictures."""

from __future__ import annotations

import math

import numpy as np

from nlpgrasp.common.shown.numbers import DIGITS, at_most, rounded, vector
from nlpgrasp.common.validation import FloatArray

FORCE_UNIT, MOMENT_UNIT = "N", "N m"
COMPONENTS = {3: ("f_x", "f_y", "m_z"), 6: ("f_x", "f_y", "f_z", "m_x", "m_y", "m_z")}  # of a wrench, by dimension
DIRECTIONS = {
    3: ("a force along x", "a force along y", "a torque"),
    6: (*(f"a force along {a}" for a in "xyz"), *(f"a torque about {a}" for a in "xyz")),
}
SMALL = 0.02  # of the largest force or moment: not worth a word
SHORT, LONG = 1e-4, 1e3  # metres: moments on shorter arms, and forces on longer ones, are none
NOTHING = 1e-6  # of the largest component: rounding
MINOR = 0.3  # of a direction's largest component: not worth a word


def measure_word(kind: str) -> str:
    """Return the name of a measure of this kind as people read it."""
    return "mu-tilde" if kind == "mu_tilde" else kind or "mu"


def headroom_words(gap: float, digits: int = DIGITS) -> str:
    """Return in words how much better than a grasp any placement can be, at most, rounded up.

    Parameters
    ----------
    gap : float
        ``upper / mu - 1`` of a bound over all placements and the grasp's certified quality: a share of the grasp's own
        quality. Above 1 it is told as a multiple; inf where nothing is known.
    digits : int
    """
    if not math.isfinite(gap):
        return "nothing is known of how much better the best possible is"
    if gap > 1.0:
        return f"the best possible is at most {at_most(1.0 + gap, digits)} times as good"
    return f"no placement is more than {at_most(100.0 * gap, digits)}% better"


def unit_of(component: str) -> str:
    """Return the unit of a wrench component, named as in ``COMPONENTS``."""
    return FORCE_UNIT if component.startswith("f") else MOMENT_UNIT


def axis_labels(dimension: int) -> list[str]:
    """Return the components of a wrench with their units, as the axes of a picture state them."""
    return [f"{name} [{unit_of(name)}]" for name in COMPONENTS[dimension]]


def wrench_words(wrench: FloatArray) -> str:
    """Return the components of a wrench (d,) that matter, with units."""
    named = list(zip(COMPONENTS[len(wrench)], map(float, wrench), strict=True))
    force, moment = (max(abs(value) for name, value in named if unit_of(name) == u) for u in (FORCE_UNIT, MOMENT_UNIT))
    least = {FORCE_UNIT: max(SMALL * force, moment / LONG), MOMENT_UNIT: max(SMALL * moment, SHORT * force)}
    parts = [f"{name} {value:.3g} {unit_of(name)}" for name, value in named if abs(value) > least[unit_of(name)]]
    return ", ".join(parts) or "zero"


def range_words(low: FloatArray, high: FloatArray) -> str:
    """Return the range of each component of a set of wrenches, (d,) least and (d,) largest values, with units.

    Components with the same range are named together: ``"f_x, f_y ±5 N; f_z 2.1 to 5.7 N"``; those that are zero alone
    are left out.
    """
    names = COMPONENTS[len(low)]
    groups: dict[tuple[str, str], list[str]] = {}
    for unit in (FORCE_UNIT, MOMENT_UNIT):
        alike = [i for i, name in enumerate(names) if unit_of(name) == unit]
        least = NOTHING * max(float(np.max(np.abs([low[alike], high[alike]]))), 0.0)
        for i in alike:
            ends = (rounded(float(low[i]), least=least), rounded(float(high[i]), least=least))
            groups.setdefault((_range(*ends), unit), []).append(names[i])
    told = [f"{', '.join(named)} {ends} {unit}" for (ends, unit), named in groups.items() if ends != "0"]
    return "; ".join(told) or "zero"


def _range(low: str, high: str) -> str:
    """Return a range of which the ends are given as text."""
    if low == high:
        return low
    return f"±{high}" if low == f"-{high}" else f"{low} to {high}"


def direction_words(wrench: FloatArray, length: float) -> str:
    """Return the direction of a wrench (d,) by its largest components; torques count over a length (metres)."""
    forces = [unit_of(name) == FORCE_UNIT for name in COMPONENTS[len(wrench)]]
    weight = np.abs(wrench) * np.where(forces, 1.0, length)
    parts = [
        label if wrench[i] > 0.0 else label.replace("along ", "along -").replace("about ", "about -")
        for i, label in enumerate(DIRECTIONS[len(wrench)])
        if weight[i] >= MINOR * np.max(weight)
    ]
    numbers = vector(wrench / max(float(np.linalg.norm(wrench)), 1e-300))
    return f"{' with '.join(parts)} (direction [{numbers}])"
