"""Whether the pose of parallel jaws is that of their contacts, and the way in as free as the file says."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array, number
from nlpgrasp.errors import InputError
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.verify.bodies.fast import Distance, fast_distance
from nlpgrasp.verify.check import NO_BODY, Check, NotMadeError
from nlpgrasp.verify.constraints.obstacle import in_frame_of
from nlpgrasp.verify.constraints.regions import unit
from nlpgrasp.verify.hands.free import FreeHand
from nlpgrasp.verify.placement import Ball, StatedPlacement, Surface
from nlpgrasp.verify.registry import CONSTRAINTS
from nlpgrasp.verify.rows import RowValue

UNIT = 1e-9  # of a direction or a quaternion
CLOSE = 1e-6  # of the body's size
TURNED = 1e-3  # radians beyond a cone: what the tolerance of its row leaves
POINTS, PALM = 24, 5  # of a line on the way in; lines of the palm
WALK, STEEP, LEAST = 2e-4, 0.6, 2e-5  # metres of a step, share of it that is steep, metres that count as inside
WAY = 2.0  # of the body's size
DIRECTION = "hand.approach.direction"
LETTERS = "xyz"  # coordinate axes of the gripper's own frame


@dataclass(frozen=True)
class _Probes(FreeHand):
    """Points that stand for a hand's links."""

    points: Sequence[FloatArray] = ()

    def rows(self, placement: StatedPlacement) -> Sequence[RowValue]:
        """Return no rows: they are looked at, not asked."""
        return []

    def balls(self, placement: StatedPlacement) -> Sequence[Ball]:
        """Return a ball of no size about each point."""
        return [Ball(f"probe/{i}", point, 0.0, 0.0) for i, point in enumerate(self.points)]


def gripper_checks(solution: GraspSolution, placement: StatedPlacement, surface: Surface | None) -> list[Check]:
    """Return the check of ``hand.palm_pose``, ``opening`` and ``approach`` of parallel jaws, and that of its ``depth``.

    Parameters
    ----------
    solution : GraspSolution
    placement : StatedPlacement
        Contacts and hand.
    surface : Surface or None
        The body; None where it is not there.
    """
    asked, hand = solution.problem.get("hand") or {}, solution.hand or {}
    if asked.get("type") != "parallel_jaw":
        return []
    if "opening" not in hand:
        states = "link_tolerance" in solution.solver.get("options", {})  # as all do that this version writes
        return [Check("gripper", False, "the file states no pose of the gripper")] if states else []
    wrong = "; ".join([*_pose(asked, hand, placement), *_cones(solution, hand, placement.points.shape[1])])
    checks = [Check("gripper", not wrong, wrong or f"opening {1e3 * hand['opening']:.4g} mm, pose of the contacts")]
    try:
        depth = _depth(solution, asked, hand, placement, surface)
    except NotMadeError as reason:
        return [*checks, Check.not_made("way in", str(reason))]
    off = CLOSE * placement.size + (0.0 if surface is None else surface.rough)
    stated = number("hand.approach.depth", hand["approach"]["depth"])
    same = abs(stated - depth) <= off
    told = f"leads {1e3 * stated:.3g} mm deep into what is beside it" if depth > off else "free"
    told = "passes through something thin" if hand["approach"].get("passes_through") else told
    wrong = f"stated to lead {1e3 * stated:.3g} mm deep into what is beside it, {1e3 * depth:.3g} mm found"
    checks.append(Check("way in", same, told if same else wrong))
    if hand["approach"].get("passes_through") or depth > off:
        return checks
    try:
        through = _runs_into(solution, asked, hand, placement, surface)
    except NotMadeError as reason:
        return [*checks, Check.not_made("way in, thin things", str(reason))]
    told = "fingers or palm pass through something thin" if through else f"none in steps of {1e3 * WALK:g} mm"
    return [*checks, Check("way in, thin things", not through, told)]


def _pose(asked: Json, hand: Json, placement: StatedPlacement) -> Iterator[str]:
    """Yield what is wrong with opening, approach and pose."""
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
    back = number("finger_length", asked.get("finger_length", 0.0), at_least=0.0)
    position = array("hand.palm_pose.position", hand["palm_pose"]["position"], (3,))
    if not np.linalg.norm(position - ((p + q) / 2.0 - back * approach)) <= CLOSE * size:
        yield "the pose is not behind the middle between the contacts"
    quaternion = array("hand.palm_pose.quaternion_wxyz", hand["palm_pose"]["quaternion_wxyz"], (4,))
    if not abs(float(quaternion @ quaternion) - 1.0) <= UNIT:
        yield "the quaternion is not of unit length"
    own = [_own_axis(asked, key, letter) for key, letter in (("closing_axis", "x"), ("approach_axis", "z"))]
    if not abs(float(own[0] @ own[1])) <= UNIT:
        yield "the gripper's own axes are not at right angles"
    along, forward = (_rotated(quaternion, axis) for axis in own)
    if not (np.linalg.norm(along - closing) <= CLOSE and np.linalg.norm(forward - approach) <= CLOSE):
        names = [str(asked.get(key, letter)) for key, letter in (("closing_axis", "x"), ("approach_axis", "z"))]
        yield f"the pose has other axes than {names[0]} along the closing line and {names[1]} along the approach"


