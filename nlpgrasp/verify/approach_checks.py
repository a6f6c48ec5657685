"""Checks of a hand's motion: its phases, its straight approach and its straight lift.

Links are represented by samples of their collision shapes, with this package's own kinematics and distances. Paths are
sampled every two millimetres; how deep links are in the body is the matter of ``link_checks``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from nlpgrasp.common.spatial import tangents
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array, number
from nlpgrasp.solution.phase_record import APPROACH, GRASP, LIFT, PREGRASP, SQUEEZE, Phase
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.verify.check import Check, NotCheckedError, states_all_hand_fields
from nlpgrasp.verify.convex_solids import NumericSolid, held_and_around
from nlpgrasp.verify.link_checks import link_samples
from nlpgrasp.verify.numeric_constraints import unit
from nlpgrasp.verify.numeric_urdf_hand import NumericLinkedHand, require_links
from nlpgrasp.verify.stated_placement import NumericBody, NumericHand, StatedPlacement, require_body

POSITION_TOLERANCE = 1e-9  # metres, radians: rounding tolerance of sums
SAMPLE_STEP = 2e-3  # metres between samples
CLEARANCE_EXCESS = 2e-4  # metres: allowed excess of a stated clearance, which is rounded to a tenth of a millimetre
PENETRATION_SHARE = 1e-3  # share of the hand's span: allowed penetration of a link in the surroundings
SIDES = 28  # normals on each ring of the patch of a fingertip of type hull
RETREAT_TOLERANCE = 1e-5  # metres: tolerance of the distance by which fingertips go back
GRID_POINTS = 24  # sample points in the body along each side of its box


def phase_checks(solution: GraspSolution) -> list[Check]:
    """Return the checks that the phases of the hand's motion are consistent and that the file has an approach."""
    phases, posture = {phase.name: phase for phase in solution.phases}, solution.hand or {}
    checks = []
    if phases:
        errors = [*_phase_errors(posture, phases), *_squeeze_and_lift_errors(solution, phases)]
        checks.append(Check.of_errors("phases", errors, ", ".join(phases)))
    if (solution.problem.get("hand") or {}).get("type") == "urdf" and states_all_hand_fields(solution):
        error, summary = _approach_error(posture, phases)
        checks.append(Check.of_errors("way in", [error], summary))
    return checks


def _approach_error(posture: Json, phases: dict[str, Phase]) -> tuple[str, str]:
    """Return an error text about the stored approach, empty if the approach is valid, and a summary."""
    approach = posture.get("approach")
    if approach is None:
        return "the file does not state hand.approach", ""
    if approach.get("direction") is not None:
        return ("" if phases else "hand.approach states a direction, and the file no phases of the hand"), "free"
    reason = str(approach.get("reason") or "").strip()
    return ("" if reason else "hand.approach states neither a direction nor the reason why none is free"), reason


def _phase_errors(posture: Json, phases: dict[str, Phase]) -> Iterator[str]:
    """Yield the errors in the palm poses and joint positions of the phases."""
    if GRASP not in phases:
        yield "no grasp among the phases"
        return
    grasp, stated_grasp = phases[GRASP], Phase.of(GRASP, posture)
    unit("hand.phases.quaternion_wxyz", grasp.palm_quaternion, 4)
    if not (_is_close(grasp.palm_position, stated_grasp.palm_position) and _has_equal_joints(grasp, stated_grasp)):
        yield "the grasp's palm or joints are not those of the hand"
    for phase in (stated_grasp, *phases.values()):
        if not _is_close(phase.palm_quaternion, grasp.palm_quaternion):
            yield f"the palm turns: {phase.name}"
    if APPROACH in phases:
        if PREGRASP not in phases or not _has_equal_joints(phases[APPROACH], phases[PREGRASP]):
            yield "the joints of the approach are not those of the pregrasp"
            return
        approach = posture["approach"]
        direction = unit("hand.approach.direction", approach["direction"], 3)
        start = phases[PREGRASP].palm_position - approach["distance"] * direction
        if not _is_close(phases[APPROACH].palm_position, start):
            yield "the approach does not begin its distance before the pregrasp"
    elif (posture.get("approach") or {}).get("direction") is not None:
        yield "a direction of the approach without its keyframe"


