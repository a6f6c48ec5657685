"""Tables of delimited text, as other tools export them: delimiter, header, row of units, comments, decimal commas."""

from __future__ import annotations

import csv
import math
import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import chain, islice
from pathlib import Path

from nlpgrasp.common.files import check_regular_file
from nlpgrasp.common.validation import integer
from nlpgrasp.errors import InputError

Cells = list[str]
Test = Callable[[Cells], bool]

LARGEST_FILE = 500_000_000  # bytes
SAMPLE = 1000  # lines from which the delimiter is found
DELIMITERS = ";\t,| "
COMMENT = re.compile(r"\s*(#|%|//)+\s*")  # at the beginning of a line
DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?")
GROUPED = re.compile(r"[+-]?\d{1,3}(,\d{3})+")  # a decimal comma, or commas between thousands
NUMBER_LIKE = re.compile(r"[+-]?[\d.,]*\d([eE][+-]?\d+)?")
UNIT_SEPARATOR = re.compile(r"[\s:;,=()\[\]]+")  # between words of a line above the header
TEXT_ROWS = 3  # most rows of text between a header and its data


@dataclass(frozen=True)
class DelimitedTable:
    """Table of a text file.

    Parameters
    ----------
    name : str
        The file's path, for messages.
    header : list of str or None
        Names of the columns.
    units : list of str or None
        Cells of a row of units beside the header.
    rows : list of lists of str
        Cells without spaces around them; a row with more or fewer cells than the table is empty.
    lines : list of int
        Line of each row in the file.
    widths : list of int
        Number of cells of each row in the file.
    delimiter : str
    above : list of lists of str
        Cells of the rows above the header.
    """

    name: str
    header: Cells | None
    units: Cells | None
    rows: list[Cells]
    lines: list[int]
    widths: list[int]
    delimiter: str
    above: Sequence[Cells] = ()

    def stated_units(self, is_unit: Callable[[str], bool]) -> set[str]:
        """Return the units in rows above the header that have the word unit."""
        rows = [row for row in self.above if any("unit" in cell.lower() for cell in row)]
        words = [word for row in rows for cell in row for word in [cell, *UNIT_SEPARATOR.split(cell)]]
        return {word for word in words if is_unit(word)}

    def with_decimal_points(self, rows: Sequence[Cells]) -> list[Cells]:
        """Return cells of numbers with decimal points in place of decimal commas.

        Raises
        ------
        InputError
            Where they have both, or commas that may separate thousands.
        """
        commas = [cell for row in rows for cell in row if "," in cell and NUMBER_LIKE.fullmatch(cell)]
        if not commas:
            return list(rows)
        if any("." in cell and NUMBER_LIKE.fullmatch(cell) for row in rows for cell in row):
            raise InputError(f"{self.name}: decimals", "commas and points", "one of them in all numbers")
        if self.delimiter == "," and all(GROUPED.fullmatch(cell) for cell in commas):
            expected = "decimal points, or commas that cannot separate thousands"
            raise InputError(f"{self.name}: decimals", f"{commas[0]!r}", expected)
        return [[cell.replace(",", ".") if DECIMAL_COMMA.fullmatch(cell) else cell for cell in row] for row in rows]


def is_number(cell: str) -> bool:
    """Return whether a cell is a number with a decimal point, NaN or infinity."""
    try:
        float(cell)
    except ValueError:
        return False
    return "_" not in cell


def number_or_nan(cell: str | float) -> float:
    """Return the number in a cell; NaN where it is not a number, such as ``1_0``, which Python reads as 10."""
    return float(cell) if is_number(str(cell)) else math.nan


