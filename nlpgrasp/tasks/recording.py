"""Force-torque sensor recordings from CSV files, pandas frames and arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from nlpgrasp.common.spatial import Pose, pose_matrix, wrench_transform
from nlpgrasp.common.user_warnings import warn
from nlpgrasp.common.validation import FloatArray, IntArray
from nlpgrasp.errors import InputError
from nlpgrasp.tasks.enclosing_ellipsoid import GAP, enclose, format_invalid_rows
from nlpgrasp.tasks.task_ellipsoid import EllipsoidFit
from nlpgrasp.tasks.wrench_table import WrenchTable, columns_of, csv_table, scales_of, table_of, units_of

SI = ("N", "Nm")  # units of forces and torques


@dataclass(frozen=True)
class WrenchRecording:
    """Recorded wrenches that the fingers exerted, body frame, moments about its origin.

    Parameters
    ----------
    wrenches : (m, 6) array
        Newtons and newton-metres.
    lines : (m,) array
        Line number of each in the file.
    dropped : (s,) array
        Lines left out because they contain NaN, infinity or text.
    source : str
        Of the recording, for messages and libraries; mostly the file's name.
    columns : tuple of str
        Names of the six columns, f_x to m_z; their numbers from 0 without a header.
    units : tuple of str
        Units of these columns, which were converted to newtons and newton-metres.
    """

    wrenches: FloatArray
    lines: IntArray
    dropped: IntArray
    source: str
    columns: tuple[str, ...] = ()
    units: tuple[str, ...] = ()

    def __repr__(self) -> str:
        omitted = f", {len(self.dropped)} lines left out" if len(self.dropped) else ""
        conversion = f", {self.conversion}" if self.conversion else ""
        return f"WrenchRecording({len(self.wrenches)} wrenches from {self.source}{omitted}{conversion})"

    @property
    def conversion(self) -> str:
        """Text that names the units converted to newtons and newton-metres; empty if none were."""
        converted = [unit for unit in dict.fromkeys(self.units) if unit not in SI]
        return f"{' and '.join(converted)} converted to N and Nm" if converted else ""

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
        skip_lines: int = 0,
    ) -> WrenchRecording:
        """Read a recording from a CSV file of a sensor or a ROS bag export.

        Semicolons, tabs, commas, vertical bars or spaces delimit, found from all rows; numbers may have decimal commas.
        Lines above the header, and comments (``#``, ``%``, ``//``), are left out.

        Parameters
        ----------
        path : str or Path
            A text file with a header and one wrench per row.
        columns : sequence of 6 str or int, optional
            Names or indices (from 0) of the columns f_x, f_y, f_z, m_x, m_y, m_z. By default identified by name, in any
            case: ``fx ... mz`` or ``tx ... tz``, ``F_x``, ``wrench.force.x ... wrench.torque.z``,
            ``/ft/wrench/force/x``, or by number, from 0 or 1: ``actual_TCP_force_0 ... 5``, ``wrench[0]``,
            ``force_0`` to ``torque_2``. Other columns are ignored.
        units : pair of str, optional
            Of forces (N, mN, kN, lbf, kgf) and of torques (Nm, Nmm, mNm, Ncm, kNm, lbf in, lbf ft). By default taken
            from the header: ``Fx [N]``, ``Fx/N``, ``fx_N``, ``Mx (N*mm)``, or from a row of units under it, which they
            have to agree with.
        sensor_pose : (4, 4) array or mapping, optional
            Of the sensor frame in the body frame; by default the identity. A matrix, or a mapping with ``position`` and
            ``quaternion_wxyz`` or ``quaternion_xyzw``.
        exerts : {"surroundings", "fingers"}
            Who exerts the measured wrench on the object: against that of the surroundings the fingers exert the
            opposite.
        skip_invalid : bool
            Skip rows that are not six finite numbers, with a warning, instead of raising.
        skip_lines : int
            Lines above the table that are not read, where its header is not found by itself.

        Raises
        ------
        InputError
            On files, columns or units that cannot be used or are ambiguous; rows that are not numbers are counted and
            named.
        """
        if not isinstance(path, str | Path) or "\0" in str(path):
            raise InputError("path", path, "the name of a CSV file; ng.WrenchRecording.of takes frames and arrays")
        return cls._of(csv_table(Path(path), columns, skip_lines), columns, units, sensor_pose, exerts, skip_invalid)

    @classmethod
    def of(
        cls,
        table: ArrayLike,
        *,
        columns: Sequence[str | int] | None = None,
        units: tuple[str, str] | None = None,
        sensor_pose: Pose | None = None,
        exerts: str = "surroundings",
        skip_invalid: bool = False,
    ) -> WrenchRecording:
        """Return the recording of a pandas frame or an array.

        Parameters
        ----------
        table : pandas.DataFrame or (m, n) array
            A frame's columns are identified as in ``read``. An array without ``columns`` has six, f_x to m_z, in
            newtons and newton-metres by default.
        columns, units, sensor_pose, exerts, skip_invalid
            As for ``read``.

        Raises
        ------
        InputError
            As ``read``.
        """
        wrench_table = table_of("table", table)
        if wrench_table.header is None:
            units = SI if units is None else units
            if columns is None:
                columns = range(6)
                if wrench_table.width != 6:
                    raise InputError("table", f"{wrench_table.width} columns without names", "six, or columns=")
        return cls._of(wrench_table, columns, units, sensor_pose, exerts, skip_invalid)

    @classmethod
    def _of(
        cls,
        table: WrenchTable,
        columns: object,
        units: object,
        sensor_pose: Pose | None,
        exerts: object,
        skip_invalid: object,
    ) -> WrenchRecording:
        """Return the recording of a parsed table, in newtons, newton-metres and the body frame."""
        if not isinstance(skip_invalid, bool):
            raise InputError("skip_invalid", skip_invalid, "True or False")
        indices = columns_of(table.header, columns, table.width, table.name)
        column_units = units_of(table, indices, units)
        if not isinstance(exerts, str) or exerts not in ("surroundings", "fingers"):
            raise InputError("exerts", exerts, "surroundings or fingers")
        values = table.numbers(indices) * scales_of(column_units)
        is_valid = np.all(np.isfinite(values), axis=1)
        lines, invalid = table.lines, table.lines[~is_valid]
        table.check_invalid(np.flatnonzero(~is_valid))
        if not is_valid.all():
            if not skip_invalid:
                raise InputError(table.name, format_invalid_rows(invalid), "six numbers in every line, or skip_invalid")
            warn(f"{table.name}: left out {format_invalid_rows(invalid)}")
        if not is_valid.any():
            raise InputError(table.name, "no line with six numbers", "at least one wrench")
        pose = np.eye(4) if sensor_pose is None else pose_matrix("sensor_pose", sensor_pose)
        wrenches = values[is_valid] @ wrench_transform(pose[:3, 3], pose[:3, :3]).T
        sign = -1.0 if exerts == "surroundings" else 1.0
        names = tuple(table.header[i] if table.header else str(i) for i in indices)
        return cls(sign * wrenches, lines[is_valid], invalid, table.name, names, column_units)

    def fit(
        self, *, outliers: float = 0.0, probability: float | None = None, center: ArrayLike | None = None
    ) -> EllipsoidFit:
        """Fit an ellipsoid to the recording, about the body frame's origin; see ``fit_ellipsoid``."""
        result = EllipsoidFit.of(enclose(self.wrenches, outliers, probability, center, GAP))
        return replace(result, task=result.task.given_about(np.zeros(3)))
