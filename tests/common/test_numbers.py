"""Formatting of numbers and intervals."""

import math

import numpy as np
import pytest

from nlpgrasp.common.formatting import (
    format_interval,
    format_lower,
    format_number,
    format_percent,
    format_upper,
    typeset,
    vector,
)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.019999999, "0.02"),
        (-0.0, "0"),
        (0.1 + 0.2, "0.3"),
        (-1.5, "-1.5"),
        (12345.0, "12300"),
        (99.96, "100"),
        (100.0, "100"),
        (1.23456e-4, "0.000123"),
        (-3.14159e-6, "-3.14e-6"),
        (2.0e8, "2e8"),
        (math.inf, "inf"),
    ],
)
def test_three_digits_and_no_more(value, text):
    assert format_number(value) == text


def test_what_is_rounding_alone_is_zero():
    assert format_number(-1e-17, least=1e-9) == "0"
    assert vector([0.04, -1e-18, -0.0199999]) == "0.04, 0, -0.02"
    assert vector([0.0, -0.0]) == "0, 0"


def test_every_text_reads_back_to_three_digits(rng):
    for value in 10.0 ** rng.uniform(-9, 9, 400) * rng.choice([-1.0, 1.0], 400):
        assert float(format_number(value)) == pytest.approx(value, rel=5.1e-3)
        assert float(format_number(value)) == float(f"{value:.3g}")


def test_intervals_are_rounded_outwards(rng):
    assert format_interval(0.068166, 0.068622) == ("0.0681", "0.0687")
    assert format_interval(0.3, 0.3) == ("0.3", "0.3")
    assert format_interval(0.0, math.inf) == ("0", "inf")
    for lower in 10.0 ** rng.uniform(-6, 6, 200):
        upper = lower * (1.0 + 10.0 ** rng.uniform(-5, 0))
        low, high = format_interval(lower, upper)
        assert float(low) <= lower <= upper <= float(high)
        assert float(low) < float(high)
        assert float(high) - float(low) <= 2.1 * 10.0 ** np.floor(np.log10(upper) - 2) + (upper - lower)


def test_single_bounds_are_rounded_to_their_side(rng):
    assert (format_lower(0.23456), format_upper(0.23456), format_upper(0.0933456, 4)) == ("0.234", "0.235", "0.09335")
    assert (format_lower(0.0), format_upper(math.inf), format_upper(0.3)) == ("0", "inf", "0.3")
    for value in 10.0 ** rng.uniform(-6, 6, 200):
        assert float(format_lower(value)) <= value <= float(format_upper(value))


def test_shares():
    assert format_percent(0.2345) == "23 %"
    assert format_percent(1.0) == "100 %"


def test_pages_have_minus_signs_and_units_that_stay():
    minus, space = "\N{MINUS SIGN}", "\N{NO-BREAK SPACE}"
    assert typeset("-0.2, [-3] peg-in-hole -.5 x-1") == f"{minus}0.2, [{minus}3] peg-in-hole {minus}.5 x-1"
    assert typeset("along -x 3 N, 10 % off") == f"along {minus}x 3{space}N, 10{space}% off"
    assert typeset("3.1e-6") == "3.1\N{MULTIPLICATION SIGN}10⁻⁶"
