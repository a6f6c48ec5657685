"""Tables of wrenches from CSV files, pandas frames and arrays: columns and units."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from nlpgrasp.common.delimited_text import DelimitedTable, is_number, number_or_nan, read_delimited
from nlpgrasp.common.user_warnings import warn_once
from nlpgrasp.common.validation import LARGEST, FloatArray, IntArray
from nlpgrasp.errors import InputError

FORCES = {  # N per unit
    "N": 1.0,
    "mN": 1e-3,
    "cN": 1e-2,
    "daN": 10.0,
    "kN": 1e3,
    "lbf": 4.4482216152605,
    "kgf": 9.80665,
}
TORQUES = {  # N m per unit
    "Nm": 1.0,
    "mNm": 1e-3,
    "Nmm": 1e-3,
    "Ncm": 1e-2,
    "cNm": 1e-2,
    "daNm": 10.0,
    "kNm": 1e3,
    "kNmm": 1.0,
    "lbfin": 0.1129848290276167,
    "lbfft": 1.3558179483314004,
    "kgfm": 9.80665,
    "kgfcm": 0.0980665,
}
SPELT = {  # units as the tables above spell them
    r"newtons?": "N",
    r"kilo": "k",
    r"milli": "m",
    r"centi": "c",
    r"met(er|re)s?": "m",
    r"inch(es)?": "in",
    r"f(oo|ee)t": "ft",
    r"pounds?force": "lbf",
    r"^lbs?(?=$|in$|ft$)": "lbf",
    r"^(in)(lbf?s?)$": "lbfin",
    r"^(ft)(lbf?s?)$": "lbfft",
}
NO_VALUES = {"", "-", "--", "---", "n/a", "na", "#n/a", "null", "none", "missing", "invalid", "error", "overflow"}
# quantity and axis of the columns of a wrench
SPATIAL = (("f", "x"), ("f", "y"), ("f", "z"), ("m", "x"), ("m", "y"), ("m", "z"))
PLANAR = (("f", "x"), ("f", "y"), ("m", "z"))
# recognition of column names
QUANTITIES = {"f": "f", "force": "f", "m": "m", "t": "m", "torque": "m", "moment": "m", "wrench": "w", "ft": "w"}
WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+")  # also of camelCase, and a number behind a word
ONE_WORD = re.compile(r"(force|torque|moment|f|m|t)(x|y|z)")  # quantity and axis without a separator
BRACKETED_UNIT = re.compile(r"[\[(](?!\s*\d+\s*[\])])([^\])]*)[\])]")  # anything in brackets but an index
BEFORE_UNIT = re.compile(r"[\s_/,.:]+(?:in\s+)?")  # separates a unit at the end of a name
BETWEEN_UNITS = re.compile("[\\s*_.\u00b7\u22c5\u2022\u00d7-]")  # signs between the units of a product
# components of columns numbered from 0 or 1, by quantity and count
NUMBERED = {("f", 3): SPATIAL[:3], ("m", 3): SPATIAL[3:], ("f", 6): SPATIAL, ("w", 6): SPATIAL}


@dataclass(frozen=True)
class WrenchTable:
    """Table of rows of cells, with an optional header.

    Parameters
    ----------
    name : str
        For messages: a file's path.
    header : list of str or None
    rows : list of lists, or (m, n) array
        Text for a file, numbers for an array; rows with more or fewer cells than the first are empty.
    lines : (m,) array
        Line number of each row in the file; for an array the row index, from 0.
    text : DelimitedTable, optional
        Table of the file.
    units : list of str, optional
        Row of units beside the header.
    """

    name: str
    header: list[str] | None
    rows: list[list[str]] | FloatArray
    lines: IntArray
    text: DelimitedTable | None = None
    units: list[str] | None = None

    @property
    def width(self) -> int:
        """Number of columns."""
        if self.header is not None:
            return len(self.header)
        return max(map(len, self.rows), default=0)

    def numbers(self, columns: list[int]) -> FloatArray:
        """Return selected columns as numbers, (m, len(columns)), NaN where a cell is not a number.

        Raises
        ------
        InputError
            When a file has both decimal commas and decimal points, or a row under the header that may be of units.
        """
        if not isinstance(self.rows, list):
            values = self.rows[:, columns]
        else:
            cells = [[row[c] if c < len(row) else "" for c in columns] for row in self.rows]
            if self.header is not None and cells and not any(_is_missing_or_number(cell) for cell in cells[0]):
                allowed = f"numbers, or units such as {', '.join([*FORCES][:4])} and {', '.join([*TORQUES][:4])}"
                raise InputError(f"{self.name}: line {self.lines[0]}, under the header", ", ".join(cells[0]), allowed)
            if self.text is not None:
                cells = self.text.with_decimal_points(cells)
            values = np.array([[number_or_nan(cell) for cell in row] for row in cells])
        return np.where(np.abs(values) <= LARGEST, values, np.nan).reshape(-1, len(columns))

    def check_invalid(self, indices: IntArray) -> None:
        """Raise if one of the rows without numbers is another header, or another row of units."""
        for i in indices if isinstance(self.rows, list) else ():
            row = self.rows[i]
            is_other_header = len(_wrench_columns(row)) >= len(PLANAR) and row != self.header
            if is_other_header or (any(map(_is_unit, row)) and row != self.units):
                given = ", ".join(cell for cell in row if cell)
                raise InputError(f"{self.name}: line {self.lines[i]}", given, "one header, and one row of units")

    def stated_units(self, columns: Sequence[int]) -> list[str | None]:
        """Return the unit that the header, or the row of units under it, states for each column.

        Raises
        ------
        InputError
            When they differ.
        """
        result: list[str | None] = []
        for column in columns:
            in_header = _split_unit(self.header[column])[1] if self.header else None
            below = _bare_unit(self.units[column]) if self.units and column < len(self.units) else ""
            if below and in_header is not None and _is_unit(in_header) and _unit_name(in_header) != _unit_name(below):
                given = f"{in_header!r} in the header and {below!r} in the row of units"
                raise InputError(f"{self.name}: units", given, "one unit for a column")
            result.append(below or in_header)
        return result


def csv_table(path: Path, columns: object = None, skip_lines: object = 0) -> WrenchTable:
    """Read a table from a text file delimited by semicolons, tabs, commas, vertical bars or spaces.

    Parameters
    ----------
    path : Path
    columns : sequence of str or int, or None
        Explicit columns, by whose names the header is found.
    skip_lines : int
        Lines above the table.

    Raises
    ------
    InputError
        As ``read_delimited``.
    """
    names = {name for name in columns if isinstance(name, str)} if isinstance(columns, list | tuple) else set()

    def is_header(row: list[str]) -> bool:
        return names <= set(row) if names else len(_wrench_columns(row)) >= len(PLANAR)

    text = read_delimited(path, "a CSV file of wrenches", is_header, _is_unit, skip_lines)
    return WrenchTable(text.name, text.header, text.rows, np.array(text.lines, np.intp), text, text.units)


def table_of(field: str, value: object) -> WrenchTable:
    """Return the table of a pandas frame or an array.

    Raises
    ------
    InputError
        On other types, or other than two dimensions.
    """
    names, header, units, first = getattr(value, "columns", None), None, None, 0
    if names is not None and hasattr(value, "to_numpy"):
        labels = [str(name) if isinstance(name, str) else "" for name in names]
        header = labels if any(labels) else None
        units = _unit_row(value) if header else None
        first = 0 if units is None else 1
        cells = np.column_stack([_column(value, i)[first:] for i in range(len(labels))]) if labels else np.zeros((0, 0))
    else:
        try:
            values = np.asarray(value)
            if values.dtype.kind not in "iuf":
                raise TypeError
            cells = np.asarray(values, dtype=float)
        except (TypeError, ValueError, OverflowError):
            raise InputError(field, value, "a pandas frame or an array of numbers") from None
    if cells.ndim != 2 or not len(cells):
        raise InputError(field, f"shape {cells.shape}", "rows of numbers, at least one")
    return WrenchTable(field, header, cells, np.arange(first, first + len(cells)), units=units)


def _unit_row(frame: Any) -> list[str] | None:
    """Return the first row of a pandas frame if it is one of units, as a CSV file has under its header."""
    first = frame.iloc[0].tolist() if len(frame) else []
    if any(isinstance(cell, int | float) and cell == cell for cell in first):
        return None
    cells = [cell.strip() if isinstance(cell, str) else "" for cell in first]
    return cells if any(map(_is_unit, cells)) and not any(map(is_number, cells)) else None


def _column(frame: Any, i: int) -> FloatArray:
    """Return a column of a pandas frame as numbers, NaN where a cell is not a number."""
    values = frame.iloc[:, i].to_numpy()
    if values.dtype.kind in "iuf":
        return np.asarray(values, dtype=float)
    if values.dtype.kind == "O":
        return np.array([number_or_nan(cell) if isinstance(cell, str | int | float) else np.nan for cell in values])
    return np.full(len(values), np.nan)


def _is_missing_or_number(cell: str) -> bool:
    """Return whether a cell has no letters of a unit: a number, or a text in place of one."""
    return is_number(cell) or cell.lower() in NO_VALUES or not any(sign.isalpha() for sign in cell)


def columns_of(
    header: Sequence[str] | None, columns: object, width: int, table: str, wrench_size: int = 6
) -> list[int]:
    """Return the indices of the wrench columns: f_x, f_y, f_z, m_x, m_y, m_z or, in the plane, f_x, f_y, m_z.

    Parameters
    ----------
    header : sequence of str or None
        Names to recognise without ``columns``, in any case: ``fx``, ``Tx [Nm]``, ``Fx/N``, ``force_x``,
        ``/ft/wrench.torque.z``, ``wrench[0]``, ``actual_TCP_force_0``.
    columns : sequence of str or int, or None
        Explicit column names or indices.
    width : int
        Number of columns.
    table : str
        Name of the table, for messages.
    wrench_size : int
        6, or 3 in the plane.

    Raises
    ------
    InputError
        When columns are missing or ambiguous, as with two sensors.
    """
    available = "columns " + ", ".join(header) if header else f"{width} columns without names"
    if columns is not None:
        return _column_indices(header, columns, width, available, wrench_size)
    components = SPATIAL if wrench_size == 6 else PLANAR
    recognised = {i: match for i, match in _wrench_columns(header or ()).items() if match[1:] in components}
    matches = [[i for i, match in recognised.items() if match[1:] == component] for component in components]
    sensors = {sensor for sensor, _, _ in recognised.values()}
    if any(len(indices) != 1 for indices in matches) or len(sensors) > 1:
        names = ", ".join(a + b for a, b in components)
        allowed = f"one each of {names} (or wrench.force.x ... wrench.torque.z), or columns="
        if header and (len(sensors) > 1 or any(len(indices) > 1 for indices in matches)):
            groups = [
                [header[i] for i in sorted(recognised) if recognised[i][0] == sensor] for sensor in sorted(sensors)
            ]
            available = "columns " + ", ".join(_format_columns(group, wrench_size) for group in groups)
            allowed += " with the sensor's own"
        raise InputError(f"{table}: columns", available, allowed)
    return [indices[0] for indices in matches]


def _column_indices(
    header: Sequence[str] | None, columns: object, width: int, available: str, wrench_size: int
) -> list[int]:
    """Return the indices of columns given by name or index."""
    if not isinstance(columns, Sequence) or isinstance(columns, str) or len(columns) != wrench_size:
        raise InputError("columns", columns, f"{'six' if wrench_size == 6 else 'three'} names or numbers")
    result = []
    for column in columns:
        if isinstance(column, int) and not isinstance(column, bool) and 0 <= column < width:
            result.append(column)
        elif isinstance(column, str) and header and list(header).count(column) == 1:
            result.append(list(header).index(column))
        else:
            raise InputError("columns", repr(column), available)
    return result


def _format_columns(names: Sequence[str], wrench_size: int) -> str:
    """Return a sensor's column names as text, shortened to the first and the last for a complete wrench."""
    return f"{names[0]} ... {names[-1]}" if len(names) == wrench_size else ", ".join(names)


