"""Recomputation of constraints and hand from a file's problem, contacts and posture.

Each part of the problem (its constraints, the edge margin, the hand, its links) yields scalar constraints, which are
compared with those that the file states. Stated constraints that no part yields must belong to a part that cannot be
recomputed, by their names; they must keep their stated limits, to a tolerance that depends on their unit
(``ConstraintScales``).
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from nlpgrasp.common.scalar_constraints import (
    CLEARANCE,
    CLOSED_LINKAGE,
    EDGE_MARGIN,
    FINGERTIP_CLEARANCE,
    ON_FINGERTIP,
    TIPS_APART,
    UNIT_QUATERNION,
)
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import number
from nlpgrasp.errors import InputError
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.solution.records import ConstraintReport
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.verify.approach_checks import path_checks, phase_checks, pregrasp_checks
from nlpgrasp.verify.check import BROKEN, Check, NotCheckedError, broken_data_message, guard
from nlpgrasp.verify.force_checks import squeeze_checks
from nlpgrasp.verify.gripper_checks import gripper_checks
from nlpgrasp.verify.joint_checks import joint_margin_checks, torque_checks
from nlpgrasp.verify.link_checks import link_checks
from nlpgrasp.verify.link_clearances import TABLE_ROWS, clearance_constraints
from nlpgrasp.verify.mesh_body import MeshSurface
from nlpgrasp.verify.numeric_hands import UnknownHand, fingertip_clearances
from nlpgrasp.verify.optimality_checks import displacement_checks, optimality_checks
from nlpgrasp.verify.registry import BODIES, CONSTRAINTS, HANDS
from nlpgrasp.verify.sources import SourceFolders
from nlpgrasp.verify.stated_placement import (
    PROMISE,
    ROUNDING,
    ConstraintValue,
    NumericBody,
    NumericHand,
    StatedConstraints,
    StatedPlacement,
    check_stated_constraints,
    check_unstated_constraints,
    require_body,
)
from nlpgrasp.verify.surface_checks import face_check, size_of, surface_checks

CLEARANCE_CHECK = "room for fingertips"  # name of the check
ON_MESH = 10.0  # tolerance of constraints on meshes, in units of the promise
MISSING_BODY_FACTOR = 5.0  # largest size of a missing body, in units of its contacts' bounding box
LEAST_SLACK = 1e-6  # least tolerance of constraints that are not recomputed, in the constraint's unit

# prefixes of the names of scalar constraints, by the part that they belong to
CONSTRAINT_PREFIXES = {
    "table": "table, ",
    "spread": "spread, ",
    "workspace": "workspace, ",
    "forbid": "forbidden region, ",
    "symmetric": "symmetric, ",
    "approach": "approach, ",
}
HAND_PREFIXES = {
    "urdf": (f"{ON_FINGERTIP} ", UNIT_QUATERNION, f"{CLOSED_LINKAGE}, "),
    "fingertips": ("reach, ", f"{TIPS_APART}, "),
    "parallel_jaw": ("opening of the jaws", "opposed jaws", "facing, "),
}
FINGERS = re.compile(r", fingers? (\d+(?: and \d+)*)(?=,|\[|$)")  # contacts after the kind in a name
FINGER_INDEX = re.compile(r"(?:finger|fingers|and) (\d+)(?=,| and |$)")  # indices of contacts in a name

# prefixes and suffixes of the names of scalar constraints, by their unit
CONSTRAINT_LENGTHS = ("table, ", "workspace, ", "symmetric, ", "forbidden region, ")
LENGTHS = (*CONSTRAINT_LENGTHS, f"{CLEARANCE}, ", f"{EDGE_MARGIN}, ", f"{FINGERTIP_CLEARANCE}, ")
ON_TIP_LENGTHS = (", x", ", y", ", z", ", plane", ", extent x", ", extent y")  # suffixes of lengths on a fingertip

Owner = Callable[[str], bool]
"""Whether a part of the problem may own a scalar constraint of this name."""


def recompute(solution: GraspSolution, grasp: Grasp, sources: SourceFolders) -> list[Check]:
    """Return the checks of surface, faces, constraints, hand and local optimum."""
    with np.errstate(all="ignore"):  # invalid numbers give NaN, which fails every comparison
        return guard("problem", lambda: _recompute_all(solution, grasp, sources))


def _recompute_all(solution: GraspSolution, grasp: Grasp, sources: SourceFolders) -> list[Check]:
    """Return the checks of ``recompute`` without a guard against invalid data."""
    stated = StatedConstraints(solution.constraints)
    values = stated.values()
    hand = _numeric_hand(solution, values, sources)
    surface, checks = surface_checks(solution, grasp, hand, sources)
    points = grasp.points
    bounds = np.stack([points.min(axis=0), points.max(axis=0)]) if surface is None else surface.bounds
    size = size_of(bounds, grasp) * (MISSING_BODY_FACTOR if surface is None else 1.0)
    placement = StatedPlacement(points, grasp.normals, size, hand, lambda body: BODIES.of(body)(body, sources), values)
    promise = PROMISE * (ON_MESH if solution.body["type"] == "mesh" else 1.0)
    compare = partial(check_stated_constraints, stated=stated, promise=promise)
    parts = _constraints_of_parts(solution, grasp, surface, placement)
    constraint_checks = [_guard_check(name, constraints, compare) for name, constraints in parts.items()]
    if hand is not None and hand.has_links:
        within = partial(check_unstated_constraints, promise=promise)
        constraint_checks.append(_guard_check("joints", hand.limits, within))
    checks += _hand_checks(solution, grasp, surface, placement)
    checks += guard("local optimum", lambda: optimality_checks(solution, grasp, surface, size))
    checks += guard("worst displacement", lambda: displacement_checks(solution, grasp, surface, size))
    obstacles = (str(data["name"]) for data in solution.problem["constraints"] if data["type"] == "obstacle")
    scales = ConstraintScales(size, tuple(obstacles))
    slack = partial(_slack, stated=stated, scales=scales, tolerance=promise)
    owners = _owners(solution, len(grasp))
    return [*checks, face_check(solution), *constraint_checks, *_stated_check(solution, stated, owners, slack)]


def _constraints_of_parts(
    solution: GraspSolution, grasp: Grasp, surface: NumericBody | None, placement: StatedPlacement
) -> dict[str, Callable[[], Iterable[ConstraintValue]]]:
    """Return, for each part of the problem by name, the function that yields its scalar constraints."""
    hand = placement.hand
    has_margin = "edge_margin" in solution.problem
    parts: dict[str, Callable[[], Iterable[ConstraintValue]]] = {
        f"constraint {i}, {data['type']}": partial(_problem_constraint, data, placement)
        for i, data in enumerate(solution.problem["constraints"])
    }
    if has_margin:
        parts[EDGE_MARGIN] = partial(edge_margin_constraints, solution.problem, solution.faces, grasp, surface)
    if hand is not None:
        parts["hand"] = partial(hand.rows, placement)
    if hand is not None and not hand.has_links and has_margin:
        parts[CLEARANCE_CHECK] = partial(fingertip_clearances, solution.body, surface, placement)
    if hand is not None and hand.has_links:
        parts["links"] = partial(clearance_constraints, hand, surface, solution.problem["constraints"], placement)
    return parts


def _hand_checks(
    solution: GraspSolution, grasp: Grasp, surface: NumericBody | None, placement: StatedPlacement
) -> list[Check]:
    """Return the checks of the hand: torques, squeeze, margins, links, phases and paths."""
    hand = placement.hand
    groups: dict[str, Callable[[], list[Check]]] = {
        "joint torques": lambda: torque_checks(solution, grasp, hand),
        "squeeze": lambda: squeeze_checks(solution, grasp, hand),
        "room of joints": lambda: joint_margin_checks(solution, hand),
        "gripper": lambda: gripper_checks(solution, placement, surface),
        "links inside something": lambda: link_checks(solution, hand, surface, placement),
        "phases": lambda: phase_checks(solution),
        "pregrasp": lambda: pregrasp_checks(solution, hand),
        "approach": lambda: path_checks(solution, hand, surface, placement),
    }
    return [check for name, checks in groups.items() for check in guard(name, checks)]


def _numeric_hand(solution: GraspSolution, values: Mapping[str, float], sources: SourceFolders) -> NumericHand | None:
    """Return the numeric model of the problem's hand in the file's posture; None without a hand."""
    data = solution.problem["hand"]
    if data is None:
        return None
    contacts = len(solution.faces)
    if data["type"] == "fingertips" and data["count"] != contacts:
        raise InputError("problem.hand.count", data["count"], f"as many as contacts ({contacts})")
    try:
        return HANDS.of(data)(data, solution.hand or {}, values, sources)
    except NotCheckedError as reason:
        return UnknownHand(str(reason))


def _guard_check(
    name: str,
    constraints: Callable[[], Iterable[ConstraintValue]],
    compare: Callable[[str, Iterable[ConstraintValue]], Check],
) -> Check:
    """Return the check of a comparison, failed if invalid data raise an exception."""
    try:
        return compare(name, _yield_lazily(constraints))
    except NotCheckedError as reason:
        return Check.not_made(name, str(reason))
    except BROKEN as error:
        return Check(name, False, broken_data_message(error))


def _yield_lazily(constraints: Callable[[], Iterable[ConstraintValue]]) -> Iterator[ConstraintValue]:
    """Yield the constraints that a function returns; its errors are raised by the loop over them."""
    yield from constraints()


def _problem_constraint(data: Json, placement: StatedPlacement) -> Iterable[ConstraintValue]:
    """Return the scalar constraints of one constraint of the problem."""
    return CONSTRAINTS.of(data)(data, placement)


def edge_margin_constraints(
    problem: Json, faces: tuple[str, ...], grasp: Grasp, surface: NumericBody | None
) -> Iterator[ConstraintValue]:
    """Yield the constraints on the distance of each contact from its face's sharp edges.

    On a mesh the stated distance may be smaller than the recomputed one: the margin is kept all the same.
    """
    margin = number("edge_margin", problem["edge_margin"], at_least=0.0)
    body = require_body(surface)
    is_mesh = isinstance(body, MeshSurface)
    size = float(np.linalg.norm(body.bounds[1] - body.bounds[0])) / 2.0
    for i, (face, point) in enumerate(zip(faces, grasp.points, strict=True)):
        value = body.edge_distance(face, point)
        if np.isfinite(value):
            yield ConstraintValue(f"{EDGE_MARGIN}, finger {i}", value, margin, scale=size, stated_below=is_mesh)


def _stated_check(
    solution: GraspSolution,
    stated: StatedConstraints,
    owners: Mapping[str, Owner],
    slack: Callable[[ConstraintReport], float],
) -> list[Check]:
    """Return the check that all stored constraints keep their limits and belong to a part of the problem."""
    if not solution.constraints:
        return []
    errors = [f"{c.name} is outside its limits" for c in solution.constraints if not _is_within_slack(c, slack(c))]
    errors += [
        f"{c.name} is not of kind {c.kind!r} or not about {c.fingers}"
        for c in solution.constraints
        if not _has_label(c)
    ]
    unknown_owners = [owners[part] for part in stated.unknown]
    unowned = [name for name in stated.unmatched if not any(owns(name) for owns in unknown_owners)]
    errors += [f"{name} is nothing that the problem asks" for name in unowned]
    summary = f"{len(solution.constraints)} stated values"
    return [Check("constraints", not errors, f"{summary}: {'; '.join(errors)}" if errors else summary)]


def _has_label(constraint: ConstraintReport) -> bool:
    """Return whether kind and fingers of a stored constraint are those in its name."""
    rest = constraint.name.removeprefix(constraint.kind)
    stated = " and ".join(map(str, constraint.fingers))
    return bool(constraint.kind) and rest != constraint.name and [stated] * bool(stated) == FINGERS.findall(rest)


def _is_within_slack(constraint: ConstraintReport, slack: float) -> bool:
    """Return whether a stored constraint keeps its limits up to an allowed violation."""
    return constraint.lower - slack <= constraint.value <= constraint.upper + slack


def _slack(
    constraint: ConstraintReport, stated: StatedConstraints, scales: ConstraintScales, tolerance: float
) -> float:
    """Return the largest tolerated violation of a stored constraint, in the constraint's unit.

    Recomputed constraints have the scale of their formula, others that of their name.

    Parameters
    ----------
    constraint : ConstraintReport
        One of those in ``stated``.
    stated : StatedConstraints
    scales : ConstraintScales
    tolerance : float
        The solver's feasibility tolerance, relative to the scale.
    """
    if id(constraint) in stated.slack:  # recomputed: known by identity, as several constraints may have one name
        return stated.slack[id(constraint)]
    return max((tolerance + ROUNDING) * scales.of(constraint.name), LEAST_SLACK)


@dataclass(frozen=True)
class ConstraintScales:
    """Typical sizes of stored constraints by their names, for relative tolerances.

    Parameters
    ----------
    size : float
        The body's characteristic length, metres.
    obstacles : tuple of str
        Names of the problem's obstacles.
    """

    size: float
    obstacles: tuple[str, ...] = ()

    def of(self, name: str) -> float:
        """Return the typical size of a constraint, in its unit: metres, or 1 for a cosine."""
        if name.startswith(f"{ON_FINGERTIP} "):
            return self.size if name.endswith(ON_TIP_LENGTHS) else 1.0
        lengths = (*LENGTHS, *(f"{obstacle}, " for obstacle in self.obstacles))
        return self.size if name.startswith(lengths) else 1.0


def _owners(solution: GraspSolution, contacts: int) -> dict[str, Owner]:
    """Return, by part of the problem, the function that says whether a constraint of a given name may belong to it."""
    constraints, hand = solution.problem["constraints"], solution.problem["hand"]
    owners = {f"constraint {i}, {data['type']}": constraint_owner(data, contacts) for i, data in enumerate(constraints)}
    owners[EDGE_MARGIN], owners[CLEARANCE_CHECK] = margin_owner(contacts), clearance_owner(contacts)
    if hand is not None:
        owners["hand"], owners["links"] = hand_owner(hand, contacts), links_owner(constraints)
    return owners


def constraint_owner(data: Json, contacts: int) -> Owner:
    """Return a test of names that is true for the scalar constraints of one constraint of the problem.

    For types of other packages, it is true for every name.
    """
    kind = str(data["type"])
    if kind == "obstacle":
        return _named_with_prefix((f"{data['name']}, ",), contacts)
    if kind == "expression":
        elements = re.compile(re.escape(str(data["name"])) + r"(?:\[\d+\])?")
        return lambda name: elements.fullmatch(name) is not None
    return _named_with_prefix((CONSTRAINT_PREFIXES[kind],), contacts) if kind in CONSTRAINT_PREFIXES else owns_any


def hand_owner(data: Json, contacts: int) -> Owner:
    """Return a test of names that is true for the scalar constraints of a hand.

    For types of other packages, every name.
    """
    kind = str(data["type"])
    return _named_with_prefix(HAND_PREFIXES[kind], contacts) if kind in HAND_PREFIXES else owns_any


def links_owner(constraints: Sequence[Json]) -> Owner:
    """Return a test of names that is true for the scalar constraints of a hand's links, which name no contact."""
    avoided = [str(data.get("name", TABLE_ROWS)) for data in constraints if data["type"] in ("table", "obstacle")]
    return _named_with_prefix(tuple(f"{kind}, " for kind in (CLEARANCE, *avoided)), 0)


def margin_owner(contacts: int) -> Owner:
    """Return a test of names that is true for the scalar constraints of the edge margin."""
    return _named_with_prefix((f"{EDGE_MARGIN}, ",), contacts)


def clearance_owner(contacts: int) -> Owner:
    """Return a test of names that is true for the scalar constraints of the fingertips' clearance."""
    return _named_with_prefix((f"{FINGERTIP_CLEARANCE}, ",), contacts)


def owns_any(name: str) -> bool:
    """Return True, as the names of another package's scalar constraints are not known."""
    return True


def _named_with_prefix(prefixes: tuple[str, ...], contacts: int) -> Owner:
    """Return a test of names that is true for one of the prefixes with valid contact indices."""
    return lambda name: name.startswith(prefixes) and all(int(i) < contacts for i in FINGER_INDEX.findall(name))
