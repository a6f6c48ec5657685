"""Export and checked import of contacts as CSV tables."""

from __future__ import annotations

import csv
import io
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from nlpgrasp.bodies import Body, body_from_dict
from nlpgrasp.budgets import force_budget
from nlpgrasp.common.delimited_text import LARGEST_FILE, DelimitedTable, number_or_nan, read_delimited
from nlpgrasp.common.files import check_regular_file
from nlpgrasp.common.user_warnings import warn
from nlpgrasp.common.validation import LENGTHS, UNITS, FloatArray, in_metres
from nlpgrasp.contacts import ContactModel, FrictionContact, PointContact, SoftContact
from nlpgrasp.errors import InputError, MissingExtraError
from nlpgrasp.interop.base import ExportFormat, ReadFormat, ReadGrasp, ReadOptions
from nlpgrasp.interop.contact_columns import (
    COEFFICIENTS,
    NORMAL,
    POSITION,
    ContactColumns,
    contact_columns,
    has_contacts,
)
from nlpgrasp.interop.hand_states import FORCE_WARNING, GRIP, LIMIT, SAFE_GRIP, grip_fields
from nlpgrasp.problem.checks import warn_of_friction
from nlpgrasp.quality.grasp import Grasp, do_all_point_away
from nlpgrasp.solution.solution import GraspSolution

# names of columns
(FRICTION, TORSION), MODEL, GRASP = COEFFICIENTS, "model", "grasp"
NAMES = (GRASP, "grasp_id", "id")  # columns that name the grasp of a row: the first that a table has
NUMBERS = ("contact", "finger")  # columns that number the contacts of a grasp
PROBE_STEP = 1e-3  # share of the body's size: probing step along a normal
MOST_ROWS = 1_000_000  # contacts in a table
BATCH = 64  # rows of a Parquet table that are unpacked at once
UNIT_TOLERANCE = 1e-2  # tolerance of unit normals: other tools write few digits


KIND = "a CSV table of contacts: a header, then rows"


class Row(dict[str, str]):
    """Contact of a table: the text of each column, by its name.

    Parameters
    ----------
    cells : dict of str to str
    line : int
        In the file.
    """

    def __init__(self, cells: dict[str, str], line: int) -> None:
        super().__init__(cells)
        self.line = line


def contacts_csv(solution: GraspSolution) -> str:
    """Return the contacts of a solution as CSV text, in the body frame and SI units.

    Columns are positions, inward normals and contact models.

    Of several kept grasps all are written: the column ``grasp`` numbers them, best first, and ``mu`` is the certified
    lower bound of each. Of parallel jaws, ``grip_force`` and ``grip_force_with_margin`` are normal forces of each jaw,
    newtons, ``max_force`` is their limit, and ``force_warning`` says where it is exceeded. Line, plane, elliptic and
    bilateral contacts are named in the column ``model``, and refused on import, as the columns do not describe them
    completely.

    Raises
    ------
    InputError
        Without a grasp.
    """
    answer = solution.require_grasp()
    space, has_several = answer.space, bool(solution.others)
    grasps = [(answer, solution.faces, solution.mu, grip_fields(solution))]
    if has_several:
        grips = [grip_fields(solution.with_answer(grasp)) for grasp in solution.grasps]
        pairs = zip(solution.grasps, grips, strict=True)
        grasps = [(kept.grasp, kept.faces, kept.mu, grip) for kept, grip in pairs]
    forces = (GRIP, SAFE_GRIP, LIMIT, FORCE_WARNING) if any(grip for *_, grip in grasps) else ()
    text = io.StringIO(newline="")
    writer = csv.writer(text)
    first_heads = [GRASP, "mu"] if has_several else []
    writer.writerow(
        [*first_heads, "finger", *POSITION[:space], *NORMAL[:space], "face", MODEL, FRICTION, TORSION, *forces]
    )
    for index, (grasp, faces, mu, grip) in enumerate(grasps):
        first_cells = [index, mu.lower] if has_several else []
        entries = zip(grasp.points, grasp.normals, faces, grasp.contacts, strict=True)
        for i, (point, normal, face, model) in enumerate(entries):
            coefficients = [model.coefficients.get(name, "") for name in (FRICTION, TORSION)]
            cells = [*point.tolist(), *normal.tolist(), face, model.label, *coefficients]
            writer.writerow([*first_cells, i, *cells, *(grip.get(name, "") for name in forces)])
    return text.getvalue()


