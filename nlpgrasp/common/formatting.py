"""Formatting of numbers, intervals, forces and wrenches as text."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from decimal import ROUND_CEILING, ROUND_FLOOR, Decimal

import numpy as np

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import NlpgraspError

DIGITS = 3  # significant digits by default
SMALLEST, LARGEST = 1e-4, 1e7  # range of magnitudes written without exponent
RAISED = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")  # superscripts
MOST = 6  # most digits of an interval's ends
LONGEST = 1000  # most characters of a line
WIDEST = 60  # most characters of a column
FORCE_UNIT, MOMENT_UNIT = "N", "N m"
COMPONENTS = {3: ("f_x", "f_y", "m_z"), 6: ("f_x", "f_y", "f_z", "m_x", "m_y", "m_z")}  # wrench, by dimension
DIRECTIONS = {
    3: ("a force along x", "a force along y", "a torque"),
    6: (*(f"a force along {a}" for a in "xyz"), *(f"a torque about {a}" for a in "xyz")),
}
SMALL = 0.02  # of the largest force or moment: components below are omitted
SHORT, LONG = 1e-4, 1e3  # m, moment arms beyond which moments (shorter) and forces (longer) are omitted
NEGLIGIBLE = 1e-6  # of the largest component: components below are zero
MINOR = 0.3  # of a direction's largest component: components below are omitted


def format_number(value: float, digits: int = DIGITS, least: float = 0.0) -> str:
    """Format a number with few digits, such as 0.02, -1.5, 12300, 3.1e-6, without -0 and trailing zeros.

    Parameters
    ----------
    value : float
        Infinity is written as ``inf``.
    digits : int
        Significant digits.
    least : float
        Magnitude up to which a number counts as zero.
    """
    if not math.isfinite(value):
        return f"{value:g}"
    if abs(value) <= least:
        return "0"
    return _plain_decimal(Decimal(f"{value:.{digits - 1}e}"))


def vector(values: Iterable[float], digits: int = DIGITS, relative: float = 1e-4) -> str:
    """Format numbers as a comma-separated list, with 0 for relatively small ones."""
    numbers = [float(v) for v in values]
    least = relative * max((abs(v) for v in numbers), default=0.0)
    return ", ".join(format_number(v, digits, least) for v in numbers)


def format_interval(lower: float, upper: float, digits: int = DIGITS) -> tuple[str, str]:
    """Format the ends of an interval, rounded outwards, with enough digits to distinguish them.

    Parameters
    ----------
    lower, upper : float
        At least zero; the upper may be infinite.
        digits : int
        Least number of significant digits.
    """
    for precision in range(digits, MOST + 1):
        ends = _round_towards(lower, precision, ROUND_FLOOR), _round_towards(upper, precision, ROUND_CEILING)
        lower_of_upper = _round_towards(upper, precision, ROUND_FLOOR)
        if lower == upper or ends[0] != lower_of_upper:
            break
    return ends


def format_lower(value: float, digits: int = DIGITS) -> str:
    """Format a lower bound with few digits, rounded down."""
    return _round_towards(value, digits, ROUND_FLOOR)


def format_upper(value: float, digits: int = DIGITS) -> str:
    """Format an upper bound with few digits, rounded up."""
    return _round_towards(value, digits, ROUND_CEILING)


def format_percent(fraction: float, digits: int = 2) -> str:
    """Format a fraction as a percentage, such as ``33 %``."""
    return f"{format_number(100.0 * fraction, digits)} %"


def typeset(text: str) -> str:
    """Return a text with typographic minus signs, superscript exponents and no-break spaces before units."""
    raised = re.sub(r"(?<=\d)e(-?\d+)\b", lambda match: f"×10{match[1].translate(RAISED)}", text)  # noqa: RUF001
    spaced = re.sub(r"(?<=\d) (?=(?:%|N|mm|m)\b|%)", "\N{NO-BREAK SPACE}", raised)
    return re.sub(r"(?<![\w-])-(?=\.?\d|[xyz]\b)", "\N{MINUS SIGN}", spaced)


def _round_towards(value: float, digits: int, rounding: str) -> str:
    """Format a number with few significant digits, rounded down or up."""
    if not math.isfinite(value) or value == 0.0:
        return format_number(value)
    exact = Decimal(f"{value:.12g}")  # 0.3 is meant to be 0.3
    return _plain_decimal(exact.quantize(Decimal((0, (1,), exact.adjusted() - digits + 1)), rounding=rounding))


def _plain_decimal(value: Decimal) -> str:
    """Return a decimal as text, with an exponent if it is very small or large."""
    if value == 0:
        return "0"
    if SMALLEST <= abs(value) < LARGEST:
        text = f"{value:f}"
        return text.rstrip("0").rstrip(".") if "." in text else text
    mantissa, exponent = f"{value.normalize():e}".split("e")
    return f"{mantissa}e{int(exponent)}"


def error_line(error: BaseException) -> str:
    """Return the message of an error as one nonempty line of printable characters."""
    text = str(error)
    if not isinstance(error, NlpgraspError) or not text.strip():
        text = f"{type(error).__name__}: {text}" if text.strip() else type(error).__name__
    return single_line(text)


def single_line(text: str) -> str:
    """Return a text as one line of printable characters, truncated if very long."""
    words = " ".join(text.split())
    return "".join(c if c.isprintable() else "?" for c in words)[:LONGEST]


def capitalise(text: str) -> str:
    """Return a text with its first letter capitalised."""
    return f"{text[:1].upper()}{text[1:]}"


def columns(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Return the lines of a table with aligned columns.

    Long entries are truncated, empty columns omitted.
    """
    table = [list(heads), *([_shorten_entry(entry) for entry in row] for row in rows)]
    filled = [i for i in range(len(heads)) if any(row[i] for row in table[1:])]
    widths = [max(len(row[i]) for row in table) for i in filled]
    return ["  ".join(row[i].ljust(w) for i, w in zip(filled, widths, strict=True)).rstrip() for row in table]


