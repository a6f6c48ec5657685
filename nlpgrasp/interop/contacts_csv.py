"""Contacts as a table: one row a contact, for spreadsheets and for grasps made by other tools."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np

from nlpgrasp.contacts import ContactModel, FrictionContact, PointContact, SoftContact
from nlpgrasp.errors import InputError
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.solution.solution import GraspSolution

POSITION, NORMAL = ("p_x", "p_y", "p_z"), ("n_x", "n_y", "n_z")
FRICTION, TORSION, MODEL = "friction", "torsional_friction", "model"
MOST_ROWS = 1000
UNIT = 1e-2  # how far a normal may be from unit length: other tools write few digits


def contacts_csv(solution: GraspSolution) -> str:
    """Return the contacts of a solution as CSV text: positions, inward normals, contact models, body frame, SI units.

    Line, plane, elliptic and bilateral contacts are named in the column ``model``, and refused where a table is read:
    its columns do not say all of them.

    Raises
    ------
    InputError
        Without a grasp.
    """
    grasp = solution.grasp
    if grasp is None:
        raise InputError("solution", "no grasp", "a solution with a grasp")
    space = grasp.space
    text = io.StringIO(newline="")
    writer = csv.writer(text)
    writer.writerow(["finger", *POSITION[:space], *NORMAL[:space], "face", "model", FRICTION, TORSION])
    for i, (p, n, face, model) in enumerate(
        zip(grasp.points, grasp.normals, solution.faces, grasp.contacts, strict=True)
    ):
        rough = [model.coefficients.get(name, "") for name in (FRICTION, TORSION)]
        writer.writerow([i, *p.tolist(), *n.tolist(), face, model.label, *rough])
    return text.getvalue()


def read_contacts_csv(path: str | Path, friction: float | None = None) -> Grasp:
    """Return the grasp of a table of contacts, moments about their mean position.

    Parameters
    ----------
    path : str or Path
        With a header that names the columns ``p_x, p_y[, p_z], n_x, n_y[, n_z]`` (metres, inward normals), and
        optionally ``friction``, ``torsional_friction`` and ``model`` (``point``, ``friction`` or ``soft``, which the
        coefficients have to agree with); other columns play no part.
    friction : float, optional
        Of contacts whose row has none: frictionless when left out.

    Raises
    ------
    InputError
        On a file that is no such table, naming row and column.
    """
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
    table = [{(k or "").strip(): v for k, v in row.items()} for row in rows]
    points = np.array([[_number(name, i, row, c) for c in POSITION[:space]] for i, row in enumerate(table)])
    normals = np.array([[_number(name, i, row, c) for c in NORMAL[:space]] for i, row in enumerate(table)])
    lengths = np.linalg.norm(normals, axis=1)
    far = int(np.argmax(np.abs(lengths - 1.0)))
    if abs(lengths[far] - 1.0) > UNIT:
        raise InputError(f"{name}: row {far + 2}", f"a normal of length {lengths[far]:.4g}", "unit normals, inward")
    models = [_model(name, i, row, friction) for i, row in enumerate(table)]
    return Grasp(points, normals / lengths[:, None], models, points.mean(axis=0))


def _number(name: str, index: int, row: dict[str, str | None], column: str) -> float:
    text = (row.get(column) or "").strip()
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise InputError(f"{name}: row {index + 2}, {column}", text or "nothing", "a finite number")
    return value


def _model(name: str, index: int, row: dict[str, str | None], friction: float | None) -> ContactModel:
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
