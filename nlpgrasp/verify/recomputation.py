"""Recomputation of constraints and hand from problem, contacts and posture in the file.

Each part of the problem (its constraints, the edge margin, the hand, its links) yields scalar constraints, which are
compared with those that the file states. Stated constraints that no part yields must belong to a part that cannot be
recomputed, by their names; they must keep their stated limits, to a tolerance that depends on their unit
(``ConstraintScales``).
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np

from nlpgrasp.common.drawing import Drawing
from nlpgrasp.common.scalar_constraints import (
    CLEARANCE,
    EDGE_MARGIN,
    ON_FINGERTIP,
    ROOM,
    SELF_COLLISION,
    TIPS_APART,
    UNIT_QUATERNION,
)
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array, number
from nlpgrasp.errors import InputError
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.solution.records import ConstraintReport
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.verify.approach_checks import phase_checks, way_checks
from nlpgrasp.verify.check import BROKEN, NO_BODY, Check, NotCheckedError, broken_data_message, guard
from nlpgrasp.verify.force_checks import squeeze_checks
from nlpgrasp.verify.gripper_checks import gripper_checks
from nlpgrasp.verify.joint_checks import joint_margin_checks, torque_checks
from nlpgrasp.verify.link_checks import link_checks
from nlpgrasp.verify.numeric_hands import UnknownHand, fingertip_clearances
from nlpgrasp.verify.optimality_checks import optimality_checks
from nlpgrasp.verify.registry import BODIES, CONSTRAINTS, HANDS
from nlpgrasp.verify.sources import SourceFolders
from nlpgrasp.verify.stated_placement import (
    PROMISE,
    ROUNDING,
    ConstraintValue,
    HandNumbers,
    NumericBody,
    StatedConstraints,
    StatedPlacement,
    check_stated_constraints,
    check_unstated_constraints,
)
from nlpgrasp.verify.surface_checks import WIDEST, face_check, size_of, surface_checks

FITTING = "room for fingertips"  # name of the check
LIKENESS = 0.1  # tolerance relative to the body's size: drawings have fewer triangles
ON_MESH = 10.0  # tolerance of constraints on meshes, in units of the promise
UNSEEN = 5.0  # largest size of a missing, undrawn body, in units of its contacts' spread
SPAN = 3.0  # largest reach of a hand, in distances of the farthest contact from the palm
LEAST_SLACK = 1e-6  # least tolerance of constraints that are not recomputed, in their own unit

# beginnings of the names of scalar constraints, by the part that they belong to
CONSTRAINT_BEGINNINGS = {
    "table": "table, ",
    "spread": "spread, ",
    "workspace": "workspace, ",
    "forbid": "forbidden region, ",
    "symmetric": "symmetric, ",
    "approach": "approach, ",
}
HAND_BEGINNINGS = {
    "urdf": (f"{ON_FINGERTIP} ", UNIT_QUATERNION, f"{TIPS_APART}, "),
    "fingertips": ("reach, ", f"{TIPS_APART}, "),
    "parallel_jaw": ("opening of the jaws", "opposed jaws", "facing, "),
}
LINKS = (f"{CLEARANCE}, ", f"{SELF_COLLISION}, ")
FINGER = re.compile(r"(?:finger|fingers|and) (\d+)(?=,| and |$)")  # indices of contacts in a name

# beginnings and endings of the names of scalar constraints, by their unit
OF_CONSTRAINTS = ("table, ", "workspace, ", "symmetric, ", "forbidden region, ")
LENGTHS = (*OF_CONSTRAINTS, f"{CLEARANCE}, ", f"{EDGE_MARGIN}, ", f"{ROOM}, ")
ON_TIP_LENGTHS = (", x", ", y", ", z", ", plane", ", extent x", ", extent y")  # endings of lengths on a fingertip
SQUARED_SPANS = (f"{TIPS_APART}, ", f"{SELF_COLLISION}, ")  # for hands with links; free fingertips are recomputed

Owner = Callable[[str], bool]
"""Whether a part of the problem may own a scalar constraint of this name."""


def recompute(solution: GraspSolution, grasp: Grasp, sources: SourceFolders) -> list[Check]:
    """Return the checks of surface, faces, constraints and hand."""
    with np.errstate(all="ignore"):  # invalid numbers give NaN, which fails every comparison
        return guard("problem", lambda: _recompute_all(solution, grasp, sources))


def _recompute_all(solution: GraspSolution, grasp: Grasp, sources: SourceFolders) -> list[Check]:
    stated = StatedConstraints(solution.constraints)
    values = stated.values()
    hand = _numeric_hand(solution, values, sources)
    surface, checks = surface_checks(solution, grasp, hand, sources)
    size = size_of(_drawing_bounds(solution, grasp) if surface is None else surface.bounds, grasp)
    placement = StatedPlacement(
        grasp.points, grasp.normals, size, hand, lambda body: BODIES.of(body)(body, sources), values
    )
    promise = PROMISE * (ON_MESH if solution.body["type"] == "mesh" else 1.0)
    unseen = UNSEEN if surface is None and solution.drawing is None else 1.0
    parts: dict[str, Callable[[], Iterable[ConstraintValue]]] = {
        f"constraint {i}, {data['type']}": partial(_constraint_rows, data, placement)
        for i, data in enumerate(solution.problem["constraints"])
    }
    if "edge_margin" in solution.problem:
        parts[EDGE_MARGIN] = partial(margin_rows, solution.problem, solution.faces, grasp, surface)
    if hand is not None:
        parts["hand"] = partial(hand.rows, placement)
    if hand is not None and not hand.has_links and "edge_margin" in solution.problem:
        parts[FITTING] = partial(fingertip_clearances, solution.body, surface, placement)
    if hand is not None and hand.has_links:
        parts["links"] = partial(link_rows, hand, surface, placement)
    owners = _owners(solution, len(grasp))
    rows = [
        _guard_check(name, given, partial(check_stated_constraints, stated=stated, promise=unseen * promise))
        for name, given in parts.items()
    ]
    if hand is not None and hand.has_links:
        rows.append(_guard_check("joints", hand.limits, partial(check_unstated_constraints, promise=promise)))
    checks += guard("joint torques", lambda: torque_checks(solution, grasp, hand))
    checks += guard("squeeze", lambda: squeeze_checks(solution, grasp, hand))
    checks += guard("room of joints", lambda: joint_margin_checks(solution, hand))
    checks += guard("gripper", lambda: gripper_checks(solution, placement, surface))
    checks += guard("links inside something", lambda: link_checks(solution, hand, surface, placement))
    checks += guard("phases", lambda: phase_checks(solution))
    checks += guard("approach", lambda: way_checks(solution, hand, surface, placement))
    checks += guard("local optimum", lambda: optimality_checks(solution, grasp, surface, size))
    checks += guard("drawing", lambda: _drawing_checks(solution, surface))
    slack = partial(_slack, stated=stated, scales=_scales(solution, grasp, unseen * size), promise=promise)
    return [*checks, face_check(solution), *rows, *_stated_check(solution, stated, owners, slack)]


def _numeric_hand(solution: GraspSolution, values: Mapping[str, float], sources: SourceFolders) -> HandNumbers | None:
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


def _drawing_bounds(solution: GraspSolution, grasp: Grasp) -> FloatArray:
    """Return the approximate bounding box of a missing body, (2, space), from its drawing or the contacts."""
    seen = grasp.points if solution.drawing is None else solution.drawing.body.vertices
    return np.stack([seen.min(axis=0), seen.max(axis=0)])


def _guard_check(
    name: str, rows: Callable[[], Iterable[ConstraintValue]], judge: Callable[[str, Iterable[ConstraintValue]], Check]
) -> Check:
    """Return the check of a comparison; invalid parts of a file fail."""
    try:
        return judge(name, _guard_each(rows))
    except NotCheckedError as reason:
        return Check.not_made(name, str(reason))
    except BROKEN as error:
        return Check(name, False, broken_data_message(error))


def _guard_each(rows: Callable[[], Iterable[ConstraintValue]]) -> Iterator[ConstraintValue]:
    """Yield the constraints; an error is raised at the first one."""
    yield from rows()


def _constraint_rows(data: Json, placement: StatedPlacement) -> Iterable[ConstraintValue]:
    return CONSTRAINTS.of(data)(data, placement)


def margin_rows(
    problem: Json, faces: tuple[str, ...], grasp: Grasp, surface: NumericBody | None
) -> Iterator[ConstraintValue]:
    """Yield the distance of each contact from its face's sharp edges, where the problem states a margin."""
    margin = number("edge_margin", problem["edge_margin"], at_least=0.0)
    if surface is None:
        raise NotCheckedError(NO_BODY)
    size = float(np.linalg.norm(surface.bounds[1] - surface.bounds[0])) / 2.0
    for i, (face, point) in enumerate(zip(faces, grasp.points, strict=True)):
        value = surface.edge_distance(face, point)
        if np.isfinite(value):
            yield ConstraintValue(f"{EDGE_MARGIN}, finger {i}", value, margin, scale=size)


