"""Text formatting of forces, moments and wrenches, with labels and units."""

from __future__ import annotations

import math

import numpy as np

from nlpgrasp.common.shown.numbers import DIGITS, at_most, rounded, vector
from nlpgrasp.common.validation import FloatArray

FORCE_UNIT, MOMENT_UNIT = "N", "N m"
COMPONENTS = {3: ("f_x", "f_y", "m_z"), 6: ("f_x", "f_y", "f_z", "m_x", "m_y", "m_z")}  # wrench, by dimension
DIRECTIONS = {
    3: ("a force along x", "a force along y", "a torque"),
    6: (*(f"a force along {a}" for a in "xyz"), *(f"a torque about {a}" for a in "xyz")),
}
SMALL = 0.02  # of the largest force or moment: components below are omitted
SHORT, LONG = 1e-4, 1e3  # m, moment arms beyond which moments (shorter) and forces (longer) are omitted
NOTHING = 1e-6  # of the largest component: components below are zero
MINOR = 0.3  # of a direction's largest component: components below are omitted


def measure_word(kind: str) -> str:
    """Return the displayed name of a quality measure."""
    return "mu-tilde" if kind == "mu_tilde" else kind or "mu"


def headroom_words(gap: float, digits: int = DIGITS) -> str:
    """Return a text on the largest possible improvement over a grasp, rounded up.

    Parameters
    ----------
    gap : float
        ``upper / mu - 1`` from a global upper bound and the grasp's certified quality. Above 1 it is given as a
        multiple; inf if unknown.
    digits : int
    """
    if not math.isfinite(gap):
        return "nothing is known of how much better the best possible is"
    if gap > 1.0:
        return f"the best possible is at most {at_most(1.0 + gap, digits)} times as good"
    return f"no placement is more than {at_most(100.0 * gap, digits)}% better"


def unit_of(component: str) -> str:
    """Return the unit of a wrench component of ``COMPONENTS``."""
    return FORCE_UNIT if component.startswith("f") else MOMENT_UNIT


def axis_labels(dimension: int) -> list[str]:
    """Return the axis labels of wrench components, with units."""
    return [f"{name} [{unit_of(name)}]" for name in COMPONENTS[dimension]]


def wrench_words(wrench: FloatArray) -> str:
    """Return the significant components of a wrench (d,) as text, with units."""
    named = list(zip(COMPONENTS[len(wrench)], map(float, wrench), strict=True))
    force, moment = (max(abs(value) for name, value in named if unit_of(name) == u) for u in (FORCE_UNIT, MOMENT_UNIT))
    least = {FORCE_UNIT: max(SMALL * force, moment / LONG), MOMENT_UNIT: max(SMALL * moment, SHORT * force)}
    parts = [f"{name} {value:.3g} {unit_of(name)}" for name, value in named if abs(value) > least[unit_of(name)]]
    return ", ".join(parts) or "zero"


def range_words(low: FloatArray, high: FloatArray) -> str:
    """Return the ranges of wrench components as text with units, from smallest (d,) and largest values (d,).

    Components with equal ranges are combined: ``"f_x, f_y ±5 N; f_z 2.1 to 5.7 N"``; those that are always zero are
    omitted.
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
    """Return a range as text from its formatted ends."""
    if low == high:
        return low
    return f"±{high}" if low == f"-{high}" else f"{low} to {high}"


def direction_words(wrench: FloatArray, length: float) -> str:
    """Return a wrench's direction (d,) as text of its largest components; torques are divided by a length, metres."""
    forces = [unit_of(name) == FORCE_UNIT for name in COMPONENTS[len(wrench)]]
    weight = np.abs(wrench) * np.where(forces, 1.0, length)
    parts = [
        label if wrench[i] > 0.0 else label.replace("along ", "along -").replace("about ", "about -")
        for i, label in enumerate(DIRECTIONS[len(wrench)])
        if weight[i] >= MINOR * np.max(weight)
    ]
    numbers = vector(wrench / max(float(np.linalg.norm(wrench)), 1e-300))
    return f"{' with '.join(parts)} (direction [{numbers}])"
