"""Numerical tables from CSV files, pandas frames and arrays."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.common.validation import LARGEST, FloatArray
from nlpgrasp.errors import InputError

LARGEST_FILE = 500_000_000  # bytes


@dataclass(frozen=True)
class Table:
    """A table: rows of cells with an optional header.

    Parameters
    ----------
    name : str
        For messages: a file's path.
    header : list of str or None
    rows : list of lists, or (m, n) array
        Text for a file, numbers for an array; rows with more or fewer cells than the first are empty.
    lines : (m,) array
        Line number of each row in the file; for an array the row index, from 0.
    comma : bool
        Whether decimal commas are allowed, since the delimiter is another.
    """

    name: str
    header: list[str] | None
    rows: list[list[str]] | FloatArray
    lines: NDArray[np.intp]
    comma: bool = False

    @property
    def width(self) -> int:
        """Number of columns."""
        return len(self.rows[0]) if len(self.rows) else len(self.header or ())

    def numbers(self, columns: list[int]) -> FloatArray:
        """Return selected columns as numbers, (m, len(columns)), NaN where a cell is not a number.

        Raises
        ------
        InputError
            When a file has both decimal commas and decimal points.
        """
        if not isinstance(self.rows, list):
            found = self.rows[:, columns]
        else:
            cells = [[row[c] if c < len(row) else "" for c in columns] for row in self.rows]
            commas = self.comma and any("," in cell for row in cells for cell in row)
            if commas and any("." in cell for row in cells for cell in row):
                raise InputError(f"{self.name}: decimals", "commas and points", "one of them in all numbers")
            found = np.array([[_number(cell.replace(",", ".") if commas else cell) for cell in row] for row in cells])
        return np.where(np.abs(found) <= LARGEST, found, np.nan).reshape(-1, len(columns))


def csv_table(path: Path) -> Table:
    """Read a CSV file delimited by semicolons, tabs or commas.

    Raises
    ------
    InputError
        On a file that cannot be read, is empty, or too large.
    """
    try:
        if path.stat().st_size > LARGEST_FILE:
            raise InputError(str(path), f"{path.stat().st_size} bytes", f"at most {LARGEST_FILE}")
        with path.open(newline="", encoding="utf-8-sig") as file:
            sample = file.read(4096)
            file.seek(0)
            delimiter = next((sign for sign in ";\t" if sign in sample), ",")
            reader = csv.reader(file, delimiter=delimiter)
            both = [
                (row[:-1] if len(row) > 1 and not row[-1].strip() else row, reader.line_num) for row in reader if row
            ]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(str(path), type(error).__name__, "a readable CSV file") from None
    if not both:
        raise InputError(str(path), "an empty file", "a CSV file of wrenches")
    width, comma = len(both[0][0]), delimiter != ","
    rows, lines = [row if len(row) == width else [] for row, _ in both], np.array([line for _, line in both], np.intp)
    named = any(rows[0]) and not any(_is_number(cell.replace(",", ".") if comma else cell) for cell in rows[0])
    if named:
        return Table(str(path), rows[0], rows[1:], lines[1:], comma)
    return Table(str(path), None, rows, lines, comma)


def table_of(field: str, value: object) -> Table:
    """Return the table of a pandas frame or an array.

    Raises
    ------
    InputError
        On other types, or other than two dimensions.
    """
    names, header = getattr(value, "columns", None), None
    if names is not None and hasattr(value, "to_numpy"):
        own = [str(name) if isinstance(name, str) else "" for name in names]
        header = own if any(own) else None
        cells = np.column_stack([_column(value, i) for i in range(len(own))]) if own else np.zeros((0, 0))
    else:
        try:
            given = np.asarray(value)
            if given.dtype.kind not in "iuf":
                raise TypeError
            cells = np.asarray(given, dtype=float)
        except (TypeError, ValueError, OverflowError):
            raise InputError(field, value, "a pandas frame or an array of numbers") from None
    if cells.ndim != 2 or not len(cells):
        raise InputError(field, f"shape {cells.shape}", "rows of numbers, at least one")
    return Table(field, header, cells, np.arange(len(cells)))


def _column(frame: Any, i: int) -> FloatArray:
    """Return a column of a pandas frame as numbers, NaN where it holds anything else."""
    values = frame.iloc[:, i].to_numpy()
    if values.dtype.kind in "iuf":
        return np.asarray(values, dtype=float)
    if values.dtype.kind == "O":
        return np.array([_number(cell) if isinstance(cell, str | int | float) else np.nan for cell in values])
    return np.full(len(values), np.nan)


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _number(cell: str | float) -> float:
    """Return a cell as a number, NaN where it is not a number."""
    try:
        return float(cell)
    except ValueError:
        return float("nan")