def _wrench_columns(header: Sequence[str]) -> dict[int, tuple[str, str, str]]:
    """Return sensor, quantity (``"f"`` or ``"m"``) and axis of each wrench column, by column index.

    Numbered columns are a sensor's three forces, three torques, or whole wrench: ``force_0 ... force_5``.
    """
    result: dict[int, tuple[str, str, str]] = {}
    numbered: dict[tuple[str, str], list[tuple[int, int]]] = {}
    for i, name in enumerate(header):
        sensor, quantity, axis = _name_parts(name) or ("", "", "")
        if axis.isdigit():
            numbered.setdefault((sensor, quantity), []).append((int(axis), i))
        elif quantity in ("f", "m"):
            result[i] = sensor, quantity, axis
    for (sensor, quantity), columns in numbered.items():
        suffixes, indices = zip(*sorted(columns), strict=True)
        components = NUMBERED.get((quantity, len(columns)))
        is_of_joints = len(numbered.get((sensor, "m"), ())) > 3  # more torques than a wrench has: of joints, or fingers
        if components is None or (quantity == "f" and is_of_joints):
            continue
        if suffixes[0] in (0, 1) and suffixes == tuple(range(suffixes[0], suffixes[0] + len(suffixes))):
            result |= {i: (sensor, *component) for i, component in zip(indices, components, strict=True)}
    return result


