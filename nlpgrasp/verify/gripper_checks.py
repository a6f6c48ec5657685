"""Checks of a parallel-jaw gripper: its pose relative to the contacts, and its straight approach."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import BoolArray, FloatArray, IntArray, array, number
from nlpgrasp.errors import InputError
from nlpgrasp.solution.obstructions import BODY, TOLERANCE, jaws_depth
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.verify.check import Check, NotCheckedError, guard, states_all_hand_fields
from nlpgrasp.verify.convex_solids import NumericSolid, solids_around, vectorised_distance
from nlpgrasp.verify.gripper_solids import pad_checks, solid_checks
from nlpgrasp.verify.numeric_constraints import unit
from nlpgrasp.verify.stated_placement import NumericBody, StatedPlacement, require_body

UNIT = 1e-9  # tolerance of the unit length of a direction or quaternion
POSE_TOLERANCE = 1e-6  # tolerance of lengths of the pose, relative to the body's size
CONE_TOLERANCE = 1e-3  # radians: allowed angle beyond a cone, by the constraint's tolerance
INITIAL_STATIONS = 25  # initial samples of a line on the approach
LINE_DISTANCE = 2e-3  # metres: largest distance between two lines
COARSE_STEP = 2e-4  # metres: finest sampling along pads or inside an obstacle
FINE_STEP = 3e-5  # metres: finest sampling elsewhere
ENTRY_SLOPE = 0.6  # least fall of the distance on entry, as a share of the sampling step
ENTRY_DEPTH = 1e-6  # metres: least depth inside a solid on entry
DEPTH_TOLERANCE = 2.5e-4  # metres: allowed difference of two samplings of a line
PATH_SIZES = 2.0  # length of the approach path, in body sizes
DIRECTION = "hand.approach.direction"  # field of the solution file
LETTERS = "xyz"  # coordinate axes of the gripper's frame


def gripper_checks(solution: GraspSolution, placement: StatedPlacement, surface: NumericBody | None) -> list[Check]:
    """Return the checks of a parallel-jaw gripper's pose, opening and approach.

    Parameters
    ----------
    solution : GraspSolution
    placement : StatedPlacement
        Contacts and hand.
    surface : NumericBody or None
        The body; None if missing.
    """
    problem_hand, hand = solution.problem.get("hand") or {}, solution.hand or {}
    if problem_hand.get("type") != "parallel_jaw":
        return []
    if "opening" not in hand:
        return (
            [Check("gripper", False, "the file states no pose of the gripper")]
            if states_all_hand_fields(solution)
            else []
        )
    errors = [*_pose_errors(problem_hand, hand, placement), *_cone_errors(solution, hand, placement.points.shape[1])]
    checks = [Check.of_errors("gripper", errors, f"opening {1e3 * hand['opening']:.4g} mm, pose of the contacts")]
    if placement.points.shape[1] == 3 and any(problem_hand.get(key) is not None for key in ("pad", "finger")):
        return [*checks, *guard("way in", lambda: _checks_of_solids(solution, placement, surface))]
    if placement.points.shape[1] == 3:
        checks += guard("pads", lambda: _checks_of_pads(solution, placement, surface))
    try:
        depth, enters_steeply, rough, blocking = _approach_penetration(solution, problem_hand, hand, placement, surface)
    except NotCheckedError as reason:
        return [*checks, Check.not_made("way in", str(reason))]
    tolerance = DEPTH_TOLERANCE + rough
    stated_depth = number("hand.approach.depth", hand["approach"]["depth"])
    passes_through = hand["approach"].get("passes_through")
    agrees = abs(stated_depth - depth) <= tolerance
    summary = f"leads {1e3 * stated_depth:.3g} mm deep into what is beside it" if depth > tolerance else "free"
    summary = "passes through something thin" if passes_through else summary
    error = f"stated to lead {1e3 * stated_depth:.3g} mm deep into what is beside it, {1e3 * depth:.3g} mm found"
    checks.append(Check("way in", agrees, summary if agrees else error))
    if agrees and jaws_depth(hand):
        errors = list(_blocking_errors(hand["approach"].get("blocked_by"), blocking, tolerance))
        is_stated = "blocked_by" in hand["approach"] or states_all_hand_fields(solution)
        summary = ", ".join(f"{name} by {1e3 * value:.3g} mm" for name, value in blocking.items())
        checks.append(Check.of_errors("way in, what blocks it", errors if is_stated else [], summary))
    if not passes_through and depth <= tolerance:
        summary = (
            "fingers or palm pass through something thin"
            if enters_steeply
            else f"none of {1e3 * FINE_STEP:g} mm or more met"
        )
        checks.append(Check("way in, thin things", not enters_steeply, summary))
    return checks


def _checks_of_solids(solution: GraspSolution, placement: StatedPlacement, surface: NumericBody | None) -> list[Check]:
    """Return the checks of a gripper whose finger or pad sizes are known."""
    try:
        return solid_checks(solution, placement, surface)
    except NotCheckedError as reason:
        return [Check.not_made(name, str(reason)) for name in ("way in", "pads")]


def _checks_of_pads(solution: GraspSolution, placement: StatedPlacement, surface: NumericBody | None) -> list[Check]:
    """Return the check of plane and line contacts of a gripper without stated sizes."""
    try:
        return pad_checks(solution, placement, surface)
    except NotCheckedError as reason:
        return [Check.not_made("pads", str(reason))]


def _pose_errors(problem_hand: Json, hand: Json, placement: StatedPlacement) -> Iterator[str]:
    """Yield errors in the gripper's opening, approach direction and pose."""
    (p, q), size, space = placement.points, placement.size, placement.points.shape[1]
    opening = float(np.linalg.norm(q - p))
    closing, approach = (q - p) / opening, array(DIRECTION, hand["approach"]["direction"], (space,))
    if not abs(hand["opening"] - opening) <= POSE_TOLERANCE * size:
        yield f"opening {hand['opening']:.6g} m stated, the contacts are {opening:.6g} m apart"
    if not abs(float(np.linalg.norm(approach)) - 1.0) <= UNIT:
        yield "the approach is no unit direction"
    if not abs(float(approach @ closing)) <= UNIT:
        yield "the approach is not at right angles to the closing line"
    if space == 2:
        return
    position = array("hand.palm_pose.position", hand["palm_pose"]["position"], (3,))
    quaternion = array("hand.palm_pose.quaternion_wxyz", hand["palm_pose"]["quaternion_wxyz"], (4,))
    if not abs(float(quaternion @ quaternion) - 1.0) <= UNIT:
        yield "the quaternion is not of unit length"
    gripper_axes = [
        _read_axis(problem_hand, key, letter) for key, letter in (("closing_axis", "x"), ("approach_axis", "z"))
    ]
    tcp = _finger_length(problem_hand, "finger_length") * gripper_axes[1]
    if problem_hand.get("tcp") is not None:
        tcp = array("problem.hand.tcp", problem_hand["tcp"], (3,))
    if not np.linalg.norm(position + _rotate(quaternion, tcp) - (p + q) / 2.0) <= POSE_TOLERANCE * size:
        yield "the pose's tool centre point is not the middle between the contacts"
    if not abs(float(gripper_axes[0] @ gripper_axes[1])) <= UNIT:
        yield "the gripper's own axes are not at right angles"
    if hand["approach"].get("flip"):  # the jaws are exchanged
        closing = -closing
    rotated_closing, rotated_approach = (_rotate(quaternion, axis) for axis in gripper_axes)
    if not (
        np.linalg.norm(rotated_closing - closing) <= POSE_TOLERANCE
        and np.linalg.norm(rotated_approach - approach) <= POSE_TOLERANCE
    ):
        names = [str(problem_hand.get(key, letter)) for key, letter in (("closing_axis", "x"), ("approach_axis", "z"))]
        yield f"the pose has other axes than {names[0]} along the closing line and {names[1]} along the approach"