def _shorten_entry(entry: str) -> str:
    """Return a table entry, truncated to the largest column width."""
    return entry if len(entry) <= WIDEST else entry[: WIDEST - 3] + "..."


def format_measure(kind: str) -> str:
    """Return the displayed name of a quality measure."""
    return "mu-tilde" if kind == "mu_tilde" else kind or "mu"


def format_headroom(gap: float, digits: int = DIGITS) -> str:
    """Return a text on the largest possible improvement over a grasp.

    The number is rounded up.

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
        return f"the best possible is at most {format_upper(1.0 + gap, digits)} times better"
    return f"no placement is more than {format_upper(100.0 * gap, digits)}% better"


def unit_of(component: str) -> str:
    """Return the unit of a wrench component, given its name."""
    return FORCE_UNIT if component.startswith("f") else MOMENT_UNIT


def axis_labels(dimension: int) -> list[str]:
    """Return the axis labels of the wrench components, with units."""
    return [f"{name} [{unit_of(name)}]" for name in COMPONENTS[dimension]]


def format_wrench(wrench: FloatArray) -> str:
    """Return the significant components of a wrench (d,) as text with units."""
    components = list(zip(COMPONENTS[len(wrench)], map(float, wrench), strict=True))
    force, moment = (
        max(abs(value) for name, value in components if unit_of(name) == u) for u in (FORCE_UNIT, MOMENT_UNIT)
    )
    least = {FORCE_UNIT: max(SMALL * force, moment / LONG), MOMENT_UNIT: max(SMALL * moment, SHORT * force)}
    parts = [f"{name} {value:.3g} {unit_of(name)}" for name, value in components if abs(value) > least[unit_of(name)]]
    return ", ".join(parts) or "zero"


def format_ranges(low: FloatArray, high: FloatArray) -> str:
    """Return the ranges of wrench components as text with units, given least (d,) and largest values (d,).

    Components with equal ranges are combined: ``"f_x, f_y ±5 N; f_z 2.1 to 5.7 N"``; those that are always zero are
    omitted.
    """
    names = COMPONENTS[len(low)]
    groups: dict[tuple[str, str], list[str]] = {}
    for unit in (FORCE_UNIT, MOMENT_UNIT):
        indices = [i for i, name in enumerate(names) if unit_of(name) == unit]
        least = NEGLIGIBLE * max(float(np.max(np.abs([low[indices], high[indices]]))), 0.0)
        for i in indices:
            ends = (format_number(float(low[i]), least=least), format_number(float(high[i]), least=least))
            groups.setdefault((_range(*ends), unit), []).append(names[i])
    texts = [f"{', '.join(labels)} {ends} {unit}" for (ends, unit), labels in groups.items() if ends != "0"]
    return "; ".join(texts) or "zero"


def _range(low: str, high: str) -> str:
    """Return a range as text, given its formatted ends."""
    if low == high:
        return low
    return f"±{high}" if low == f"-{high}" else f"{low} to {high}"


def format_wrench_direction(wrench: FloatArray, length: float) -> str:
    """Return a direction (d,) of wrench space as text, by its largest components.

    Moments are multiplied by ``length``, metres, to compare them with forces.
    """
    forces = [unit_of(name) == FORCE_UNIT for name in COMPONENTS[len(wrench)]]
    weight = np.abs(wrench) * np.where(forces, 1.0, length)
    parts = [
        label if wrench[i] > 0.0 else label.replace("along ", "along -").replace("about ", "about -")
        for i, label in enumerate(DIRECTIONS[len(wrench)])
        if weight[i] >= MINOR * np.max(weight)
    ]
    components = vector(wrench / max(float(np.linalg.norm(wrench)), 1e-300))
    return f"{' with '.join(parts)} (direction [{components}])"