def read_contacts_csv(path: str | Path, friction: float | None = None, body: Body | None = None) -> Grasp:
    """Read the grasp of a table of contacts, with the mean contact position as torque origin.

    Parameters
    ----------
    path : str or Path
        With a header that names the columns ``p_x, p_y[, p_z], n_x, n_y[, n_z]`` (inward normals) or the like: ``x ...
        nz``, ``pos_x ... normal_z``, and numbered, such as ``c0_x ... c1_nz``, all contacts of a grasp in one row.
        Positions are in metres unless the header, or a row of units under it, states another unit. Optional are
        ``friction``, ``torsional_friction`` and ``model`` (``point``, ``friction`` or ``soft``, which the coefficients
        have to agree with). ``grasp`` (or ``grasp_id``, ``id``) names the grasp, ``contact`` or ``finger`` may number
        its contacts; other columns are ignored.
    friction : float, optional
        Friction of contacts whose row has none: frictionless by default, with a warning unless the row's model says so.
    body : Body, optional
        Body of the contacts: normals that point out of it are refused.

    Raises
    ------
    InputError
        On a file that is not such a table, naming row and column, and on one of several grasps.

    Warns
    -----
    UserWarning
        On contacts assumed frictionless, on friction above 2, and, without a body, on normals that all point away from
        the centroid of the contacts.
    """
    grasps = _read_grasps(path, friction, body)
    if len(grasps) > 1:
        raise InputError(
            str(path),
            f"{len(grasps)} grasps",
            "one: nlpgrasp quality reads tables of several",
        )
    return next(iter(grasps.values()))


def _read_grasps(path: str | Path, friction: float | None, body: Body | None, unit: str = "m") -> dict[str, Grasp]:
    """Read the grasps of a table of contacts, by the value of the column that names them.

    A table without such a column has one grasp.

    Their order is that of their first rows.
    """
    name, (rows, unit) = str(path), _contact_rows(path, unit)
    rows_of = _rows_of_grasps(name, rows)
    space = 3 if "p_z" in rows[0] else 2
    points = np.array([[_read_number(name, row, c) for c in POSITION[:space]] for row in rows])
    points = in_metres("unit", points, unit)
    normals = _unit_normals(name, rows, NORMAL[:space])
    models = [_contact_model(name, row, friction) for row in rows]
    if friction is None:
        is_unstated = [not (row.get(FRICTION) or row.get(MODEL) or "").strip() for row in rows]
        warn_frictionless(name, is_unstated, numbers=[row.line for row in rows])
    warn_of_friction(models, f"{name}: contact {{}}, {FRICTION}")
    grasps = {
        key: Grasp(points[indices], normals[indices], [models[i] for i in indices], points[indices].mean(axis=0))
        for key, indices in rows_of.items()
    }
    for key, grasp in grasps.items():
        if body is not None or len(grasps) == 1:  # without a body, stacks check many grasps together
            check_inward(name, grasp, body, [rows[i].line for i in rows_of[key]])
    return grasps


def _rows_of_grasps(name: str, rows: Sequence[Row]) -> dict[str, list[int]]:
    """Return the indices of each grasp's rows; raise if they are not one after another, or have a number twice."""
    column = _name_column(rows)
    keys = ["" if column is None else (row.get(column) or "").strip() for row in rows]
    if column == NAMES[-1] and 1 < len(rows) == len(set(keys)):
        raise InputError(f"{name}: {column}", "another value in each row", f"a column {GRASP} that names the grasps")
    rows_of: dict[str, list[int]] = {}
    for i, key in enumerate(keys):
        field = f"{name}: row {rows[i].line}, {column}"
        if not key and any(keys):
            raise InputError(field, "nothing", "the name of the grasp in each row")
        if key in rows_of and keys[i - 1] != key:
            raise InputError(
                field,
                f"grasp {key} again, after others",
                "the rows of a grasp together, and another name for each grasp",
            )
        rows_of.setdefault(key, []).append(i)
    for key, indices in rows_of.items():
        _check_numbers(name, key, rows, indices)
    return rows_of


def _name_column(rows: Sequence[Row]) -> str | None:
    """Return the column of a table that names the grasp of each row, or ``None`` for a table of one grasp."""
    return next((column for column in NAMES if column in rows[0]), None)


