"""Checks of a parallel-jaw gripper: its pose against the contacts, and the clearance of its approach."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array, number
from nlpgrasp.errors import InputError
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.verify.check import NO_BODY, Check, NotCheckedError, is_complete_version
from nlpgrasp.verify.convex_solids import NumericSolid, solids_around, vectorised_distance
from nlpgrasp.verify.numeric_constraints import unit
from nlpgrasp.verify.stated_placement import NumericBody, StatedPlacement

UNIT = 1e-9  # tolerance of the unit length of a direction or quaternion
CLOSE = 1e-6  # tolerance relative to the body's size
TURNED = 1e-3  # radians: allowed angle beyond a cone, by the constraint's tolerance
STATIONS = 25  # initial samples of a line on the approach
APART = 2e-3  # metres: largest distance between two lines
WALK, FINE = 2e-4, 3e-5  # metres: finest sampling along pads or inside an obstacle, and elsewhere
STEEP, LEAST = 0.6, 1e-6  # fall of the distance on entry, as a share of these; least depth inside, metres
STEP = 2.5e-4  # metres: allowed difference of two samplings of a line
WAY = 2.0  # length of the approach path, in body sizes
DIRECTION = "hand.approach.direction"
LETTERS = "xyz"  # coordinate axes of the gripper's frame


def gripper_checks(solution: GraspSolution, placement: StatedPlacement, surface: NumericBody | None) -> list[Check]:
    """Return the checks of parallel jaws: ``hand.palm_pose``, ``opening`` and ``approach``, and its ``depth``.

    Parameters
    ----------
    solution : GraspSolution
    placement : StatedPlacement
        Contacts and hand.
    surface : NumericBody or None
        The body; None if missing.
    """
    asked, hand = solution.problem.get("hand") or {}, solution.hand or {}
    if asked.get("type") != "parallel_jaw":
        return []
    if "opening" not in hand:
        return (
            [Check("gripper", False, "the file states no pose of the gripper")] if is_complete_version(solution) else []
        )
    wrong = "; ".join([*_pose_errors(asked, hand, placement), *_cones(solution, hand, placement.points.shape[1])])
    checks = [Check("gripper", not wrong, wrong or f"opening {1e3 * hand['opening']:.4g} mm, pose of the contacts")]
    try:
        depth, through, rough = _approach_penetration(solution, asked, hand, placement, surface)
    except NotCheckedError as reason:
        return [*checks, Check.not_made("way in", str(reason))]
    off = STEP + rough
    stated, thin = number("hand.approach.depth", hand["approach"]["depth"]), hand["approach"].get("passes_through")
    same = abs(stated - depth) <= off
    told = f"leads {1e3 * stated:.3g} mm deep into what is beside it" if depth > off else "free"
    told = "passes through something thin" if thin else told
    wrong = f"stated to lead {1e3 * stated:.3g} mm deep into what is beside it, {1e3 * depth:.3g} mm found"
    checks.append(Check("way in", same, told if same else wrong))
    if not thin and depth <= off:
        told = "fingers or palm pass through something thin" if through else f"none of {1e3 * FINE:g} mm or more met"
        checks.append(Check("way in, thin things", not through, told))
    return checks


def _pose_errors(asked: Json, hand: Json, placement: StatedPlacement) -> Iterator[str]:
    """Yield the errors in opening, approach and pose."""
    (p, q), size, space = placement.points, placement.size, placement.points.shape[1]
    opening = float(np.linalg.norm(q - p))
    closing, approach = (q - p) / opening, array(DIRECTION, hand["approach"]["direction"], (space,))
    if not abs(hand["opening"] - opening) <= CLOSE * size:
        yield f"opening {hand['opening']:.6g} m stated, the contacts are {opening:.6g} m apart"
    if not abs(float(np.linalg.norm(approach)) - 1.0) <= UNIT:
        yield "the approach is no unit direction"
    if not abs(float(approach @ closing)) <= UNIT:
        yield "the approach is not at right angles to the closing line"
    if space == 2:
        return
    back = _finger_length(asked, "finger_length")
    position = array("hand.palm_pose.position", hand["palm_pose"]["position"], (3,))
    if not np.linalg.norm(position - ((p + q) / 2.0 - back * approach)) <= CLOSE * size:
        yield "the pose is not behind the middle between the contacts"
    quaternion = array("hand.palm_pose.quaternion_wxyz", hand["palm_pose"]["quaternion_wxyz"], (4,))
    if not abs(float(quaternion @ quaternion) - 1.0) <= UNIT:
        yield "the quaternion is not of unit length"
    own = [_read_axis(asked, key, letter) for key, letter in (("closing_axis", "x"), ("approach_axis", "z"))]
    if not abs(float(own[0] @ own[1])) <= UNIT:
        yield "the gripper's own axes are not at right angles"
    along, forward = (_rotated(quaternion, axis) for axis in own)
    if not (np.linalg.norm(along - closing) <= CLOSE and np.linalg.norm(forward - approach) <= CLOSE):
        names = [str(asked.get(key, letter)) for key, letter in (("closing_axis", "x"), ("approach_axis", "z"))]
        yield f"the pose has other axes than {names[0]} along the closing line and {names[1]} along the approach"


def _read_axis(asked: Json, key: str, letter: str) -> FloatArray:
    """Return a direction in the gripper's frame, (3,), from a signed letter or a unit direction."""
    stated = asked.get(key, letter)
    if not isinstance(stated, str):
        return unit(f"problem.hand.{key}", stated, 3)
    sign, name = (-1.0, stated[1:]) if stated.startswith("-") else (1.0, stated)
    if name not in tuple(LETTERS):
        raise InputError(f"problem.hand.{key}", stated, "x, y or z, with a sign")
    return np.array([sign * float(name == axis) for axis in LETTERS])