def read_delimited(
    path: Path, kind: str, is_header: Test, is_unit: Callable[[str], bool], skip_lines: object = 0
) -> DelimitedTable:
    """Read a table delimited by semicolons, tabs, commas, vertical bars or spaces.

    The delimiter is the one that makes a header, or else most numbers in rows of one width. Lines above the header and
    comments (``#``, ``%``, ``//``) are left out. A row of units under the header, or else right above it, is
    recognised. Cells left empty at the end of a row may be missing.

    Parameters
    ----------
    path : Path
    kind : str
        What the file should be, for messages.
    is_header : callable
        Whether cells are the names of the table's columns. Without such a row the table begins at the first row of the
        width that most rows have, which is a header if it has no number.
    is_unit : callable
        Whether a cell is a unit of the table's quantities.
    skip_lines : int
        Lines above the table that are not read.

    Raises
    ------
    InputError
        On a file that cannot be read, is empty, or too large; and where numbers stand above the header.
    """
    count = integer("skip_lines", skip_lines, at_least=0)
    try:
        check_regular_file(path, kind)
        if path.stat().st_size > LARGEST_FILE:
            raise InputError(str(path), f"{path.stat().st_size} bytes", f"at most {LARGEST_FILE}")
        try:
            delimiter, numbered = _read_cells(path, _encoding(path), count, is_header)
        except UnicodeDecodeError:
            delimiter, numbered = _read_cells(path, "cp1252", count, is_header)
    except (OSError, UnicodeError) as error:
        raise InputError(str(path), type(error).__name__, f"a readable file: {kind}") from None
    except csv.Error as error:
        raise InputError(str(path), str(error), f"{kind}, with each quotation mark closed") from None
    if not numbered:
        raise InputError(str(path), "an empty file", kind)
    return _table_of(str(path), delimiter, numbered, is_header, is_unit)


def _encoding(path: Path) -> str:
    """Return the encoding that a byte order mark states, else UTF-8."""
    with path.open("rb") as file:
        return "utf-16" if file.read(2) in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig"


def _read_cells(path: Path, encoding: str, skip_lines: int, is_header: Test) -> tuple[str, list[tuple[int, Cells]]]:
    """Return the delimiter, and line number and cells of each row that is not blank."""
    with path.open(newline="", encoding=encoding) as file:
        for _ in islice(file, skip_lines):
            pass
        sample = list(islice(file, SAMPLE))
        delimiter = _find_delimiter(sample, is_header)
        reader = csv.reader(chain(sample, file), delimiter=delimiter, skipinitialspace=True, strict=True)
        try:
            stripped = ((skip_lines + reader.line_num, [cell.strip() for cell in row]) for row in reader)
            return delimiter, [(line, cells) for line, cells in stripped if any(cells)]
        except csv.Error as error:
            raise csv.Error(f"{error} at line {skip_lines + reader.line_num}") from None


def _find_delimiter(lines: Sequence[str], is_header: Test) -> str:
    """Return the delimiter that makes a header, or else most numbers in rows of one width.

    Of equals, the one with fewest other cells among them, then the one with most cells.
    """

    def score(delimiter: str) -> tuple[bool, int, float, int]:
        try:
            rows = [row for row in csv.reader(lines, delimiter=delimiter, skipinitialspace=True) if len(row) > 1]
        except csv.Error:
            return False, -1, 0.0, 0
        width = _common_width(rows)
        cells = [cell.strip() for row in rows if len(row) == width for cell in row]
        numbers = sum(is_number(c) or (delimiter != "," and bool(NUMBER_LIKE.fullmatch(c))) for c in cells)
        has_header = any(_names_columns([cell.strip() for cell in row], is_header) for row in rows)
        return has_header, numbers, numbers / max(len(cells), 1), len(cells)

    scores = {delimiter: score(delimiter) for delimiter in DELIMITERS}
    best = max(DELIMITERS, key=lambda delimiter: scores[delimiter])
    return best if scores[best][-1] else ","


def _common_width(rows: Sequence[Cells]) -> int:
    """Return the number of cells that most rows have; of equals, the largest."""
    counts = Counter(map(len, rows))
    return max(counts, key=lambda width: (counts[width], width), default=0)


def _table_of(
    name: str, delimiter: str, numbered: list[tuple[int, Cells]], is_header: Test, is_unit: Callable[[str], bool]
) -> DelimitedTable:
    """Return the table in the rows of a file."""
    index = next((i for i, (_, row) in enumerate(numbered[:SAMPLE]) if _names_columns(row, is_header)), None)
    if index is None:
        rows = _without_comments(numbered)
        width = _common_width([row for _, row in rows])
        rows = rows[next(i for i, (_, row) in enumerate(rows) if len(row) == width) :]
        first = rows[0][1]
        header = None if any(_is_numeric(cell, delimiter) for cell in first) else first
        rows = rows if header is None else rows[1:]
    else:
        header, rows = _without_mark(numbered[index][1]), _without_comments(numbered[index + 1 :])
        _check_above(name, numbered[:index], rows, header, delimiter)
        width = len(header)
    units = None
    if header is not None:
        rows, units = _take_units(rows, width, delimiter, is_unit)
        if units is None and index and len(numbered[index - 1][1]) == width:
            units = _take_units([numbered[index - 1]], width, delimiter, is_unit)[1]
    else:
        while width > 1 and all(len(row) < width or not row[width - 1] for _, row in rows):
            width -= 1
    _check_quotes(name, rows, width, delimiter)
    is_short = any(len(row) < width for _, row in rows)
    text_columns = _trailing_text([row for _, row in rows], width, delimiter) if is_short else 0
    cells = [_fit(row, width, text_columns) for _, row in rows]
    lines, widths, above = [line for line, _ in rows], [len(row) for _, row in rows], [r for _, r in numbered[:index]]
    return DelimitedTable(name, header, units, cells, lines, widths, delimiter, above if index else ())