def _check_numbers(name: str, key: str, rows: Sequence[Row], indices: Sequence[int]) -> None:
    """Raise if a contact number is repeated in a grasp.

    A finger may have several contacts, in rows one after another.
    """
    for column in NUMBERS:
        numbers = [(rows[i].get(column) or "").strip() for i in indices]
        seen: set[str] = set()
        previous = ""
        for i, number in zip(indices, numbers, strict=True):
            if number.isdecimal() and number in seen and not (column == "finger" and number == previous):
                given = f"{column} {number} again" + (f" in grasp {key}" if key else "")
                allowed = f"each {column} once in a grasp, and a column {GRASP} with another name for each grasp"
                raise InputError(f"{name}: row {rows[i].line}, {column}", given, allowed)
            seen.add(number)
            previous = number


def _parquet_table(path: Path) -> DelimitedTable:
    """Read a Parquet table, with numbers as text of full precision."""
    try:
        import pyarrow as pa
        from pyarrow import parquet
    except ImportError:
        raise MissingExtraError("a Parquet table", "tables") from None
    try:
        check_regular_file(path, "a Parquet table of contacts")
        with parquet.ParquetFile(path) as file:
            if file.metadata.num_rows > MOST_ROWS:  # before they are unpacked
                raise InputError(str(path), f"{file.metadata.num_rows} contacts", f"at most {MOST_ROWS}")
            header = list(file.schema_arrow.names)
            rows = _cells_of_batches(str(path), file.iter_batches(batch_size=BATCH))
    except InputError:
        raise
    except OSError as error:
        raise InputError(str(path), error.strerror or "no table", "a Parquet table that exists") from None
    except (pa.ArrowException, ValueError) as error:
        raise InputError(str(path), f"no table ({error})", "a Parquet table of contacts") from None
    lines = list(range(2, len(rows) + 2))
    return DelimitedTable(str(path), header, None, rows, lines, [len(header)] * len(rows), ",")


def _cells_of_batches(name: str, batches: Iterator[Any]) -> list[list[str]]:
    """Return the cells of Arrow record batches by row; raise if their text is longer than that of the largest file.

    A few bytes of a dictionary or a compressed page can stand for any length of text.
    """
    rows, size = list[list[str]](), 0
    for batch in batches:
        columns = [["" if cell is None else str(cell) for cell in column.to_pylist()] for column in batch.columns]
        size += sum(len(cell) for column in columns for cell in column)
        if size > LARGEST_FILE:
            raise InputError(name, f"more than {LARGEST_FILE} characters", "a smaller table")
        rows.extend(map(list, zip(*columns, strict=True)))
    return rows


def _contact_rows(path: str | Path, unit: str) -> tuple[list[Row], str]:
    """Read the contacts of a table, and return them with the unit of their positions."""
    name, is_parquet = str(path), Path(path).suffix.lower() == ".parquet"
    table = _parquet_table(Path(path)) if is_parquet else read_delimited(Path(path), KIND, has_contacts, _is_length)
    header = [column.strip() for column in table.header or []]
    repeated = [column for column, count in Counter(header).items() if column and count > 1]
    if repeated:
        raise InputError(f"{name}: header", f"two columns {repeated[0]}", "each column once")
    contacts = contact_columns(name, header)
    if not table.rows:
        raise InputError(name, "a header without rows", "a row for each contact")
    if len(table.rows) * len(contacts) > MOST_ROWS:
        raise InputError(name, f"{len(table.rows) * len(contacts)} contacts", f"at most {MOST_ROWS}")
    _check_widths(table, header, contacts)
    return _rows_of_contacts(table, header, contacts), _stated_unit(table, contacts, unit)


def _is_length(cell: str) -> bool:
    """Return whether a cell is a unit of length."""
    return _length_name(cell) in UNITS


def _length_name(cell: str) -> str:
    """Return the name of a unit of length in a cell as ``UNITS`` has it, or the cell itself."""
    text = cell.strip("[]() ")
    return LENGTHS.get(text.lower(), text)


def _check_widths(table: DelimitedTable, header: Sequence[str], contacts: Sequence[ContactColumns]) -> None:
    """Raise if a row has more or fewer cells than the header."""
    for row, line, width in zip(table.rows, table.lines, table.widths, strict=True):
        if row:
            continue
        missing = [name for columns in contacts for name, i in columns.indices.items() if i >= width]
        if missing:
            raise InputError(f"{table.name}: row {line}, {missing[0]}", "nothing", "a finite number")
        raise InputError(f"{table.name}: row {line}", f"{width} cells", f"{len(header)}, as in the header")


