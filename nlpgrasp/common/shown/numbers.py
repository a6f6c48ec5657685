"""Number formatting: few significant digits, and intervals rounded outwards."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from decimal import ROUND_CEILING, ROUND_FLOOR, Decimal

DIGITS = 3
SMALLEST, LARGEST = 1e-4, 1e7  # range of magnitudes written without exponent
RAISED = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")
MOST = 6  # most digits of an interval's ends


def rounded(value: float, digits: int = DIGITS, least: float = 0.0) -> str:
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
    return _plain(Decimal(f"{value:.{digits - 1}e}"))


def vector(values: Iterable[float], digits: int = DIGITS, relative: float = 1e-4) -> str:
    """Format numbers as a comma-separated list; those below a share of the largest are 0."""
    numbers = [float(v) for v in values]
    least = relative * max((abs(v) for v in numbers), default=0.0)
    return ", ".join(rounded(v, digits, least) for v in numbers)


def outwards(lower: float, upper: float, digits: int = DIGITS) -> tuple[str, str]:
    """Format the ends of an interval, rounded outwards, with enough digits to distinguish them.

    Parameters
    ----------
    lower, upper : float
        At least zero; the upper may be infinite.
        digits : int
        Least number of significant digits.
    """
    for more in range(digits, MOST + 1):
        ends = _cut(lower, more, ROUND_FLOOR), _cut(upper, more, ROUND_CEILING)
        between = _cut(upper, more, ROUND_FLOOR)
        if lower == upper or ends[0] != between:
            break
    return ends


def at_least(value: float, digits: int = DIGITS) -> str:
    """Format a lower bound with few digits, rounded down."""
    return _cut(value, digits, ROUND_FLOOR)


def at_most(value: float, digits: int = DIGITS) -> str:
    """Format an upper bound with few digits, rounded up."""
    return _cut(value, digits, ROUND_CEILING)


def percent(share: float, digits: int = 2) -> str:
    """Format a share as a percentage, such as ``33 %``."""
    return f"{rounded(100.0 * share, digits)} %"


def typeset(text: str) -> str:
    """Return a text with typographic minus signs, superscript exponents and no-break spaces before units."""
    raised = re.sub(r"(?<=\d)e(-?\d+)\b", lambda found: f"×10{found[1].translate(RAISED)}", text)  # noqa: RUF001
    whole = re.sub(r"(?<=\d) (?=(?:%|N|mm|m)\b|%)", "\N{NO-BREAK SPACE}", raised)
    return re.sub(r"(?<![\w-])-(?=\.?\d|[xyz]\b)", "\N{MINUS SIGN}", whole)


def _cut(value: float, digits: int, way: str) -> str:
    """Format a number with significant digits, rounded down or up."""
    if not math.isfinite(value) or value == 0.0:
        return rounded(value)
    exact = Decimal(f"{value:.12g}")  # 0.3 is meant to be 0.3
    return _plain(exact.quantize(Decimal((0, (1,), exact.adjusted() - digits + 1)), rounding=way))


def _plain(value: Decimal) -> str:
    if value == 0:
        return "0"
    if SMALLEST <= abs(value) < LARGEST:
        text = f"{value:f}"
        return text.rstrip("0").rstrip(".") if "." in text else text
    mantissa, exponent = f"{value.normalize():e}".split("e")
    return f"{mantissa}e{int(exponent)}"