def _read_axis(problem_hand: Json, key: str, letter: str) -> FloatArray:
    """Return an axis of the gripper's frame, (3,), given as a signed letter or a unit vector."""
    stated = problem_hand.get(key, letter)
    if not isinstance(stated, str):
        return unit(f"problem.hand.{key}", stated, 3)
    sign, name = (-1.0, stated[1:]) if stated.startswith("-") else (1.0, stated)
    if name not in tuple(LETTERS):
        raise InputError(f"problem.hand.{key}", stated, "x, y or z, with a sign")
    return np.array([sign * float(name == axis) for axis in LETTERS])


def _rotate(quaternion: FloatArray, direction: FloatArray) -> FloatArray:
    """Return a vector rotated by a unit quaternion, w first.

    ``v + 2 w (u x v) + 2 u x (u x v)``.
    """
    w, u = quaternion[0], quaternion[1:]
    across = np.cross(u, direction)
    return np.asarray(direction + 2.0 * w * across + 2.0 * np.cross(u, across))


def _cone_errors(solution: GraspSolution, hand: Json, space: int) -> Iterator[str]:
    """Yield an error for each ``Approach`` constraint that the approach direction violates."""
    for data in solution.problem["constraints"]:
        if data["type"] == "approach":
            approach = array(DIRECTION, hand["approach"]["direction"], (space,))
            cosine = float(approach @ unit("direction", data["direction"], space))
            deviation, angle = float(np.arccos(np.clip(cosine, -1.0, 1.0))), number("angle", data["angle"])
            if not deviation <= angle + CONE_TOLERANCE:
                message = f"{np.degrees(deviation):.3g} degrees off a direction that allows {np.degrees(angle):.3g}"
                yield f"the approach is {message}"


