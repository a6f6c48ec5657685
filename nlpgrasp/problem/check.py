"""What can be seen to be impossible before anything is solved."""

from __future__ import annotations

from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from nlpgrasp.common.rows import Clearance, Row
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import InputError
from nlpgrasp.problem.rows import placement_of

if TYPE_CHECKING:
    from nlpgrasp.problem.problem import GraspProblem

SAMPLES = 300  # a face
CLEARLY = 0.1  # of the body's size: a point this far off at every sample is no accident of sampling


def check_placements(problem: GraspProblem) -> None:
    """Refuse constraints that leave some contact nowhere to go, or that cannot be evaluated.

    Raises
    ------
    InputError
        Naming the contact and the constraints that exclude every sampled point of its faces by a wide margin,
        or a least distance between contacts that the faces are too small for.
    """
    k, space, hand = len(problem.models), problem.body.space, problem.hand
    p = [ca.SX.sym("p", space) for _ in range(k)]
    n = [ca.SX.sym("n", space) for _ in range(k)]
    symbols = {} if hand is None else hand.symbols(problem.body.bounds)
    placement = placement_of(hand, p, n, symbols, problem.body.size)
    found = [row for constraint in problem.constraints for row in constraint.rows(placement)]
    converted = [row.as_row() if isinstance(row, Clearance) else row for row in found]
    rows = [row for row in converted if row is not None]
    if not rows and problem.hand is None:
        return
    rng = np.random.default_rng(0)
    points = {name: problem.body.sample(name, SAMPLES, rng) for name in problem.body.face_names}
    for i in range(k):
        _check_contact(problem, i, [r for r in rows if _only(r, p[i], n[i])], p[i], n[i], points)
    _check_room(problem, points)


def _only(row: Row, p: ca.SX, n: ca.SX) -> bool:
    """Return whether an inequality row sees this contact and no other."""
    own = {s.__hash__() for s in ca.vertsplit(ca.vertcat(p, n))}
    seen = [s.__hash__() for s in ca.symvar(ca.SX(row.expression))]
    return bool(seen) and all(s in own for s in seen) and row.lower < row.upper


def _check_contact(
    problem: GraspProblem, i: int, rows: list[Row], p: ca.SX, n: ca.SX, points: dict[str, FloatArray]
) -> None:
    names = [name for name in problem.allowed_faces(i) if len(points[name])]
    if not rows or not names:
        return
    where = np.concatenate([points[name] for name in names])
    normals = np.concatenate([-problem.body.evaluate(name, points[name])[2] for name in names])
    rows_of = ca.vertcat(*[r.expression for r in rows])
    slopes_of = ca.vertcat(*[ca.norm_2(ca.gradient(r.expression, p)) for r in rows])
    values, slopes = ca.Function("rows", [p, n], [rows_of, slopes_of]).map(len(where))(where.T, normals.T)
    value, slope = np.asarray(values.full()), np.asarray(slopes.full())
    lower, upper = (np.array([getattr(r, key) for r in rows])[:, None] for key in ("lower", "upper"))
    with np.errstate(all="ignore"):
        beyond = np.maximum(lower - value, value - upper)
        # to first order, how far a contact would have to move; a row that is not a number is never satisfied
        excess = np.where(beyond > 0.0, beyond / slope, np.where(np.isnan(value), np.inf, 0.0)) / problem.body.size
    if np.min(np.max(excess, axis=0)) > CLEARLY:
        named = ", ".join(dict.fromkeys(rows[j].name for j in np.argmax(excess, axis=0)))
        raise InputError(
            "GraspProblem.constraints",
            f"no point of {_some(names)} left for contact {i} by: {named}",
            "constraints that leave every contact some part of the body",
        )


def _check_room(problem: GraspProblem, points: dict[str, FloatArray]) -> None:
    """Refuse a least distance between contacts for which the faces are too small."""
    least = max((c.least_distance() for c in problem.constraints), default=0.0)
    k = len(problem.models)
    if least <= 0.0 or k < 2:
        return
    names = sorted({name for i in range(k) for name in problem.allowed_faces(i)})
    cloud = np.concatenate([points[name] for name in names])
    if not len(cloud):
        return
    # a cell of diagonal below the distance holds one contact; so does the whole cloud if it is that small
    side = 0.85 * least / np.sqrt(problem.body.space)
    cells = {tuple(c) for c in np.floor((cloud - cloud.min(axis=0)) / side).astype(int)}
    if len(cells) < k or 1.1 * np.linalg.norm(np.ptp(cloud, axis=0)) < least:
        raise InputError(
            "GraspProblem.contacts",
            f"{k} contacts {least:g} m apart",
            f"fewer contacts or less distance on {_some(names)}",
        )


def _some(names: list[str]) -> str:
    return "faces " + ", ".join(names[:6]) + (", ..." if len(names) > 6 else "")