def _rows_of_contacts(table: DelimitedTable, header: Sequence[str], contacts: Sequence[ContactColumns]) -> list[Row]:
    """Return a row for each contact, with the columns' standard names.

    Several contacts in a row are a grasp, which has the row's number if no column names it; contacts without any
    position and normal are left out.
    """
    used = sorted({i for columns in contacts for i in columns.indices.values()})
    numbers = table.with_decimal_points([[row[i] for i in used] for row in table.rows])
    others = {_standard_name(column, header): i for i, column in enumerate(header) if column and i not in used}
    rows = []
    for k, (row, line) in enumerate(zip(table.rows, table.lines, strict=True)):
        text = dict(zip(used, numbers[k], strict=True))
        shared = {name: row[i] for name, i in others.items()}
        if len(contacts) > 1:
            shared = {name: cell for name, cell in shared.items() if name not in NUMBERS}
            shared |= {} if any(name in shared for name in NAMES) else {GRASP: str(k)}
        cells = [{name: text[i] for name, i in columns.indices.items()} for columns in contacts]
        stated = [contact for contact in cells if any(contact[name] for name in contact if name not in COEFFICIENTS)]
        rows += [Row(shared | contact, line) for contact in (stated or cells[:1])]
    return rows


def _standard_name(column: str, header: Sequence[str]) -> str:
    """Return the name of a column that is recognised in any case, or the column itself."""
    name = column.lower()
    return name if name in (*NAMES, *NUMBERS, MODEL, *COEFFICIENTS) and name not in header else column


def _stated_unit(table: DelimitedTable, contacts: Sequence[ContactColumns], unit: str) -> str:
    """Return the unit that the header or a row of units states for the positions, or else the given one."""
    stated = {columns.unit for columns in contacts} - {None}
    if table.units is not None:
        positions = [i for columns in contacts for name, i in columns.indices.items() if name in POSITION]
        stated |= {_length_name(table.units[i]) for i in positions}
    stated = stated or {_length_name(word) for word in table.stated_units(_is_length) if word.lower() != "in"}
    if not stated:
        return unit
    texts = sorted(map(str, stated))
    if len(texts) > 1 or texts[0] not in UNITS:
        raise InputError(f"{table.name}: units", " and ".join(map(repr, texts)), f"one of {', '.join(UNITS)}")
    if unit not in (texts[0], "m"):
        raise InputError("unit", unit, f"{texts[0]}, which {table.name} states, or none")
    return texts[0]


def _unit_normals(name: str, rows: Sequence[Row], columns: Sequence[str]) -> FloatArray:
    """Return the normals of a table, (m, space), scaled to unit length; raise if lengths are far from 1."""
    normals = np.array([[_read_number(name, row, c) for c in columns] for row in rows])
    lengths = np.linalg.norm(normals, axis=1)
    worst = int(np.argmax(np.abs(lengths - 1.0)))
    if abs(lengths[worst] - 1.0) > UNIT_TOLERANCE:
        raise InputError(
            f"{name}: row {rows[worst].line}", f"a normal of length {lengths[worst]:.4g}", "unit normals, inward"
        )
    return np.asarray(normals / lengths[:, None])


def _read_number(name: str, row: Row, column: str) -> float:
    """Return the number in a cell of a row; raise if it is not finite."""
    text = (row.get(column) or "").strip()
    value = number_or_nan(text)
    if not np.isfinite(value):
        raise InputError(f"{name}: row {row.line}, {column}", text or "nothing", "a finite number")
    return value


def point_contact(field: str, friction: float | None, torsion: float | None) -> ContactModel:
    """Return the contact model for a friction and a torsion coefficient: soft, frictional or frictionless.

    Raises
    ------
    InputError
        On negative coefficients, and torsion without friction; ``field`` is the place.
    """
    if torsion and not friction:
        raise InputError(f"{field}, {TORSION}", torsion, "torsion of a contact with friction")
    try:
        if not friction:
            return PointContact()
        return SoftContact(friction, torsion) if torsion else FrictionContact(friction)
    except InputError as error:
        raise InputError(f"{field}, {error.field}", error.given, error.allowed) from None


