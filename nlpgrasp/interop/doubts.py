"""Checks of imported contacts: missing friction and outward normals."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nlpgrasp.bodies import Body, body_from_dict
from nlpgrasp.common.shown.said import warn
from nlpgrasp.errors import InputError
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.grasp.places import all_point_away
from nlpgrasp.interop.contacts_csv import FRICTION
from nlpgrasp.solution.solution import GraspSolution

STEP = 1e-3  # share of the body's size: probing step along a normal


def warn_frictionless(name: str, unsaid: Sequence[bool]) -> None:
    """Warn of rows without friction and model, which are assumed frictionless."""
    rows = [str(i + 2) for i, open_ in enumerate(unsaid) if open_]
    if not rows:
        return
    which = f"no {FRICTION} stated" if len(rows) == len(unsaid) else f"no {FRICTION} stated in rows {', '.join(rows)}"
    text = f"{name}: {which}: taken to be frictionless; friction=0.5 (--friction 0.5) states another"
    warn(text)


def check_inward(name: str, grasp: Grasp, body: Body | None) -> None:
    """Refuse normals that point out of the body; without a body, warn of those that all seem to.

    Parameters
    ----------
    name : str
        Of the table, for messages.
    grasp : Grasp
    body : Body or None

    Raises
    ------
    InputError
        Naming the row.
    """
    points, normals = grasp.points, grasp.normals
    if body is None or body.space != grasp.space:
        if all_point_away(points, normals):
            text = f"{name}: all normals point away from the middle of the contacts; they have to point into the body"
            warn(text)
        return
    step = STEP * body.size
    along, behind = (body.signed_distance(points + s * normals) for s in (step, -step))
    outward = np.flatnonzero(along - behind > step)
    if outward.size:
        raise InputError(
            f"{name}: row {outward[0] + 2}", "a normal that points out of the body", "normals into the body"
        )


def body_of(solution: GraspSolution) -> Body | None:
    """Return the body of a solution; None if its file does not contain it (a mesh, a function)."""
    try:
        return body_from_dict(solution.body)
    except InputError:
        return None
