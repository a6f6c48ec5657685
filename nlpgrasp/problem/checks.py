"""Validation of grasp problems before a solve: errors and warnings about user input."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import casadi as ca
import numpy as np

from nlpgrasp.bodies import Body, Mesh
from nlpgrasp.bodies.mesh.signed_distance import FINEST, choose_grid_resolution
from nlpgrasp.common.formatting import format_number, vector
from nlpgrasp.common.scalar_constraints import Clearance, ScalarConstraint
from nlpgrasp.common.user_warnings import warn_once
from nlpgrasp.common.validation import FloatArray, check_body_size
from nlpgrasp.constraints import Obstacle, PlacementConstraint, Table
from nlpgrasp.contacts import ContactModel
from nlpgrasp.errors import InputError
from nlpgrasp.hands import Hand, ParallelJaw, PosedHand, URDFHand
from nlpgrasp.problem.candidate_constraints import symbolic_candidate
from nlpgrasp.tasks import Task
from nlpgrasp.tasks.base import component_ranges, parts_of

MOST_FRICTION = 2.0  # friction coefficient above which a typing error is likely
SAMPLES = 300  # sample points per face, for the constraints on contacts
WIDE_MARGIN = 0.1  # of the body's size: violation at all samples that cannot be due to sampling
TABLE_DEPTH = 0.02  # of the body's size: depth below a table above which a mistake is likely
# longest side and shortest side of a body that are asked about
SPAN_LIMITS = 0.01, 2.0  # times the fingertips' reach from the palm, half of an upper bound of the hand's opening
JAW_LIMITS = 0.02, 10.0  # times the opening of jaws, which hold rims of larger bodies
FAR_ORIGIN = 0.1  # of the body's size: distance of the frame's origin from the centroid
LONG, LONGEST = 100.0, 2.0  # moment arm that is implausible: times the body's size, and metres
LARGE_LENGTH = 20.0  # times the body's size: implausible torsional friction, fingertip radius or clearance
FAR_TABLE = 50.0  # times the body's size: implausible distance of a table
WALL = 1.0 / 3.0  # of the wall thickness: largest accepted 80th percentile of the distance
THINNEST = 2.0  # cells of the finest grid: wall thickness that has a smoothed surface
FINER = 1.5  # advised factor on the resolution, where less smoothing does not help


def check_placements(
    body: Body,
    hand: Hand | None,
    constraints: Sequence[PlacementConstraint],
    faces: Sequence[tuple[str, ...]],
    margin: float = 0.0,
) -> None:
    """Raise ``InputError`` if constraints leave some contact no feasible point.

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
    if not constraints:
        return
    k = len(faces)
    p = [ca.SX.sym("p", body.space) for _ in range(k)]
    n = [ca.SX.sym("n", body.space) for _ in range(k)]
    symbols = {} if hand is None else hand.symbols(body.bounds)
    placement = symbolic_candidate(hand, p, n, symbols, body.size)
    all_constraints = [scalar for constraint in constraints for scalar in constraint.rows(placement)]
    converted = [scalar.as_row() if isinstance(scalar, Clearance) else scalar for scalar in all_constraints]
    scalar_constraints = [scalar for scalar in converted if scalar is not None]
    if not scalar_constraints and hand is None:
        return
    rng = np.random.default_rng(0)
    samples = {
        name: _sample_face(body, name, rng, margin)
        for name in sorted({name for contact_faces in faces for name in contact_faces})
    }
    for i in range(k):
        contact_constraints = [scalar for scalar in scalar_constraints if _involves_only(scalar, p[i], n[i])]
        face_samples = {name: samples[name] for name in faces[i] if len(samples[name].points)}
        if contact_constraints and face_samples:
            _check_contact(i, contact_constraints, (p[i], n[i]), face_samples, body.size)
    _check_distances(constraints, faces, samples)


@dataclass(frozen=True)
class FaceSamples:
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


def _sample_face(body: Body, name: str, rng: np.random.Generator, margin: float) -> FaceSamples:
    """Return random points of a face with their inward normals."""
    points = body.sample(name, SAMPLES, rng, margin)
    return FaceSamples(points, -body.evaluate(name, points)[2])


def _involves_only(constraint: ScalarConstraint, p: ca.SX, n: ca.SX) -> bool:
    """Return whether a scalar constraint is an inequality on no other variables than one contact's."""
    contact_symbols = {s.__hash__() for s in ca.vertsplit(ca.vertcat(p, n))}
    symbols = [s.__hash__() for s in ca.symvar(ca.SX(constraint.expression))]
    return bool(symbols) and all(s in contact_symbols for s in symbols) and constraint.lower < constraint.upper


