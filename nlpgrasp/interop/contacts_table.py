"""Import of grasps from CSV tables of contacts."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from nlpgrasp.bodies import Body
from nlpgrasp.budgets import force_budget
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts import ContactModel, FrictionContact, PointContact, SoftContact
from nlpgrasp.errors import InputError
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.interop.base import ReadFormat, ReadGrasp, ReadOptions
from nlpgrasp.interop.contacts_csv import FRICTION, GRASP, MODEL, NORMAL, POSITION, TORSION
from nlpgrasp.interop.doubts import body_of, check_inward, warn_frictionless
from nlpgrasp.problem.check import warn_of_friction
from nlpgrasp.solution.solution import GraspSolution

MOST_ROWS = 1000
UNIT = 1e-2  # tolerance of unit normals: other tools write few digits
Row = dict[str, str | None]  # the text of each column


def read_contacts_csv(path: str | Path, friction: float | None = None, body: Body | None = None) -> Grasp:
    """Return the grasp of a table of contacts, with the mean position as torque origin.

    Parameters
    ----------
    path : str or Path
        With a header that names the columns ``p_x, p_y[, p_z], n_x, n_y[, n_z]`` (metres, inward normals), and
        optionally ``friction``, ``torsional_friction`` and ``model`` (``point``, ``friction`` or ``soft``, which the
        coefficients have to agree with); other columns are ignored.
    friction : float, optional
        Friction of contacts whose row has none: frictionless by default, with a warning unless the row's model says so.
    body : Body, optional
        Body of the contacts: normals that point out of it are refused.

    Raises
    ------
    InputError
        On a file that is not such a table, naming row and column, and on one whose column ``grasp`` names several.

    Warns
    -----
    UserWarning
        On contacts assumed frictionless, on friction above 2, and, without a body, on normals that all point away from
        the centroid of the contacts.
    """
    grasps = _grasps(path, friction, body)
    if len(grasps) > 1:
        raise InputError(f"{path}: {GRASP}", f"{len(grasps)} grasps", "one: nlpgrasp quality reads tables of several")
    return next(iter(grasps.values()))


def _grasps(path: str | Path, friction: float | None, body: Body | None) -> dict[str, Grasp]:
    """Return the grasps of a table by the value of its column ``grasp``; a table without it has one."""
    name, rows = str(path), _rows(path)
    space = 3 if "p_z" in rows[0] else 2
    points = np.array([[_number(name, i, row, c) for c in POSITION[:space]] for i, row in enumerate(rows)])
    normals = _unit_normals(name, rows, NORMAL[:space])
    models = [_model(name, i, row, friction) for i, row in enumerate(rows)]
    if friction is None:
        warn_frictionless(name, [not (row.get(FRICTION) or row.get(MODEL) or "").strip() for row in rows])
    warn_of_friction(models, f"{name}: contact {{}}, {FRICTION}")
    rows_of: dict[str, list[int]] = {}
    for i, row in enumerate(rows):
        rows_of.setdefault((row.get(GRASP) or "").strip(), []).append(i)
    grasps = {
        key: Grasp(points[own], normals[own], [models[i] for i in own], points[own].mean(axis=0))
        for key, own in rows_of.items()
    }
    for grasp in grasps.values():
        check_inward(name, grasp, body)
    return grasps


def _rows(path: str | Path) -> list[Row]:
    """Return the nonempty rows of a table with the columns of contacts."""
    name = str(path)
    try:
        reader = csv.DictReader(io.StringIO(Path(path).read_text(encoding="utf-8-sig")))
        rows, header = list(reader), reader.fieldnames or []
    except OSError as error:
        raise InputError(name, error.strerror, "a CSV table of contacts that exists") from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(name, f"no table ({error})", "a CSV table of contacts") from None
    columns = [c.strip() for c in header if c]
    twice = [c for c in columns if columns.count(c) > 1]
    if twice:
        raise InputError(f"{name}: header", f"two columns {twice[0]}", "each column once")
    space = 3 if "p_z" in columns else 2
    missing = [c for c in (*POSITION[:space], *NORMAL[:space]) if c not in columns]
    if missing:
        raise InputError(f"{name}: header", f"no column {missing[0]}", ", ".join((*POSITION, *NORMAL)) + ", then rows")
    if not rows:
        raise InputError(name, "a header without rows", "a row for each contact")
    if len(rows) > MOST_ROWS:
        raise InputError(name, f"{len(rows)} contacts", f"at most {MOST_ROWS}")
    return [{(k or "").strip(): v for k, v in row.items()} for row in rows]


def _unit_normals(name: str, rows: Sequence[Row], columns: Sequence[str]) -> FloatArray:
    """Return the normals of a table, (m, space), scaled to unit length; refuse those that are far from it."""
    normals = np.array([[_number(name, i, row, c) for c in columns] for i, row in enumerate(rows)])
    lengths = np.linalg.norm(normals, axis=1)
    far = int(np.argmax(np.abs(lengths - 1.0)))
    if abs(lengths[far] - 1.0) > UNIT:
        raise InputError(f"{name}: row {far + 2}", f"a normal of length {lengths[far]:.4g}", "unit normals, inward")
    return np.asarray(normals / lengths[:, None])


def _number(name: str, index: int, row: Row, column: str) -> float:
    text = (row.get(column) or "").strip()
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise InputError(f"{name}: row {index + 2}, {column}", text or "nothing", "a finite number")
    return value


def _model(name: str, index: int, row: Row, friction: float | None) -> ContactModel:
    """Return the contact model of a row: soft with torsion, with friction, or frictionless."""
    given = {c: _number(name, index, row, c) for c in (FRICTION, TORSION) if (row.get(c) or "").strip()}
    slide = given.get(FRICTION, friction)
    where = f"{name}: row {index + 2}"
    if given.get(TORSION) and not slide:
        raise InputError(f"{where}, {TORSION}", given[TORSION], "torsion of a contact with friction")
    try:
        model: ContactModel = PointContact() if not slide else FrictionContact(slide)
        if slide and given.get(TORSION):
            model = SoftContact(slide, given[TORSION])
    except InputError as error:
        raise InputError(f"{where}, {error.field}", error.given, error.allowed) from None
    stated = (row.get(MODEL) or "").strip()
    if stated and stated != model.kind:
        raise InputError(
            f"{where}, {MODEL}", stated, f"{model.kind!r}, which its columns say; others need a solution file"
        )
    return model


def _read(path: Path, options: ReadOptions) -> Iterator[ReadGrasp]:
    """Yield the grasps of a table, with task and body of a solution file if given."""
    other = None if options.task is None else GraspSolution.load(options.task)
    grasps = _grasps(path, options.friction, None if other is None else body_of(other))
    for key, grasp in grasps.items():
        name = path.name if len(grasps) == 1 else f"{path.name}, grasp {key}"
        yield _about(options.task, other, name, grasp)


def _about(task: Path | None, other: GraspSolution | None, name: str, grasp: Grasp) -> ReadGrasp:
    """Return a grasp with task and torque origin of a solution file, if any."""
    if other is None:
        return ReadGrasp(name, grasp, None, force_budget("l2"))
    if other.grasp is None:
        raise InputError(f"{task}: grasp", "none", "a file that says what point its moments are about")
    if other.task.dimension != grasp.dimension:
        raise InputError("--task", f"dimension {other.task.dimension}", f"dimension {grasp.dimension}, as the contacts")
    about = Grasp(grasp.points, grasp.normals, grasp.contacts, other.grasp.torque_origin, grasp.tangents)
    if other.budget.depends_on_frames:
        raise InputError(
            "--task", "a file whose force budget is that of its own contacts", "one with another force budget"
        )
    return ReadGrasp(name, about, other.task, other.budget)


CONTACTS_TABLE = ReadFormat((".csv",), ("friction", "task"), _read)