def link_rows(hand: HandNumbers, surface: NumericBody | None, placement: StatedPlacement) -> Iterator[ConstraintValue]:
    """Yield the distance of each sphere of the hand from the held body, then the self-collision constraints."""
    balls = hand.balls(placement)
    if balls and surface is None:
        raise NotCheckedError(NO_BODY)
    if balls and surface is not None:
        distances = surface.distance(np.array([ball.centre for ball in balls]))
        for ball, value in zip(balls, distances.tolist(), strict=True):
            name = f"{CLEARANCE}, {ball.name}"
            yield ConstraintValue(name, value, ball.least, scale=placement.size, error=placement.error)
    yield from hand.apart()


def _drawing_checks(solution: GraspSolution, surface: NumericBody | None) -> list[Check]:
    drawing = solution.drawing
    return [] if drawing is None or surface is None else [drawing_check(drawing, surface)]


def drawing_check(drawing: Drawing, surface: NumericBody) -> Check:
    """Compare the bounding box of the drawn body with the body's own.

    Implicit bodies may be smaller than the box of their function, and so may bodies from outside the package that do
    not state ``tight``: their drawings have to be within the box.
    """
    low, high = surface.bounds
    space = len(low)
    size = float(np.linalg.norm(high - low)) / 2.0
    seen = drawing.body.vertices[:, :space]  # planar bodies are drawn as thin plates
    past = np.concatenate([low - seen.min(axis=0), seen.max(axis=0) - high])
    off = float(np.max(np.abs(past) if getattr(surface, "tight", False) else past))
    text = f"box around the drawn body {max(off, 0.0):.2g} m off the body's, allowed {LIKENESS * size:.2g} m"
    return Check("drawing", off <= LIKENESS * size, text)