def _squeeze_and_lift_errors(solution: GraspSolution, phases: dict[str, Phase]) -> Iterator[str]:
    """Yield the errors in the squeeze phase and the lift phase."""
    grasp, squeezed, lift = phases.get(GRASP), phases.get(SQUEEZE), phases.get(LIFT)
    if grasp is None or (squeezed is None and lift is None):
        return
    if squeezed is None or solution.squeeze is None:
        yield "a lift or squeeze without forces of hand.squeeze"
        return
    commanded = {**grasp.joints, **solution.squeeze.positions()}
    squeezed_joints = ((solution.hand or {})["squeeze"]).get("torques", {})
    if any(
        abs(squeezed.joints[joint] - commanded[joint]) > POSITION_TOLERANCE * max(1.0, abs(commanded[joint]))
        for joint in squeezed_joints
    ):
        yield "the squeeze's joints are not those commanded"
    if not _is_close(squeezed.palm_position, grasp.palm_position):
        yield "the palm moves in the squeeze"
    if lift is not None:
        stated_lift = (solution.hand or {})["lift"]
        raised = grasp.palm_position + stated_lift["distance"] * unit(
            "hand.lift.direction", stated_lift["direction"], 3
        )
        if not (_has_equal_joints(lift, squeezed) and _is_close(lift.palm_position, raised)):
            yield "the lift is not the squeeze raised by its distance"


def _is_close(a: FloatArray, b: FloatArray) -> bool:
    """Return whether two arrays are equal up to rounding."""
    return bool(np.max(np.abs(a - b)) <= POSITION_TOLERANCE)


def _has_equal_joints(a: Phase, b: Phase) -> bool:
    """Return whether two phases have the same joint positions, up to rounding."""
    return a.joints.keys() == b.joints.keys() and all(
        abs(a.joints[j] - b.joints[j]) <= POSITION_TOLERANCE for j in a.joints
    )


def pregrasp_checks(solution: GraspSolution, hand: NumericHand | None) -> list[Check]:
    """Return the check that every fingertip of the pregrasp has gone back along its normal by the stated clearance."""
    stated = (solution.hand or {}).get("pregrasp")
    if stated is None:
        is_phase = any(phase.name == PREGRASP for phase in solution.phases)
        is_due = is_phase and states_all_hand_fields(solution)
        return [Check("pregrasp", False, "among the phases, and not stated by the hand")] if is_due else []
    try:
        errors = list(_pregrasp_errors(solution, stated, require_links(hand, "links")))
    except NotCheckedError as reason:
        return [Check.not_made("pregrasp", str(reason))]
    return [Check.of_errors("pregrasp", errors, f"{1e3 * stated['clearance']:.3g} mm back along the normals")]


def _pregrasp_errors(solution: GraspSolution, stated: Json, hand: NumericLinkedHand) -> Iterator[str]:
    """Yield errors in the clearance of the pregrasp, its palm and its fingertips."""
    clearance = number("hand.pregrasp.clearance", stated["clearance"], at_least=0.0)
    requested = solution.solver.get("options", {}).get("pregrasp_clearance", clearance)
    if clearance > requested:
        yield f"a clearance of {clearance:g} m stated, {requested:g} m asked for"
    opened, normals = hand.with_posture(stated), solution.require_grasp().normals
    if list(stated.get("fingertips", ())) != [tip["link"] for tip in hand.tips]:
        yield "other fingertips than the hand's"
    if not _is_close(opened.base[:3, :3], hand.base[:3, :3]):
        yield "the palm turns"
    for i, (tip, normal) in enumerate(zip(hand.tips, normals, strict=True)):
        places = [_reference_point(tip, posture.poses[str(tip["link"])]) for posture in (hand, opened)]
        distance = float((places[0] - places[1]) @ normal)
        if not abs(distance - clearance) <= RETREAT_TOLERANCE + hand.error:
            yield f"fingertip {i} has gone back by {distance:.6f} m, stated {clearance:.6f} m"