def _check_contact(
    i: int,
    constraints: Sequence[ScalarConstraint],
    symbols: tuple[ca.SX, ca.SX],
    samples: Mapping[str, FaceSamples],
    size: float,
) -> None:
    """Raise ``InputError`` if all samples of a contact's faces violate its constraints by a wide margin."""
    points = np.concatenate([s.points for s in samples.values()])
    normals = np.concatenate([s.normals for s in samples.values()])
    values_of = ca.vertcat(*[r.expression for r in constraints])
    slopes_of = ca.vertcat(*[ca.norm_2(ca.gradient(r.expression, symbols[0])) for r in constraints])
    values, slopes = ca.Function("rows", list(symbols), [values_of, slopes_of]).map(len(points))(points.T, normals.T)
    value, slope = np.asarray(values.full()), np.asarray(slopes.full())
    lower, upper = (np.array([getattr(r, key) for r in constraints])[:, None] for key in ("lower", "upper"))
    with np.errstate(all="ignore"):
        violation = np.maximum(lower - value, value - upper)
        # first-order distance to feasibility; a constraint that is NaN is never satisfied
        excess = np.where(violation > 0.0, violation / slope, np.where(np.isnan(value), np.inf, 0.0)) / size
    least = float(np.min(np.max(excess, axis=0)))
    if least > WIDE_MARGIN:
        names = ", ".join(dict.fromkeys(constraints[j].name for j in np.argmax(excess, axis=0)))
        raise InputError(
            "GraspProblem.constraints",
            f"{names}: kept nowhere on {_format_names(list(samples))}{_format_violation(least * size)}",
            f"constraints that leave contact {i} some part of the body",
        )


def _check_distances(
    constraints: Sequence[PlacementConstraint], faces: Sequence[tuple[str, ...]], samples: Mapping[str, FaceSamples]
) -> None:
    """Raise ``InputError`` if the faces are too small for the required distance between contacts."""
    least = max((c.least_distance() for c in constraints), default=0.0)
    k = len(faces)
    if least <= 0.0 or k < 2:
        return
    names = sorted({name for contact_faces in faces for name in contact_faces})
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
            f"fewer contacts or less distance on {_format_names(names)}",
        )


def _format_violation(violation: float) -> str:
    """Return a text on the least violation, metres, in millimetres; empty if the violation is not finite."""
    return f" (the nearest misses by {format_number(1e3 * violation)} mm)" if np.isfinite(violation) else ""


def _format_names(names: list[str]) -> str:
    """Return a text that lists names of faces."""
    return "faces " + ", ".join(names[:6]) + (", ..." if len(names) > 6 else "")


def check_patches(models: Sequence[ContactModel], body: Body) -> None:
    """Raise ``InputError`` for a contact patch longer than the body, as by swapped arguments."""
    longest = float(np.max(body.bounds[1] - body.bounds[0]))
    for i, model in enumerate(models):
        for name in ("radius", "extents", "length"):
            length = getattr(model, name, None)
            if length is not None and np.max(length) > longest:
                expected = f"metres, no more than the body's longest side, {longest:.3g}"
                expected = f"{expected}; friction is friction=..."
                raise InputError(f"GraspProblem.contacts[{i}].{name}", f"{np.max(length):g} m", expected)


def check_volume_parts(budget: object, hand: Hand | None) -> None:
    """Raise ``InputError`` for a force budget or a hand with which the volume nu cannot be maximised."""
    kind = budget if isinstance(budget, str) else getattr(budget, "kind", budget)
    if kind != "l2":
        expected = 'force_budget="l2", of which the volume is maximised'
        raise InputError("GraspProblem.objective", f'nu with force_budget="{kind}"', expected)
    if isinstance(hand, PosedHand):
        expected = "free contacts, or a hand that follows its contacts"
        raise InputError("GraspProblem.objective", f"nu with a {type(hand).__name__}", expected)


def check_size(body: Body) -> None:
    """Raise ``InputError`` for a body so large or small that its unit is probably not metres."""
    longest = float(np.max(body.bounds[1] - body.bounds[0]))
    mistake = "its numbers are metres, and were probably given in a {} unit"
    check_body_size("GraspProblem.body", f"a {body.kind} with a longest side", longest, mistake, hasattr(body, "unit"))