def _approach_penetration(
    solution: GraspSolution, problem_hand: Json, hand: Json, placement: StatedPlacement, surface: NumericBody | None
) -> tuple[float, bool, float, dict[str, float]]:
    """Return how deep the gripper penetrates solids on its approach, and which solids block it.

    Returns
    -------
    depth : float
        Metres, at least zero; the required clearance of a table or an obstacle is included.
    enters_steeply : bool
        Whether a line enters anything, however thin, other than along a pad.
    rough : float
        Largest difference of the solver's distances from these, metres.
    blocking : dict of str to float
        Penetration of each solid, metres, by name, where it is not free.
    """
    body = require_body(surface)
    solids = [NumericSolid(BODY, vectorised_distance(body), rough=body.rough)]
    solids += solids_around(solution.problem["constraints"], placement)
    starts, offsets, on_pads = _finger_and_palm_lines(problem_hand, placement.points)
    approach = array(DIRECTION, hand["approach"]["direction"], starts.shape[1:])

    def clearance(solids: Sequence[NumericSolid], line: IntArray, coordinate: FloatArray) -> FloatArray:
        points = starts[line] - coordinate[:, None] * approach
        return np.asarray(np.min([solid.distance(points) - solid.clearance for solid in solids], axis=0))

    length = PATH_SIZES * float(np.linalg.norm(body.bounds[1] - body.bounds[0])) / 2.0
    stations = np.linspace(offsets, _finger_length(problem_hand, "finger_length") + length, INITIAL_STATIONS, axis=1)
    is_thick = _finger_length(problem_hand, "finger_thickness") > 0.0
    least, enters_steeply = _least_clearance(partial(clearance, solids), stations, on_pads, is_thick)
    rough = max(solid.rough for solid in solids)
    blocking = dict[str, float]()
    for solid in solids if least < -TOLERANCE else ():
        depth = -_least_clearance(partial(clearance, [solid]), stations, on_pads, is_thick)[0]
        blocking[solid.name] = max(depth, blocking.get(solid.name, 0.0))
    return max(0.0, -least), enters_steeply, rough, {name: d for name, d in blocking.items() if d > 0.0}