def _reference_point(tip: Json, frame: FloatArray) -> FloatArray:
    """Return the point of a fingertip that goes back along the normal, (3,), body frame."""
    keys = {"cylinder": ("start", "end"), "capsule": ("end",), "hull": ()}.get(str(tip["type"]), ("offset",))
    point = np.mean([array(key, tip[key], (3,)) for key in keys], axis=0) if keys else _ball_of_hull(tip)
    return np.asarray(frame[:3, :3] @ point + frame[:3, 3])


def _ball_of_hull(tip: Json) -> FloatArray:
    """Return the centre of the ball whose support function is nearest to a hull's over the normals of its patch."""
    corners, facing = array("points", tip["points"], (None, 3)), unit("facing", tip["facing"], 3)
    widest = number("angle", tip["angle"])
    polar = np.linspace(0.0, widest, max(2, round(SIDES * widest / (2.0 * np.pi))) + 1)[:, None, None]
    turn = 2.0 * np.pi * np.arange(SIDES)[:, None] / SIDES
    across = tangents(facing[None])[0]
    ring = np.cos(turn) * across[0] + np.sin(turn) * across[1]
    normals = (np.cos(polar) * facing + np.sin(polar) * ring).reshape(-1, 3)
    heights = np.max(normals @ corners.T, axis=1)
    return np.asarray(np.linalg.lstsq(np.column_stack([normals, np.ones(len(normals))]), heights, rcond=None)[0][:3])


def path_checks(
    solution: GraspSolution, hand: NumericHand | None, surface: NumericBody | None, placement: StatedPlacement
) -> list[Check]:
    """Return the checks of the stored clearance on the approach and of the stored lift distance.

    Parameters
    ----------
    solution : GraspSolution
    hand : NumericHand or None
    surface : NumericBody or None
        The body; None if missing.
    placement : StatedPlacement
        Reader of obstacles.
    """
    phases, lift = {phase.name: phase for phase in solution.phases}, (solution.hand or {}).get("lift")
    stated: dict[str, Callable[[_StraightPaths], Iterator[str]]] = {}
    if APPROACH in phases and PREGRASP in phases:
        stated["approach"] = lambda paths: paths.approach(phases[APPROACH], phases[PREGRASP])
    if lift is not None:
        stated["lift"] = lambda paths: paths.lift(lift)
    if not stated:
        return []
    try:
        paths = _StraightPaths.of(solution, hand, surface, placement)
        errors = {name: list(find_errors(paths)) for name, find_errors in stated.items()}
    except NotCheckedError as reason:
        return [Check.not_made(name, str(reason)) for name in stated]
    return [
        Check.of_errors(name, path_errors, f"looked at every {1e3 * SAMPLE_STEP:g} mm")
        for name, path_errors in errors.items()
    ]