def _stated_check(
    solution: GraspSolution,
    stated: StatedConstraints,
    owners: Mapping[str, Owner],
    slack: Callable[[ConstraintReport], float],
) -> list[Check]:
    """Return the checks that stated values keep the stated limits, and that every stated constraint has an owner."""
    if not solution.constraints:
        return []
    wrong = [f"{c.name} is outside its limits" for c in solution.constraints if not _is_within_slack(c, slack(c))]
    possible = [owners[part] for part in stated.unknown]
    unasked = [name for name in stated.unmatched if not any(owns(name) for owns in possible)]
    wrong += [f"{name} is nothing that the problem asks" for name in unasked]
    detail = f"{len(solution.constraints)} stated values"
    return [Check("constraints", not wrong, f"{detail}: {'; '.join(wrong)}" if wrong else detail)]


def _is_within_slack(row: ConstraintReport, slack: float) -> bool:
    return row.lower - slack <= row.value <= row.upper + slack


def _slack(row: ConstraintReport, stated: StatedConstraints, scales: ConstraintScales, promise: float) -> float:
    """Return the allowed violation of a constraint by a solve, in its own unit.

    Recomputed constraints have the scale of their formula, others that of their name.
    """
    known = stated.slack.get(id(row))
    return max((promise + ROUNDING) * scales.of(row.name), LEAST_SLACK) if known is None else known