def warn_of_friction(models: Sequence[ContactModel], field: str) -> None:
    """Warn once about an implausibly large friction coefficient.

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
            warn_once(text)
            return


def warn_of_lengths(
    body: Body, models: Sequence[ContactModel], constraints: Sequence[PlacementConstraint], hand: Hand | None
) -> None:
    """Warn once about a length that is implausibly large for the body.

    Parameters
    ----------
    body : Body
    models : sequence of ContactModel
    constraints : sequence of PlacementConstraint
    hand : Hand or None
    """
    longest = float(np.max(body.bounds[1] - body.bounds[0]))
    for field, length, compared, limit in _lengths(body, models, constraints, hand):
        if compared > limit * body.size:
            warn_once(
                f"{field}: {length:g} m beside a body of {longest:.3g} m; if millimetres were meant, {length / 1e3:g}"
            )
            return


def _lengths(
    body: Body, models: Sequence[ContactModel], constraints: Sequence[PlacementConstraint], hand: Hand | None
) -> Iterator[tuple[str, float, float, float]]:
    """Yield the lengths of a problem that are compared with the body's size.

    Each entry is (name, given length, compared length, limit of the compared length): metres, the limit in body sizes.
    """
    for i, model in enumerate(models):
        torsion = model.coefficients.get("torsional_friction", 0.0)
        yield f"contacts[{i}]: torsional friction", torsion, torsion, LARGE_LENGTH
    for i, constraint in enumerate(constraints):
        if isinstance(constraint, Table | Obstacle):
            yield f"constraints[{i}]: clearance", constraint.clearance, constraint.clearance, LARGE_LENGTH
        if isinstance(constraint, Table):
            height, (low, high) = constraint.height, body.bounds[:, -1]
            yield f"constraints[{i}]: height", height, max(low - height, height - high), FAR_TABLE
    for link, tip in hand.tips if isinstance(hand, URDFHand) else ():
        yield f"fingertip {link}: radius", tip.standoff, tip.standoff, LARGE_LENGTH


def warn_of_point(task: Task, body: Body) -> None:
    """Warn once about a disturbance without a point if the frame's origin is far from the body's centroid.

    Scans and CAD parts often have their origin at a foot or a flange: a force that acts there has a moment arm about
    the centroid, and requires far more torque than the disturbance states.

    Parameters
    ----------
    task : Task
        As given, before its moments are taken about the problem's torque origin.
    body : Body
    """
    _warn_of_arm(task, body)
    distance = float(np.linalg.norm(body.centroid))
    if distance > FAR_ORIGIN * body.size and any(part.point_left_out for part in parts_of(task)):
        warn_once(
            f"disturbance: without a point its force acts at the origin of the body's frame, {1e3 * distance:.3g} mm "
            "from the body's centroid: state point=body.centroid, or point=[0, 0, 0] where that is meant"
        )


def task_of_problem(task: Task, origin: FloatArray) -> Task:
    """Return a task about a problem's torque origin; warn if it has another one only from another problem."""
    result, left_out = task.about(origin), task.torque_origin is None
    if task.torque_origin is not None and task.origin_left_out:
        left_out = np.array_equal(task.torque_origin, origin)
        if not left_out:
            points = f"[{vector(task.torque_origin, 3)}] m, the torque origin of the problem it was in"
            warn_once(
                f"GraspProblem.task: its moments stay about {points}, and not about [{vector(origin, 3)}] m; with "
                "task=problem.stated_task they are about the new one"
            )
    result.origin_left_out = left_out
    return result


def _warn_of_arm(task: Task, body: Body) -> None:
    """Warn once about moments whose lever arms are too long for the body.

    Typical causes are a point in millimetres and moments in newton-millimetres.
    """
    largest, space = np.max(np.abs(component_ranges(task.about(body.centroid))), axis=0), body.space
    force, moment = float(np.max(largest[:space])), float(np.max(largest[space:]))
    if force > 0.0 and moment / force > max(LONG * body.size, LONGEST):
        message = f"moments up to {moment:.3g} N m beside forces up to {force:.3g} N, an arm of {moment / force:.3g} m"
        warn_once(f"task: {message} on a body of {2.0 * body.size:.3g} m: moments are newton-metres, and points metres")


