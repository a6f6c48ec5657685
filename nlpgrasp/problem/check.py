"""Input validation of grasp problems, before any solve."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import casadi as ca
import numpy as np

from nlpgrasp.bodies import Body
from nlpgrasp.common.rows import Clearance, Row
from nlpgrasp.common.shown.numbers import rounded
from nlpgrasp.common.shown.once import say_once
from nlpgrasp.common.validation import FloatArray, likely_size
from nlpgrasp.constraints import PlacementConstraint
from nlpgrasp.contacts import ContactModel
from nlpgrasp.errors import InputError
from nlpgrasp.hands import Hand
from nlpgrasp.problem.rows import placement_of
from nlpgrasp.tasks import Task

MOST_FRICTION = 2.0  # friction coefficient above which a typing error is likely
SAMPLES = 300  # sample points per face
CLEARLY = 0.1  # of the body's size: violation at all samples that cannot be due to sampling


@dataclass(frozen=True)
class Samples:
    """Random points of a face with inward normals.

    Parameters
    ----------
    points : (m, space) array
        Metres, body frame.
    normals : (m, space) array
        Unit, into the body.
    """

    points: FloatArray
    normals: FloatArray


def check_placements(
    body: Body,
    hand: Hand | None,
    constraints: Sequence[PlacementConstraint],
    faces: Sequence[tuple[str, ...]],
    margin: float = 0.0,
) -> None:
    """Raise if constraints leave some contact no feasible point, or cannot be evaluated.

    Parameters
    ----------
    body : Body
    hand : Hand or None
    constraints : sequence of PlacementConstraint
    faces : sequence of k tuples of str
        Allowed faces of each contact.
    margin : float
        Distance of contacts from sharp edges, metres.

    Raises
    ------
    InputError
        When constraints, which are named with the contact, exclude all sampled points of its faces by a wide margin,
        or when the faces are too small for a least distance between contacts.
    """
    k = len(faces)
    p = [ca.SX.sym("p", body.space) for _ in range(k)]
    n = [ca.SX.sym("n", body.space) for _ in range(k)]
    symbols = {} if hand is None else hand.symbols(body.bounds)
    placement = placement_of(hand, p, n, symbols, body.size)
    found = [row for constraint in constraints for row in constraint.rows(placement)]
    converted = [row.as_row() if isinstance(row, Clearance) else row for row in found]
    rows = [row for row in converted if row is not None]
    if not rows and hand is None:
        return
    rng = np.random.default_rng(0)
    samples = {name: _sampled(body, name, rng, margin) for name in sorted({name for own in faces for name in own})}
    for i in range(k):
        own = [row for row in rows if _only(row, p[i], n[i])]
        used = {name: samples[name] for name in faces[i] if len(samples[name].points)}
        if own and used:
            _check_contact(i, own, (p[i], n[i]), used, body.size)
    _check_room(constraints, faces, samples)


def body_words(given: object) -> str:
    """Return the advice of the error for an invalid body, such as a file name or a mesh."""
    if isinstance(given, str | Path):
        return f'a body: ng.Mesh.load("{given}", unit="mm"), in the unit of the file'
    if type(given).__module__.split(".")[0] == "trimesh":
        return 'a body: ng.Mesh(mesh, unit="mm"), in the unit of its vertices'
    return "a body such as ng.Box or ng.Mesh"


def task_words(given: object) -> str:
    """Return the advice of the error for an invalid task, such as a list of tasks."""
    if isinstance(given, list | tuple) and given and all(isinstance(part, Task) for part in given):
        return "one task: tasks add up, such as ng.lift(...) + ng.disturbance(...)"
    return "a task, such as ng.TaskEllipsoid(semi_axes)"


def hand_words(given: object) -> str:
    """Return the advice of the error for an invalid hand, such as a preset's name."""
    if isinstance(given, str):
        return f"a hand: ng.hands.{given}(...) where there is one of that name, or ng.URDFHand.load(path, fingertips)"
    return "a hand such as ng.Fingertips, or None"


def check_patches(models: Sequence[ContactModel], body: Body) -> None:
    """Raise for a contact patch longer than the body, mostly due to swapped arguments."""
    longest = float(np.max(body.bounds[1] - body.bounds[0]))
    for i, model in enumerate(models):
        for name in ("radius", "extents", "length"):
            given = getattr(model, name, None)
            if given is not None and np.max(given) > longest:
                allowed = f"metres, no more than the body's longest side, {longest:.3g}; friction is friction=..."
                raise InputError(f"GraspProblem.contacts[{i}].{name}", f"{np.max(given):g} m", allowed)


