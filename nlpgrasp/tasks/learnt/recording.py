"""Recordings of a wrist force-torque sensor, as CSV files."""

from __future__ import annotations

import csv
import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nlpgrasp.common.given.pose import Pose, pose_matrix
from nlpgrasp.common.spatial import wrench_transform
from nlpgrasp.common.validation import LARGEST, FloatArray
from nlpgrasp.errors import InputError
from nlpgrasp.tasks.learnt.enclosing import GAP, bad_rows, enclose
from nlpgrasp.tasks.learnt.fit import EllipsoidFit

FORCES = {"N": 1.0, "mN": 1e-3, "kN": 1e3, "lbf": 4.4482216152605, "kgf": 9.80665}
TORQUES = {"Nm": 1.0, "mNm": 1e-3, "Nmm": 1e-3, "Ncm": 1e-2, "kNm": 1e3, "lbfin": 0.1129848290276167}
TORQUES |= {"lbfft": 1.3558179483314004}
COLUMNS = (("fx",), ("fy",), ("fz",), ("mx", "tx"), ("my", "ty"), ("mz", "tz"))
LARGEST_FILE = 500_000_000  # bytes


@dataclass(frozen=True)
class WrenchRecording:
    """Wrenches that the fingers had to exert, body frame, moments about its origin.

    Parameters
    ----------
    wrenches : (m, 6) array
        Newtons and newton-metres.
    lines : (m,) array
        The line of the file each is from.
    dropped : (s,) array
        Lines that were left out because they hold NaN, infinity or something else than a number.
    source : str
    """

    wrenches: FloatArray
    lines: NDArray[np.intp]
    dropped: NDArray[np.intp]
    source: str

    @classmethod
    def read(
        cls,
        path: str | Path,
        *,
        columns: Sequence[str | int] | None = None,
        units: tuple[str, str] | None = None,
        sensor_pose: Pose | None = None,
        exerts: str = "surroundings",
        skip_invalid: bool = False,
    ) -> WrenchRecording:
        """Read a CSV file.

        Parameters
        ----------
        path : str or Path
        columns : sequence of 6 str or int, optional
            Names (of the header) or numbers (from 0) of the columns of f_x, f_y, f_z, m_x, m_y, m_z. Found by
            their names (fx ... mz or tx ... tz) when left out.
        units : pair of str, optional
            Of forces (N, mN, kN, lbf, kgf) and of torques (Nm, Nmm, mNm, Ncm, kNm, lbf in, lbf ft). Taken from the
            header, ``Fx [N]``, when left out.
        sensor_pose : (4, 4) array, optional
            Of the sensor's frame in the body's; the same frame when left out.
        exerts : {"surroundings", "fingers"}
            Whose wrench on the object the sensor states: against that of the surroundings the fingers exert the
            opposite.
        skip_invalid : bool
            Leave out rows that are not six finite numbers, with a warning, instead of refusing the file.

        Raises
        ------
        InputError
            On files, columns or units that cannot be used; rows that are not numbers are counted and named.
        """
        if not isinstance(path, str | Path) or "\0" in str(path):
            raise InputError("path", path, "the name of a CSV file")
        if not isinstance(skip_invalid, bool):
            raise InputError("skip_invalid", skip_invalid, "True or False")
        table, header, numbers = _table(Path(path))
        chosen = _columns(header, columns, len(table[0]) if table else 0, str(path))
        scale = _scales(header, chosen, units, str(path))
        if not isinstance(exerts, str) or exerts not in ("surroundings", "fingers"):
            raise InputError("exerts", exerts, "surroundings or fingers")
        values = np.array([[_number(row, c) for c in chosen] for row in table]).reshape(-1, 6) * scale
        lines = np.array(numbers, dtype=np.intp)
        good = np.all(np.isfinite(values), axis=1)
        if not good.all():
            if not skip_invalid:
                raise InputError(f"{path}", f"{bad_rows(lines[~good])}", "six numbers in every line, or skip_invalid")
            warnings.warn(f"{path}: left out {bad_rows(lines[~good])}", UserWarning, stacklevel=2)
        if not good.any():
            raise InputError(f"{path}", "no line with six numbers", "at least one wrench")
        pose = np.eye(4) if sensor_pose is None else pose_matrix("sensor_pose", sensor_pose)
        wrenches = values[good] @ wrench_transform(pose[:3, 3], pose[:3, :3]).T
        sign = -1.0 if exerts == "surroundings" else 1.0
        return cls(sign * wrenches, lines[good], lines[~good], str(path))

    def fit(
        self, *, outliers: float = 0.0, probability: float | None = None, center: ArrayLike | None = None
    ) -> EllipsoidFit:
        """Return the ellipsoid fitted to the recording, about the body frame's origin; see ``fit_ellipsoid``."""
        found = EllipsoidFit.of(enclose(self.wrenches, outliers, probability, center, GAP))
        return replace(found, task=found.task.given_about(np.zeros(3)))