def _contact_model(name: str, row: Row, friction: float | None) -> ContactModel:
    """Return the contact model of a table row: soft, frictional or frictionless."""
    coefficients = {c: _read_number(name, row, c) for c in (FRICTION, TORSION) if (row.get(c) or "").strip()}
    row_name = f"{name}: row {row.line}"
    model = point_contact(row_name, coefficients.get(FRICTION, friction), coefficients.get(TORSION))
    stated_model = (row.get(MODEL) or "").strip()
    if stated_model and stated_model != model.kind:
        raise InputError(
            f"{row_name}, {MODEL}", stated_model, f"{model.kind!r}, which its columns say; others need a solution file"
        )
    return model


def check_inward(name: str, grasp: Grasp, body: Body | None, rows: Sequence[int]) -> None:
    """Raise if a normal points out of the body.

    Without a body, warn if all normals seem to point outwards.

    Parameters
    ----------
    name : str
        Of the table, for messages.
    grasp : Grasp
    body : Body or None
    rows : sequence of int
        Of its contacts, lines of the file.

    Raises
    ------
    InputError
        Naming the row.
    """
    points, normals = grasp.points, grasp.normals
    if body is None or body.space != grasp.space:
        if do_all_point_away(points, normals):
            text = f"{name}: all normals point away from the middle of the contacts; they have to point into the body"
            warn(text)
        return
    step = PROBE_STEP * body.size
    inside_distance, outside_distance = (body.signed_distance(points + s * normals) for s in (step, -step))
    outward = np.flatnonzero(inside_distance - outside_distance > step)
    if outward.size:
        raise InputError(
            f"{name}: row {rows[outward[0]]}", "a normal that points out of the body", "normals into the body"
        )


def warn_frictionless(
    name: str, is_unstated: Sequence[bool], items: str = "rows", numbers: Sequence[int] | None = None
) -> None:
    """Warn of rows or grasps without a friction coefficient, which are taken to be frictionless."""
    lines = range(2, len(is_unstated) + 2) if numbers is None else numbers
    rows = [str(line) for line, is_missing in zip(lines, is_unstated, strict=True) if is_missing]
    if not rows:
        return
    location = "" if len(rows) == len(is_unstated) else f" in {items} {', '.join(rows)}"
    defect = f"no {FRICTION} stated{location}"
    text = f"{name}: {defect}: taken to be frictionless; friction=0.5 (--friction 0.5) states another"
    warn(text)


def stated_body(solution: GraspSolution) -> Body | None:
    """Return the body of a solution, or ``None`` if the file does not contain it, as for a mesh or a function."""
    try:
        return body_from_dict(solution.body)
    except InputError:
        return None


def _read_contacts_table(path: Path, options: ReadOptions) -> Iterator[ReadGrasp]:
    """Yield the grasps of a table of contacts, with the task of a solution file if one is given."""
    task_solution = None if options.task is None else GraspSolution.load(options.task)
    grasps = _read_grasps(
        path, options.friction, None if task_solution is None else stated_body(task_solution), options.unit
    )
    for key, grasp in grasps.items():
        yield _with_task(options.task, task_solution, path.name if len(grasps) == 1 else key, grasp)


def _with_task(task: Path | None, task_solution: GraspSolution | None, name: str, grasp: Grasp) -> ReadGrasp:
    """Return an imported grasp with task, budget and torque origin of a solution file, if one is given."""
    if task_solution is None:
        return ReadGrasp(name, grasp, None, force_budget("l2"))
    origin = task_solution.task.torque_origin
    if origin is None:
        raise InputError(f"{task}: problem.task.torque_origin", "none", "the point that the task's moments are about")
    if task_solution.task.dimension != grasp.dimension:
        dimension = f"dimension {task_solution.task.dimension}"
        raise InputError("--task", dimension, f"dimension {grasp.dimension}, as the contacts")
    grasp_about_origin = Grasp(grasp.points, grasp.normals, grasp.contacts, origin, grasp.tangents)
    if task_solution.budget.depends_on_frames:
        raise InputError(
            "--task", "a file whose force budget is that of its own contacts", "one with another force budget"
        )
    return ReadGrasp(name, grasp_about_origin, task_solution.task, task_solution.budget)


CSV = ExportFormat(
    "csv", ".csv", "contacts as a table", lambda solution, _: contacts_csv(solution), has_all_grasps=True
)


CONTACTS_TABLE = ReadFormat((".csv", ".parquet"), ("friction", "task", "unit"), _read_contacts_table)