def _blocking_errors(stated: Json | None, recomputed: Mapping[str, float], tolerance: float) -> Iterator[str]:
    """Yield errors in the stored penetration depths of the approach into solids that block it."""
    for name, depth in (stated or {}).items():
        if not abs(number(f"hand.approach.blocked_by.{name}", depth) - recomputed.get(name, 0.0)) <= tolerance:
            yield f"{1e3 * depth:.3g} mm into {name} stated, {1e3 * recomputed.get(name, 0.0):.3g} mm found"
    for name, depth in recomputed.items():
        if depth > TOLERANCE + tolerance and name not in (stated or {}):
            yield f"{1e3 * depth:.3g} mm into {name} found, not stated"


def _least_clearance(
    clearance: Callable[[IntArray, FloatArray], FloatArray],
    stations: FloatArray,
    on_pads: BoolArray,
    is_thick: bool,
) -> tuple[float, bool]:
    """Return the least clearance (metres) over several lines, and whether one of them runs steeply into a solid.

    The line along a pad of a thick finger may run steeply into it.

    Each segment is halved where a solid may lie in between: where the sum of both ends' clearances is below its length.

    Parameters
    ----------
    clearance : callable
        Indices of lines (m,) and coordinates along them (m,), metres, to clearances (m,).
    stations : (n, s) array
        Initial coordinates along each line, metres.
    on_pads : (n,) array of bool
        Whether a line begins on a pad.
    is_thick : bool
        Whether the fingers have a thickness.
    """
    lines, count = stations.shape
    values = clearance(np.repeat(np.arange(lines), count), stations.ravel()).reshape(stations.shape)
    least, enters_steeply = float(values.min()), False
    line: IntArray = np.repeat(np.arange(lines), count - 1)
    low, high, start, end = (x.ravel() for x in (stations[:, :-1], stations[:, 1:], values[:, :-1], values[:, 1:]))
    while line.size:
        length = high - low
        is_finest = length <= np.where(on_pads[line] | (np.maximum(start, end) <= 0.0), COARSE_STEP, FINE_STEP)
        enters = is_finest & (start > 0.0) & (end <= -ENTRY_DEPTH) & (end - start < -ENTRY_SLOPE * length)
        enters_steeply = enters_steeply or bool(np.any(enters & ~(is_thick & on_pads[line])))
        unresolved = ~is_finest & (start + end < length)
        line, (low, high, start, end) = line[unresolved], (x[unresolved] for x in (low, high, start, end))
        middle = 0.5 * (low + high)
        value = clearance(line, middle)
        least = min(least, float(np.min(value, initial=np.inf)))
        line, low, high = np.tile(line, 2), np.append(low, middle), np.append(middle, high)
        start, end = np.append(start, value), np.append(value, end)
    return least, enters_steeply


def _finger_and_palm_lines(problem_hand: Json, points: FloatArray) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return the lines along which points of fingers and palm approach.

    Their points at the pads (n, space), the distance at which each line starts, and whether it starts on a pad.

    A finger reaches from its contact outwards by its thickness; the palm, a finger's length behind, from one contact to
    the other.
    """
    opening, thickness = float(np.linalg.norm(points[1] - points[0])), _finger_length(problem_hand, "finger_thickness")
    length, closing = _finger_length(problem_hand, "finger_length"), (points[1] - points[0]) / opening
    finger_coordinates, palm_coordinates = (
        np.linspace(0.0, width, 1 + int(np.ceil(width / LINE_DISTANCE - UNIT))) for width in (thickness, opening)
    )
    inner_palm = palm_coordinates[1:-1] if length > 0.0 else palm_coordinates[:0]
    coordinates = np.concatenate([-finger_coordinates, opening + finger_coordinates, inner_palm])
    start_offsets = np.where(np.arange(len(coordinates)) < 2 * len(finger_coordinates), 0.0, length)
    return points[0] + coordinates[:, None] * closing, start_offsets, (coordinates == 0.0) | (coordinates == opening)


def _finger_length(problem_hand: Json, key: str) -> float:
    """Return a length of a finger, metres; 0 if the file has none."""
    return number(key, problem_hand.get(key, 0.0), at_least=0.0)