def _table(path: Path) -> tuple[list[list[str]], list[str] | None, list[int]]:
    """Return the rows, the header if there is one, and the rows' line numbers.

    A row with more or fewer cells than the first holds no wrench: it comes back empty.
    """
    try:
        if path.stat().st_size > LARGEST_FILE:
            raise InputError(str(path), f"{path.stat().st_size} bytes", f"at most {LARGEST_FILE}")
        with path.open(newline="", encoding="utf-8-sig") as file:
            sample = file.read(4096)
            file.seek(0)
            delimiter = max(",;\t", key=sample.count)
            reader = csv.reader(file, delimiter=delimiter if delimiter in sample else ",")
            both = [
                (row[:-1] if len(row) > 1 and not row[-1].strip() else row, reader.line_num) for row in reader if row
            ]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(str(path), type(error).__name__, "a readable CSV file") from None
    if not both:
        raise InputError(str(path), "an empty file", "a CSV file of wrenches")
    width = len(both[0][0])
    rows, lines = [row if len(row) == width else [] for row, _ in both], [line for _, line in both]
    named = any(rows[0]) and not any(_is_number(cell) for cell in rows[0])
    return (rows[1:], rows[0], lines[1:]) if named else (rows, None, lines)


def _columns(header: list[str] | None, given: Sequence[str | int] | None, width: int, path: str) -> list[int]:
    """Return the numbers of the six columns."""
    plain = [re.sub(r"[\s_.-]", "", re.split(r"[\[(]", name)[0].lower()) for name in header or ()]
    have = "columns " + ", ".join(header) if header else f"{width} columns without names"
    if given is None:
        places = [[i for i, name in enumerate(plain) if name in names] for names in COLUMNS]
        if any(len(found) != 1 for found in places):
            raise InputError(f"{path}: columns", have, "one each of fx, fy, fz, mx, my, mz, or columns=")
        return [found[0] for found in places]
    if not isinstance(given, Sequence) or isinstance(given, str) or len(given) != 6:
        raise InputError("columns", given, "six names or numbers")
    result = []
    for one in given:
        if isinstance(one, int) and not isinstance(one, bool) and 0 <= one < width:
            result.append(one)
        elif isinstance(one, str) and header and header.count(one) == 1:
            result.append(header.index(one))
        else:
            raise InputError("columns", repr(one), have)
    return result


def _scales(header: list[str] | None, chosen: list[int], units: tuple[str, str] | None, path: str) -> FloatArray:
    """Return the factors to newtons and newton-metres, one a column."""
    if units is not None and (not isinstance(units, list | tuple) or len(units) != 2):
        raise InputError("units", units, 'a pair such as ("N", "Nm")')
    factors = []
    for i, column in enumerate(chosen):
        known = FORCES if i < 3 else TORQUES
        if units is not None:
            text = str(units[i // 3])
        else:
            found = re.search(r"[\[(]([^\])]*)[\])]", header[column]) if header else None
            if found is None:
                raise InputError(f"{path}: units", "none in the header", 'units=("N", "Nm") or a header such as Fx [N]')
            text = found.group(1)
        key = re.sub(r"[\s*\u00b7.-]", "", text)
        if key not in known:
            raise InputError("units", repr(text), "one of " + ", ".join(known))
        factors.append(known[key])
    return np.array(factors)


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _number(row: list[str], column: int) -> float:
    """Return a cell as a number, NaN where it is not a number."""
    try:
        value = float(row[column])
    except (ValueError, IndexError):
        return float("nan")
    return value if abs(value) <= LARGEST else float("nan")