def warn_of_surroundings(body: Body, constraints: Sequence[PlacementConstraint], hand: Hand | None) -> None:
    """Warn about a table that intersects the body, and about a hand of another size than the body.

    Parameters
    ----------
    body : Body
    constraints : sequence of PlacementConstraint
    hand : Hand or None
    """
    low, high = body.bounds[:, -1]
    for i, table in enumerate(constraints):
        if isinstance(table, Table) and body.tight and TABLE_DEPTH * body.size < table.height - low < high - low:
            message = f"the body reaches {format_number(1e3 * (table.height - low))} mm below the table"
            location = f"height {format_number(table.height)} m, lowest point {format_number(low, least=1e-9)} m"
            warn_once(f"constraints[{i}]: {message} ({location}); a table that it stands on is ng.Table.under(body)")
    _warn_of_sizes(body, hand)


def _warn_of_sizes(body: Body, hand: Hand | None) -> None:
    """Warn once about a body that is too large or too small for the hand."""
    sides = body.bounds[1] - body.bounds[0]
    shortest, longest = float(np.min(sides)), float(np.max(sides))
    if isinstance(hand, URDFHand):
        least, most = np.multiply(SPAN_LIMITS, hand.tree.span)
        text = f"a hand whose fingertips reach {format_number(hand.tree.span)} m from its palm"
    elif isinstance(hand, ParallelJaw):
        least, most = np.multiply(JAW_LIMITS, hand.opening)
        text = f"jaws that open to {format_number(hand.opening)} m"
    else:
        return
    if longest < least or shortest > most:
        side = f"shortest side is {format_number(shortest)}"
        if longest < least:
            side = f"longest side is {format_number(longest)}"
        warn_once(
            f"GraspProblem.body: a body whose {side} m, for {text}; are both in metres? A mesh in millimetres takes "
            'unit="mm"'
        )


def warn_of_smoothing(body: Body, hand: Hand | None) -> None:
    """Warn once if a fifth of a mesh is far from the smoothed surface that the solver uses.

    Parameters
    ----------
    body : Body
        Far means more than a third of its wall thickness, or the radius of the hand's smallest fingertip.
    hand : Hand or None
    """
    if not isinstance(body, Mesh):
        return
    tip = min((radius for radius in (() if hand is None else hand.tip_radii) if radius > 0.0), default=np.inf)
    offset = body.offset.most
    if offset <= min(WALL * body.wall, tip):
        return
    is_thin = offset > WALL * body.wall
    reference = f"walls {1e3 * body.wall:.3g} mm thick" if is_thin else f"a fingertip of {1e3 * tip:.3g} mm radius"
    advice = choose_grid_resolution(np.ptp(body.bounds, axis=0), min(body.wall, tip / WALL))
    smoothing, resolution = advice.smoothing, advice.resolution
    if smoothing / resolution >= body.smoothing / body.resolution:
        smoothing, resolution = body.smoothing, min(int(np.ceil(FINER * body.resolution)), FINEST)
    cure = f"ng.Mesh takes smoothing={smoothing:g}, resolution={resolution}"
    suitable = THINNEST * float(np.max(np.ptp(body.bounds, axis=0))) / FINEST
    if body.wall < suitable:
        cure = f"no grid suits walls below {1e3 * suitable:.3g} mm; ng.ParallelJaw takes them, by the mesh's triangles"
    warn_once(
        f"{body.source or 'the mesh'}: the smooth surface that the solver works on is {1e3 * offset:.3g} mm or more "
        f"off a fifth of the mesh, which is much beside {reference}: {cure}"
    )


def body_advice(value: object) -> str:
    """Return advice for the error about an invalid body, such as a file name."""
    if isinstance(value, str | Path):
        return f'a body: ng.Mesh.load("{value}", unit="mm"), in the unit of the file'
    if type(value).__module__.split(".")[0] == "trimesh":
        return 'a body: ng.Mesh(mesh, unit="mm"), in the unit of its vertices'
    return "a body such as ng.Box or ng.Mesh"


def task_advice(value: object) -> str:
    """Return advice for the error about an invalid task, such as a list of tasks."""
    if isinstance(value, list | tuple) and value and all(isinstance(part, Task) for part in value):
        return "one task: tasks add up, such as ng.lift(...) + ng.disturbance(...)"
    return "a task, such as ng.TaskEllipsoid(semi_axes)"


def hand_advice(value: object) -> str:
    """Return advice for the error about an invalid hand, such as a preset's name."""
    if isinstance(value, str):
        return f"a hand: ng.hands.{value}(...) where there is one of that name, or ng.URDFHand.load(path, fingertips)"
    return "a hand such as ng.Fingertips, or None"