def _names_columns(row: Cells, is_header: Test) -> bool:
    """Return whether a row that is not mostly numbers names the table's columns."""
    return 2 * sum(map(is_number, row)) < len(row) and is_header(_without_mark(row))


def _is_numeric(cell: str, delimiter: str) -> bool:
    """Return whether a cell is a number, perhaps with a decimal comma."""
    return is_number(cell) or (delimiter != "," and bool(DECIMAL_COMMA.fullmatch(cell)))


def _without_mark(row: Cells) -> Cells:
    """Return a row without the mark of a comment, such as that before a header."""
    first = COMMENT.sub("", row[0], count=1)
    return row[1:] if not first and row[0] and len(row) > 1 else [first, *row[1:]]


def _without_comments(numbered: list[tuple[int, Cells]]) -> list[tuple[int, Cells]]:
    """Return the rows that are no comments; all of them where all begin as comments do."""
    rows = [(line, row) for line, row in numbered if not COMMENT.match(row[0])]
    return rows or numbered


def _check_above(
    name: str, above: list[tuple[int, Cells]], below: list[tuple[int, Cells]], header: Cells, delimiter: str
) -> None:
    """Raise if a row above the header has numbers in the columns in which the first row of numbers below it has them.

    Such a row may belong to the table, or to another one with more columns.
    """

    def numeric(row: Cells) -> list[bool]:
        return [_is_numeric(cell, delimiter) for cell in row]

    sample = next((numeric(row) for _, row in below if len(row) == len(header) and any(numeric(row))), None)
    for line, row in above:
        if sample is not None and len(row) >= len(header) and numeric(row)[: len(header)] == sample:
            expected = "the header above all rows of numbers, or skip_lines="
            raise InputError(f"{name}: line {line}", "numbers above the header", expected)


def _check_quotes(name: str, rows: list[tuple[int, Cells]], width: int, delimiter: str) -> None:
    """Raise if a quoted cell of several lines has a whole row of the table: a quotation mark that was never closed."""
    previous = 0
    for line, row in rows:
        spans = line - previous > 1 and any("\n" in cell or "\r" in cell for cell in row)
        previous = line
        if spans and any(part.count(delimiter) >= width - 1 for cell in row for part in cell.splitlines()[1:]):
            given = "a cell in quotation marks that contains rows of the table"
            raise InputError(f"{name}: line {line}", given, "each quotation mark closed")


def _take_units(
    rows: list[tuple[int, Cells]], width: int, delimiter: str, is_unit: Callable[[str], bool]
) -> tuple[list[tuple[int, Cells]], Cells | None]:
    """Return the rows without one of units, and that: the first of text under the header that has a unit."""
    for i, (_, row) in enumerate(rows[:TEXT_ROWS]):
        if any(_is_numeric(cell, delimiter) for cell in row):
            break
        if any(map(is_unit, row)):
            return [*rows[:i], *rows[i + 1 :]], [*row, *[""] * width][: max(width, len(row))]
    return rows, None


def _trailing_text(rows: Sequence[Cells], width: int, delimiter: str) -> int:
    """Return how many of the last columns have no number in any row: their cells may be missing at a row's end."""
    count = 0
    while count < width and not any(len(row) == width and _is_numeric(row[-1 - count], delimiter) for row in rows):
        count += 1
    return count


def _fit(row: Cells, width: int, text_columns: int) -> Cells:
    """Return a row with ``width`` cells, empty ones added or left out at its end; an empty row where it has others."""
    if len(row) > width:
        return row[:width] if not any(row[width:]) else []
    return row + [""] * (width - len(row)) if width - len(row) <= text_columns else []