def _own_axis(asked: Json, key: str, letter: str) -> FloatArray:
    """Return a direction in the gripper's own frame, (3,): a letter with a sign, or a unit direction."""
    stated = asked.get(key, letter)
    if not isinstance(stated, str):
        return unit(f"problem.hand.{key}", stated, 3)
    sign, name = (-1.0, stated[1:]) if stated.startswith("-") else (1.0, stated)
    if name not in tuple(LETTERS):
        raise InputError(f"problem.hand.{key}", stated, "x, y or z, with a sign")
    return np.array([sign * float(name == axis) for axis in LETTERS])


def _rotated(quaternion: FloatArray, direction: FloatArray) -> FloatArray:
    """Return a direction turned by a quaternion, w first: ``v + 2 w (u x v) + 2 u x (u x v)``."""
    w, u = quaternion[0], quaternion[1:]
    across = np.cross(u, direction)
    return np.asarray(direction + 2.0 * w * across + 2.0 * np.cross(u, across))


def _cones(solution: GraspSolution, hand: Json, space: int) -> Iterator[str]:
    """Yield which cones of ``Approach`` the approach is not within."""
    for data in solution.problem["constraints"]:
        if data["type"] == "approach":
            approach = array(DIRECTION, hand["approach"]["direction"], (space,))
            along = float(approach @ unit("direction", data["direction"], space))
            off, angle = float(np.arccos(np.clip(along, -1.0, 1.0))), number("angle", data["angle"])
            if not off <= angle + TURNED:
                told = f"{np.degrees(off):.3g} degrees off a direction that allows {np.degrees(angle):.3g}"
                yield f"the approach is {told}"


def _depth(
    solution: GraspSolution, asked: Json, hand: Json, placement: StatedPlacement, surface: Surface | None
) -> float:
    """Return how deep the way in leads into body, tables and obstacles, metres; at least zero."""
    if surface is None:
        raise NotMadeError(NO_BODY)
    thickness = number("finger_thickness", asked.get("finger_thickness", 0.0), at_least=0.0)
    points = _way(asked, hand, placement, surface, thickness)
    values = [*surface.distance(points)]
    probed = replace(placement, hand=_Probes(asked, hand, placement.radii, points=list(points)))
    for data in solution.problem["constraints"]:
        try:
            rows = list(CONSTRAINTS.of(data)(data, probed))
        except NotMadeError:
            if data["type"] == "obstacle":
                raise
            continue  # an expression of a script's own, which speaks of no link
        values += [row.value - row.lower for row in rows if "probe/" in row.name and row.value is not None]
    return max(0.0, thickness / 2.0 - float(np.min(values)))


def _runs_into(
    solution: GraspSolution, asked: Json, hand: Json, placement: StatedPlacement, surface: Surface | None
) -> bool:
    """Return whether a line of fingers or palm enters body, table or obstacle steeply on its way from the pads out."""
    if surface is None:
        raise NotMadeError(NO_BODY)
    p, q = placement.points
    closing, approach = (q - p) / np.linalg.norm(q - p), array(DIRECTION, hand["approach"]["direction"], p.shape)
    thickness = number("finger_thickness", asked.get("finger_thickness", 0.0), at_least=0.0)
    length = number("finger_length", asked.get("finger_length", 0.0), at_least=0.0)
    far = length + WAY * float(np.linalg.norm(surface.bounds[1] - surface.bounds[0])) / 2.0
    one, other = p - closing * thickness / 2.0, q + closing * thickness / 2.0
    starts = [(one, 0.0), (other, 0.0)]
    starts += [(one + s * (other - one), length) for s in np.linspace(0.0, 1.0, PALM)] if length > 0.0 else []
    distances = [fast_distance(surface)]
    for data in solution.problem["constraints"]:
        if data["type"] == "table":
            floor = number("height", data["height"]) + number("clearance", data["clearance"], at_least=0.0)
            distances.append(partial(_above, floor))
        elif data["type"] == "obstacle":
            away = number("clearance", data["clearance"], at_least=0.0)
            distances.append(partial(_off, data, fast_distance(placement.surface_of(data["body"])), away))
    for start, first in starts:
        walk = start - np.arange(first, far, WALK)[:, None] * approach
        clear = np.min([distance(walk) for distance in distances], axis=0) - thickness / 2.0
        if np.any((clear[:-1] > 0.0) & (clear[1:] <= -LEAST) & (np.diff(clear) < -STEEP * WALK)):
            return True
    return False


def _above(floor: float, points: FloatArray) -> FloatArray:
    """Return how far points (m, space) are above a height along the last axis, metres."""
    return np.asarray(points[:, -1] - floor)


def _off(data: Json, distance: Distance, clearance: float, points: FloatArray) -> FloatArray:
    """Return the distance of points (m, space) from an obstacle, less its clearance, metres."""
    return np.asarray(distance(in_frame_of(data, points)) - clearance)


def _way(asked: Json, hand: Json, placement: StatedPlacement, surface: Surface, thickness: float) -> FloatArray:
    """Return the points (n, space) of fingers and palm on their way in."""
    p, q = placement.points
    closing, approach = (q - p) / np.linalg.norm(q - p), array(DIRECTION, hand["approach"]["direction"], p.shape)
    length = number("finger_length", asked.get("finger_length", 0.0), at_least=0.0)
    far = WAY * float(np.linalg.norm(surface.bounds[1] - surface.bounds[0])) / 2.0
    one, other = p - closing * thickness / 2.0, q + closing * thickness / 2.0
    points = [end - t * approach for end in (one, other) for t in np.linspace(0.0, length + far, POINTS)]
    if length > 0.0:
        across = [one + share * (other - one) for share in np.linspace(0.0, 1.0, PALM)]
        points += [end - t * approach for end in across for t in np.linspace(length, length + far, POINTS)]
    return np.array(points)