def _rotated(quaternion: FloatArray, direction: FloatArray) -> FloatArray:
    """Return a direction rotated by a quaternion, w first: ``v + 2 w (u x v) + 2 u x (u x v)``."""
    w, u = quaternion[0], quaternion[1:]
    across = np.cross(u, direction)
    return np.asarray(direction + 2.0 * w * across + 2.0 * np.cross(u, across))


def _cones(solution: GraspSolution, hand: Json, space: int) -> Iterator[str]:
    """Yield the cones of ``Approach`` that the approach violates."""
    for data in solution.problem["constraints"]:
        if data["type"] == "approach":
            approach = array(DIRECTION, hand["approach"]["direction"], (space,))
            along = float(approach @ unit("direction", data["direction"], space))
            off, angle = float(np.arccos(np.clip(along, -1.0, 1.0))), number("angle", data["angle"])
            if not off <= angle + TURNED:
                told = f"{np.degrees(off):.3g} degrees off a direction that allows {np.degrees(angle):.3g}"
                yield f"the approach is {told}"


def _approach_penetration(
    solution: GraspSolution, asked: Json, hand: Json, placement: StatedPlacement, surface: NumericBody | None
) -> tuple[float, bool, float]:
    """Return the approach's penetration of its surroundings, whether a line enters one steeply, and an error bound.

    Each line is halved where something may be in between: where the sum of both ends' distances is below its length.

    Returns
    -------
    depth : float
        Metres, at least zero; the required clearance of a table or an obstacle is included.
    through : bool
        Whether a line enters anything, however thin, other than along a pad.
    rough : float
        Largest difference of the solver's distances from these, metres.
    """
    if surface is None:
        raise NotCheckedError(NO_BODY)
    solids = [NumericSolid("", vectorised_distance(surface), rough=surface.rough)]
    solids += solids_around(solution.problem["constraints"], placement)
    starts, firsts, on_pads = _lines(asked, placement.points)
    thick = _finger_length(asked, "finger_thickness") > 0.0
    approach = array(DIRECTION, hand["approach"]["direction"], starts.shape[1:])

    def clear(line: NDArray[np.intp], along: FloatArray) -> FloatArray:
        points = starts[line] - along[:, None] * approach
        return np.asarray(np.min([solid.distance(points) - solid.clearance for solid in solids], axis=0))

    far = (
        _finger_length(asked, "finger_length")
        + WAY * float(np.linalg.norm(surface.bounds[1] - surface.bounds[0])) / 2.0
    )
    stations = np.linspace(firsts, far, STATIONS, axis=1)
    every = clear(np.repeat(np.arange(len(starts)), STATIONS), stations.ravel()).reshape(stations.shape)
    deepest, through = float(every.min()), False
    line: NDArray[np.intp] = np.repeat(np.arange(len(starts)), STATIONS - 1)
    low, high, near, beyond = (x.ravel() for x in (stations[:, :-1], stations[:, 1:], every[:, :-1], every[:, 1:]))
    while line.size:
        length = high - low
        close = length <= np.where(on_pads[line] | (np.maximum(near, beyond) <= 0.0), WALK, FINE)
        enters = close & (near > 0.0) & (beyond <= -LEAST) & (beyond - near < -STEEP * length)
        through = through or bool(np.any(enters & ~(thick & on_pads[line])))
        left = ~close & (near + beyond < length)
        line, (low, high, near, beyond) = line[left], (x[left] for x in (low, high, near, beyond))
        middle = 0.5 * (low + high)
        between = clear(line, middle)
        deepest = min(deepest, float(np.min(between, initial=np.inf)))
        line, low, high = np.tile(line, 2), np.append(low, middle), np.append(middle, high)
        near, beyond = np.append(near, between), np.append(between, beyond)
    return max(0.0, -deepest), through, max(solid.rough for solid in solids)


def _lines(asked: Json, points: FloatArray) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
    """Return lines of fingers and palm: their points at the pads (n, space), their starts, and which are on pads.

    A finger reaches from its contact outwards by its thickness; the palm, a finger's length behind, from one contact to
    the other.
    """
    opening, thickness = float(np.linalg.norm(points[1] - points[0])), _finger_length(asked, "finger_thickness")
    length, closing = _finger_length(asked, "finger_length"), (points[1] - points[0]) / opening
    outwards, between = (
        np.linspace(0.0, width, 1 + int(np.ceil(width / APART - UNIT))) for width in (thickness, opening)
    )
    palm = between[1:-1] if length > 0.0 else between[:0]
    places = np.concatenate([-outwards, opening + outwards, palm])
    firsts = np.where(np.arange(len(places)) < 2 * len(outwards), 0.0, length)
    return points[0] + places[:, None] * closing, firsts, (places == 0.0) | (places == opening)


def _finger_length(asked: Json, key: str) -> float:
    """Return a length of a finger, metres; 0 if not stated."""
    return number(key, asked.get(key, 0.0), at_least=0.0)