def check_size(body: Body) -> None:
    """Raise for a body so large or small that its unit is probably not metres."""
    longest = float(np.max(body.bounds[1] - body.bounds[0]))
    wrong = "its numbers are metres, and were probably given in a {} unit"
    likely_size("GraspProblem.body", f"a {body.kind} with a longest side", longest, wrong, hasattr(body, "unit"))


def warn_of_friction(models: Sequence[ContactModel], field: str) -> None:
    """Warn, once, about implausibly large friction coefficients.

    Parameters
    ----------
    models : sequence of ContactModel
    field : str
        Name of the field, with ``{}`` for the contact's index.
    """
    for i, model in enumerate(models):
        friction = model.coefficients.get("friction", 0.0)
        if friction > MOST_FRICTION:
            text = f"{field.format(i)}: {friction:g} is above {MOST_FRICTION:g}; rubber on dry surfaces has about 1"
            say_once(text)
            return


def _sampled(body: Body, name: str, rng: np.random.Generator, margin: float) -> Samples:
    points = body.sample(name, SAMPLES, rng, margin)
    return Samples(points, -body.evaluate(name, points)[2])


def _only(row: Row, p: ca.SX, n: ca.SX) -> bool:
    """Return whether an inequality constraint involves only the contact with these symbols."""
    own = {s.__hash__() for s in ca.vertsplit(ca.vertcat(p, n))}
    seen = [s.__hash__() for s in ca.symvar(ca.SX(row.expression))]
    return bool(seen) and all(s in own for s in seen) and row.lower < row.upper


def _check_contact(
    i: int, rows: Sequence[Row], symbols: tuple[ca.SX, ca.SX], samples: Mapping[str, Samples], size: float
) -> None:
    """Raise if every sample of contact i's faces violates its constraints by a wide margin."""
    where = np.concatenate([s.points for s in samples.values()])
    normals = np.concatenate([s.normals for s in samples.values()])
    rows_of = ca.vertcat(*[r.expression for r in rows])
    slopes_of = ca.vertcat(*[ca.norm_2(ca.gradient(r.expression, symbols[0])) for r in rows])
    values, slopes = ca.Function("rows", list(symbols), [rows_of, slopes_of]).map(len(where))(where.T, normals.T)
    value, slope = np.asarray(values.full()), np.asarray(slopes.full())
    lower, upper = (np.array([getattr(r, key) for r in rows])[:, None] for key in ("lower", "upper"))
    with np.errstate(all="ignore"):
        beyond = np.maximum(lower - value, value - upper)
        # first-order distance to feasibility; a constraint that is NaN is never satisfied
        excess = np.where(beyond > 0.0, beyond / slope, np.where(np.isnan(value), np.inf, 0.0)) / size
    least = float(np.min(np.max(excess, axis=0)))
    if least > CLEARLY:
        named = ", ".join(dict.fromkeys(rows[j].name for j in np.argmax(excess, axis=0)))
        raise InputError(
            "GraspProblem.constraints",
            f"{named}: kept nowhere on {_some(list(samples))}{_by(least * size)}",
            f"constraints that leave contact {i} some part of the body",
        )


def _check_room(
    constraints: Sequence[PlacementConstraint], faces: Sequence[tuple[str, ...]], samples: Mapping[str, Samples]
) -> None:
    """Raise if the faces are too small for the least distance between contacts."""
    least = max((c.least_distance() for c in constraints), default=0.0)
    k = len(faces)
    if least <= 0.0 or k < 2:
        return
    names = sorted({name for own in faces for name in own})
    cloud = np.concatenate([samples[name].points for name in names])
    if not len(cloud):
        return
    # a cell of smaller diagonal than the distance holds at most one contact, as does a small cloud
    side = 0.85 * least / np.sqrt(cloud.shape[1])
    cells = {tuple(c) for c in np.floor((cloud - cloud.min(axis=0)) / side).astype(int)}
    if len(cells) < k or 1.1 * np.linalg.norm(np.ptp(cloud, axis=0)) < least:
        raise InputError(
            "GraspProblem.contacts",
            f"{k} contacts {least:g} m apart",
            f"fewer contacts or less distance on {_some(names)}",
        )


def _by(missed: float) -> str:
    """Return the least violation as text, metres; empty if unknown."""
    return f" (the nearest misses by {rounded(1e3 * missed)} mm)" if np.isfinite(missed) else ""


def _some(names: list[str]) -> str:
    return "faces " + ", ".join(names[:6]) + (", ..." if len(names) > 6 else "")