def _name_parts(name: str) -> tuple[str, str, str] | None:
    """Parse a column's name into sensor, quantity and axis or number; return ``None`` for other columns.

    The quantity is ``"f"``, ``"m"`` or ``"w"``.
    """
    text = " ".join(WORD.findall(_split_unit(name)[0])).lower().replace("force torque", "ft")
    *tokens, axis = text.split() or [""]
    match = ONE_WORD.fullmatch(axis)
    if match:
        return ".".join(tokens), QUANTITIES[match[1]], match[2]
    if not tokens:
        return None
    *sensor, quantity = tokens
    if len(axis) > 1 and quantity in ("x", "y", "z"):  # X Force
        quantity, axis = axis, quantity
    quantity = quantity.removesuffix("s") if len(quantity) > 2 else quantity  # forces[0]
    is_number = axis.isdigit() and len(quantity) > 1  # f1, f2, ... may be load cells
    if quantity not in QUANTITIES or not (axis in ("x", "y", "z") or is_number):
        return None
    return ".".join(sensor), QUANTITIES[quantity], axis


def _split_unit(name: str) -> tuple[str, str | None]:
    """Split a column's name such as ``Fx [N]``, ``Fx/N``, ``fx_N`` or ``Fx in N`` into name and unit."""
    bracketed = list(BRACKETED_UNIT.finditer(name))
    if bracketed:
        return name[: bracketed[-1].start()], bracketed[-1][1]
    for separator in BEFORE_UNIT.finditer(name):
        if _unit_name(name[separator.end() :]) in FORCES | TORQUES:
            return name[: separator.start()], name[separator.end() :]
    return name, None