@dataclass(frozen=True)
class _StraightPaths:
    """Straight approach of a hand, and straight lift of the hand with the held body.

    Parameters
    ----------
    hand : NumericLinkedHand
    body : NumericSolid
    bounds : (2, 3) array
        The body's bounding box, metres.
    around : sequence of NumericSolid
        Tables and obstacles.
    """

    hand: NumericLinkedHand
    body: NumericSolid
    bounds: FloatArray
    around: Sequence[NumericSolid]

    @classmethod
    def of(
        cls, solution: GraspSolution, hand: NumericHand | None, surface: NumericBody | None, placement: StatedPlacement
    ) -> _StraightPaths:
        """Return the paths of a solution; raise ``NotCheckedError`` if data are missing."""
        linked_hand = require_links(hand, "links")
        held, around = held_and_around(solution, surface, placement)
        return cls(linked_hand, held, require_body(surface).bounds, around)

    @property
    def allowed_depth(self) -> float:
        """Allowed penetration of a link in the surroundings, metres."""
        return PENETRATION_SHARE * self.hand.span + self.hand.error

    def approach(self, start: Phase, pregrasp: Phase) -> Iterator[str]:
        """Yield errors of the approach: a link in a solid, or a stored clearance above the recomputed one."""
        points, radii = _link_points(self.hand.with_posture(pregrasp.to_dict()))
        if not len(radii):
            raise NotCheckedError("the hand's links have no shapes and its fingertips are flat")
        displacement = start.palm_position - pregrasp.palm_position
        least = np.inf
        for solid in (self.body, *self.around):
            clearance = _least_clearance(solid, points, radii, displacement)
            least = min(least, clearance)
            if solid is not self.body and not -clearance <= self.allowed_depth:
                yield f"a link is {-1e3 * clearance:.3g} mm deep in {solid.name} on the way"
        if pregrasp.clearance is None or not pregrasp.clearance <= least + CLEARANCE_EXCESS + self.hand.error:
            yield f"clearance {pregrasp.clearance} m stated, {least:.6f} m found"

    def lift(self, stated: Json) -> Iterator[str]:
        """Yield the solids that hand or body run into on the stored lift.

        A solid that is too near in the grasp may stay as near.

        Parameters
        ----------
        stated : mapping
            ``direction`` and ``distance``.
        """
        direction = unit("hand.lift.direction", stated["direction"], 3)
        distance = number("hand.lift.distance", stated["distance"], at_least=0.0)
        points, radii = _link_points(self.hand)
        body = self._points_in_body()
        points, radii = np.concatenate([points, body]), np.concatenate([radii, np.zeros(len(body))])
        for solid in self.around:
            clearances = solid.distance(points) - radii - solid.clearance
            lifted, allowed = 0.0, np.minimum(clearances, 0.0) - self.allowed_depth - solid.rough
            while lifted < distance and np.all(clearances >= allowed):
                step = min(SAMPLE_STEP, distance - lifted)
                lifted, clearances = lifted + step, clearances - step  # no point comes nearer by more than it moves
                near = clearances < allowed + SAMPLE_STEP
                clearances[near] = solid.distance(points[near] + lifted * direction) - radii[near] - solid.clearance
            if not np.all(clearances >= allowed):
                obstruction = f"{solid.name} is in the way at {1e3 * lifted:.4g} mm"
                yield f"a lift by {1e3 * distance:.4g} mm is stated, {obstruction}"

    def _points_in_body(self) -> FloatArray:
        """Return points (m, 3) inside the body, and the corners of a convex body, metres."""
        sides = [np.linspace(low, high, GRID_POINTS) for low, high in self.bounds.T]
        grid = np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1).reshape(-1, 3)
        inside = grid[self.body.distance(grid) <= 0.0]
        return inside if self.body.corners is None else np.concatenate([inside, self.body.corners])


def _least_clearance(solid: NumericSolid, points: FloatArray, radii: FloatArray, displacement: FloatArray) -> float:
    """Return the least clearance of balls (m, 3) from a solid on a straight path, metres, every ``SAMPLE_STEP``."""
    length = float(np.linalg.norm(displacement))
    count = max(int(np.ceil(length / SAMPLE_STEP)), 1)
    clearances = solid.distance(points) - radii
    least = float(np.min(clearances))
    for share in np.linspace(0.0, 1.0, count + 1)[1:].tolist():
        clearances -= length / count  # no point comes nearer by more than it moves
        near = clearances < least
        if np.any(near):
            clearances[near] = solid.distance(points[near] + share * displacement) - radii[near]
            least = min(least, float(np.min(clearances[near])))
    return least - solid.clearance + solid.rough


def _link_points(hand: NumericLinkedHand) -> tuple[FloatArray, FloatArray]:
    """Return samples (m, 3) of the hand's links, body frame, and the radii (m,) of balls about them.

    These are zero but for round fingertips of a hand whose links have no shapes.
    """
    rng, points = np.random.default_rng(2), [np.zeros((0, 3))]
    for link, shapes in hand.shapes.items():
        pose = hand.poses[link]
        points.append(link_samples(shapes, rng) @ pose[:3, :3].T + pose[:3, 3])
    radii = [0.0] * sum(map(len, points))
    for tip in hand.tips if not radii else ():
        if tip["type"] == "sphere":
            frame = hand.poses[str(tip["link"])]
            points.append((frame[:3, :3] @ array("offset", tip["offset"], (3,)) + frame[:3, 3])[None])
            radii.append(float(tip["radius"]))
    return np.concatenate(points), np.array(radii)
