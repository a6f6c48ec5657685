"""Lines and columns of text."""

from nlpgrasp.common.formatting import LONGEST, WIDEST, columns, error_line, single_line
from nlpgrasp.errors import InputError


def test_an_error_in_one_line():
    assert error_line(InputError("seed", -1, "0 or more")) == "seed: got -1, expected 0 or more"
    assert error_line(ValueError("two\n  lines\x07")) == "ValueError: two lines?"
    assert error_line(RuntimeError()) == "RuntimeError"


def test_plain_text_is_cut():
    assert single_line("a" * (LONGEST + 1)) == "a" * LONGEST


def test_columns_are_aligned_and_empty_ones_left_out():
    lines = columns(["name", "nothing", "mu"], [["table", "", "0.5"], ["x" * 61, "", "0.25"]])
    cut = "x" * (WIDEST - 3) + "..."
    assert lines == ["name".ljust(WIDEST) + "  mu", "table".ljust(WIDEST) + "  0.5", cut + "  0.25"]