def _bare_unit(cell: str) -> str:
    """Return a unit without the brackets around it."""
    return cell.strip("[]() ")


def _unit_name(text: str) -> str:
    """Return a unit without the signs between its factors, as ``FORCES`` and ``TORQUES`` spell it: ``Nmm``."""
    name = BETWEEN_UNITS.sub("", text)
    if name in FORCES | TORQUES:
        return name
    for pattern, unit in SPELT.items():
        name = re.sub(pattern, unit, name, flags=re.IGNORECASE)
    return name


def _is_unit(text: str) -> bool:
    """Return whether a text is a unit of a force or a torque."""
    return _unit_name(_bare_unit(text)) in FORCES | TORQUES


def units_of(table: WrenchTable, columns: Sequence[int], units: object) -> tuple[str, ...]:
    """Return the unit of each column, a key of ``FORCES`` or ``TORQUES``, from ``units`` or else the table.

    Raises
    ------
    InputError
        On unknown or missing units, and on ``units`` other than those that the table states.
    """
    if units is not None and (not isinstance(units, list | tuple) or len(units) != 2):
        raise InputError("units", units, 'a pair such as ("N", "Nm")')
    forces = 3 if len(columns) == 6 else 2
    names = [table.header[c] if table.header else str(c) for c in columns]
    stated = table.stated_units(columns)
    if isinstance(units, list | tuple):
        texts = [str(units[0 if i < forces else 1]) for i in range(len(columns))]
        for name, text, other in zip(names, texts, stated, strict=True):
            if other is not None and (_is_unit(other) or table.units) and _unit_name(other) != _unit_name(text):
                raise InputError("units", repr(text), f"{other!r}, which the table states for {name}, or no units=")
        unknown = sorted({other for other in stated if other is not None and not _is_unit(other)})
        if unknown:
            named = ", ".join(map(repr, unknown))
            warn_once(f"{table.name}: columns are read in {texts[0]} and {texts[-1]}, as units= says, not in {named}")
        _check_lines_above(table, texts)
    else:
        texts = [text for text in stated if text is not None]
        if len(texts) < len(stated):
            missing = ", ".join(name for name, text in zip(names, stated, strict=True) if text is None)
            expected = 'units=("N", "Nm"), which ROS messages are in, or a header such as Fx [N]'
            raise InputError(f"{table.name}: units", f"none of {missing}" if texts else "none in the header", expected)
    for i, text in enumerate(texts):
        allowed = FORCES if i < forces else TORQUES
        if _unit_name(text) not in allowed:
            raise InputError("units", repr(text), "one of " + ", ".join(allowed))
    return tuple(_unit_name(text) for text in texts)


def _check_lines_above(table: WrenchTable, units: Sequence[str]) -> None:
    """Raise if lines above the header state other units of forces, or of torques, than ``units``."""
    words = set() if table.text is None else table.text.stated_units(_is_unit)
    for kind in (FORCES, TORQUES):
        stated = sorted(word for word in words if _unit_name(_bare_unit(word)) in kind)
        names = {_unit_name(_bare_unit(word)) for word in stated}
        for unit in units:
            if names and _unit_name(unit) in kind.keys() - names:
                cure = f"{', '.join(stated)}, which a line above the header of {table.name} states, or skip_lines="
                raise InputError("units", repr(unit), cure)


def scales_of(units: Sequence[str]) -> FloatArray:
    """Return the factors that convert values in given units to newtons or newton-metres."""
    return np.array([(FORCES | TORQUES)[unit] for unit in units])