@dataclass(frozen=True)
class ConstraintScales:
    """Scales of stated constraints by their names, for relative tolerances.

    Parameters
    ----------
    size : float
        The body's characteristic length, metres.
    span : float
        Reach of the hand from its palm, metres.
    obstacles : tuple of str
        Names of the problem's obstacles.
    """

    size: float
    span: float
    obstacles: tuple[str, ...] = ()

    def of(self, name: str) -> float:
        """Return the scale of a constraint, in its own unit: metres, square metres, or 1 for a cosine."""
        if name.startswith(SQUARED_SPANS):
            return self.span**2
        if name.startswith(f"{ON_FINGERTIP} "):
            return self.size if name.endswith(ON_TIP_LENGTHS) else 1.0
        lengths = (*LENGTHS, *(f"{obstacle}, " for obstacle in self.obstacles))
        return self.size if name.startswith(lengths) else 1.0


def _scales(solution: GraspSolution, grasp: Grasp, size: float) -> ConstraintScales:
    """Return the scales of constraints, as far as the file itself determines them."""
    pose, span = (solution.hand or {}).get("palm_pose"), size
    if pose is not None and grasp.space == 3:
        palm = array("hand.palm_pose.position", pose["position"], (3,))
        span = min(SPAN * float(np.max(np.linalg.norm(grasp.points - palm, axis=1))), WIDEST * size)
    asked = solution.problem["constraints"]
    return ConstraintScales(size, span, tuple(str(data["name"]) for data in asked if data["type"] == "obstacle"))


def _owners(solution: GraspSolution, contacts: int) -> dict[str, Owner]:
    """Return the owner predicate of each part of the problem, by the part's name."""
    constraints, hand = solution.problem["constraints"], solution.problem["hand"]
    found = {f"constraint {i}, {data['type']}": constraint_owner(data, contacts) for i, data in enumerate(constraints)}
    found[EDGE_MARGIN], found[FITTING] = margin_owner(contacts), clearance_owner(contacts)
    return found if hand is None else {**found, "hand": hand_owner(hand, contacts), "links": links_owner(contacts)}


def constraint_owner(data: Json, contacts: int) -> Owner:
    """Return the predicate of scalar constraints that a constraint may own; any for another package's."""
    kind = str(data["type"])
    if kind == "obstacle":
        return _named_with_prefix((f"{data['name']}, ",), contacts)
    if kind == "expression":
        elements = re.compile(re.escape(str(data["name"])) + r"(?:\[\d+\])?")
        return lambda row: elements.fullmatch(row) is not None
    return _named_with_prefix((CONSTRAINT_BEGINNINGS[kind],), contacts) if kind in CONSTRAINT_BEGINNINGS else anything


def hand_owner(data: Json, contacts: int) -> Owner:
    """Return the predicate of scalar constraints that a hand may own; any for another package's."""
    kind = str(data["type"])
    return _named_with_prefix(HAND_BEGINNINGS[kind], contacts) if kind in HAND_BEGINNINGS else anything


def links_owner(contacts: int) -> Owner:
    """Return the predicate of scalar constraints that the links of a hand may own."""
    return _named_with_prefix(LINKS, contacts)


def margin_owner(contacts: int) -> Owner:
    """Return the predicate of scalar constraints that the margin from sharp edges may own."""
    return _named_with_prefix((f"{EDGE_MARGIN}, ",), contacts)


def clearance_owner(contacts: int) -> Owner:
    """Return the predicate of scalar constraints that the clearance of fingertips may own."""
    return _named_with_prefix((f"{ROOM}, ",), contacts)


def anything(row: str) -> bool:
    """Return True: parts of other packages may own any scalar constraint."""
    return True


def _named_with_prefix(first: tuple[str, ...], contacts: int) -> Owner:
    """Return the predicate of names with such a beginning and existing contacts."""
    return lambda row: row.startswith(first) and all(int(i) < contacts for i in FINGER.findall(row))
