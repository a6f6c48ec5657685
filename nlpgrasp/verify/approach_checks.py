"""Checks of a hand's phases, and recomputation of its straight paths: approach and lift.

Links are represented by their collision spheres, with this package's own kinematics and distances. The approach is
sampled every two millimetres; a lift in steps of the distance from the surroundings, at least two millimetres.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array, number
from nlpgrasp.solution.obstructions import BODY
from nlpgrasp.solution.phase_record import APPROACH, GRASP, LIFT, PREGRASP, SQUEEZE, Phase
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.verify.check import NO_BODY, Check, NotCheckedError, is_complete_version
from nlpgrasp.verify.convex_solids import NumericSolid, solid_body, solids_around
from nlpgrasp.verify.numeric_constraints import unit
from nlpgrasp.verify.numeric_urdf_hand import URDFNumbers, require_links
from nlpgrasp.verify.stated_placement import HandNumbers, NumericBody, StatedPlacement

SAME = 1e-9  # metres, radians: rounding tolerance of sums
STEP = 2e-3  # metres between samples
CLEAR = 2e-4  # metres: allowed excess of a stated clearance, which is rounded to a tenth of a millimetre
OUT = 1e-3  # share of the hand's span: allowed penetration of a sphere on the path
GRID = 24  # sample points in the body along each side of its box


def phase_checks(solution: GraspSolution) -> list[Check]:
    """Check that each of ``hand.phases`` follows from the others, and that ``hand.approach`` is stated."""
    phases, posture = {phase.name: phase for phase in solution.phases}, solution.hand or {}
    checks = []
    if phases:
        wrong = "; ".join([*_phase_errors(posture, phases), *_commands(solution, phases)])
        checks.append(Check("phases", not wrong, wrong or ", ".join(phases)))
    if (solution.problem.get("hand") or {}).get("type") == "urdf" and is_complete_version(solution):
        wrong, told = _approach_error(posture, phases)
        checks.append(Check("way in", not wrong, wrong or told))
    return checks


def _approach_error(posture: Json, phases: dict[str, Phase]) -> tuple[str, str]:
    """Return the error in the statement of an approach, and otherwise what it states."""
    way = posture.get("approach")
    if way is None:
        return "the file does not state hand.approach", ""
    if way.get("direction") is not None:
        return ("" if phases else "hand.approach states a direction, and the file no phases of the hand"), "free"
    reason = str(way.get("reason") or "").strip()
    return ("" if reason else "hand.approach states neither a direction nor the reason why none is free"), reason


def _phase_errors(posture: Json, phases: dict[str, Phase]) -> Iterator[str]:
    """Yield the errors in palm pose and joints."""
    if GRASP not in phases:
        yield "no grasp among the phases"
        return
    grasp, here = phases[GRASP], Phase.of(GRASP, posture)
    unit("hand.phases.quaternion_wxyz", grasp.palm_quaternion, 4)
    if not (_is_close(grasp.palm_position, here.palm_position) and _has_equal_joints(grasp, here)):
        yield "the grasp's palm or joints are not those of the hand"
    for phase in (here, *phases.values()):
        if not _is_close(phase.palm_quaternion, grasp.palm_quaternion):
            yield f"the palm turns: {phase.name}"
    if APPROACH in phases:
        if PREGRASP not in phases or not _has_equal_joints(phases[APPROACH], phases[PREGRASP]):
            yield "the joints of the approach are not those of the pregrasp"
            return
        way = posture["approach"]
        direction = unit("hand.approach.direction", way["direction"], 3)
        back = phases[PREGRASP].palm_position - way["distance"] * direction
        if not _is_close(phases[APPROACH].palm_position, back):
            yield "the approach does not begin its distance before the pregrasp"
    elif (posture.get("approach") or {}).get("direction") is not None:
        yield "a direction of the approach without its keyframe"


def _commands(solution: GraspSolution, phases: dict[str, Phase]) -> Iterator[str]:
    """Yield the errors in squeeze and lift."""
    grasp, squeezed, lift = phases.get(GRASP), phases.get(SQUEEZE), phases.get(LIFT)
    if grasp is None or (squeezed is None and lift is None):
        return
    if squeezed is None or solution.squeeze is None:
        yield "a lift or squeeze without forces of hand.squeeze"
        return
    told = {**grasp.joints, **solution.squeeze.positions()}
    own = ((solution.hand or {})["squeeze"]).get("torques", {})
    if any(abs(squeezed.joints[joint] - told[joint]) > SAME * max(1.0, abs(told[joint])) for joint in own):
        yield "the squeeze's joints are not those commanded"
    if not _is_close(squeezed.palm_position, grasp.palm_position):
        yield "the palm moves in the squeeze"
    if lift is not None:
        up = (solution.hand or {})["lift"]
        raised = grasp.palm_position + up["distance"] * unit("hand.lift.direction", up["direction"], 3)
        if not (_has_equal_joints(lift, squeezed) and _is_close(lift.palm_position, raised)):
            yield "the lift is not the squeeze raised by its distance"


def _is_close(a: FloatArray, b: FloatArray) -> bool:
    return bool(np.max(np.abs(a - b)) <= SAME)


def _has_equal_joints(a: Phase, b: Phase) -> bool:
    """Return whether the joint positions of two phases are equal."""
    return a.joints.keys() == b.joints.keys() and all(abs(a.joints[j] - b.joints[j]) <= SAME for j in a.joints)


def way_checks(
    solution: GraspSolution, hand: HandNumbers | None, surface: NumericBody | None, placement: StatedPlacement
) -> list[Check]:
    """Return the checks of the approach's clearance and of the lift's distance, if stated.

    Parameters
    ----------
    solution : GraspSolution
    hand : HandNumbers or None
    surface : NumericBody or None
        The body; None if missing.
    placement : StatedPlacement
        Reader of obstacles.
    """
    phases, up = {phase.name: phase for phase in solution.phases}, (solution.hand or {}).get("lift")
    stated: dict[str, Callable[[_Scene], Iterator[str]]] = {}
    if APPROACH in phases and PREGRASP in phases:
        stated["approach"] = lambda scene: scene.approach(phases[APPROACH], phases[PREGRASP])
    if up is not None:
        stated["lift"] = lambda scene: scene.lift(up)
    if not stated:
        return []
    try:
        scene = _Scene.of(solution, hand, surface, placement)
        wrong = {name: "; ".join(faults(scene)) for name, faults in stated.items()}
    except NotCheckedError as reason:
        return [Check.not_made(name, str(reason)) for name in stated]
    return [Check(name, not fault, fault or f"looked at every {1e3 * STEP:g} mm") for name, fault in wrong.items()]


@dataclass(frozen=True)
class _Scene:
    """A hand with the held body and the solids around them.

    Parameters
    ----------
    hand : URDFNumbers
    body : NumericSolid
    bounds : (2, 3) array
        The body's bounding box, metres.
    around : sequence of NumericSolid
        Tables and obstacles.
    """

    hand: URDFNumbers
    body: NumericSolid
    bounds: FloatArray
    around: Sequence[NumericSolid]

    @classmethod
    def of(
        cls, solution: GraspSolution, hand: HandNumbers | None, surface: NumericBody | None, placement: StatedPlacement
    ) -> _Scene:
        """Return the scene; raise ``NotCheckedError`` where data are missing."""
        known = require_links(hand, "links")
        if surface is None:
            raise NotCheckedError(NO_BODY)
        around = list(solids_around(solution.problem["constraints"], placement))
        return cls(known, solid_body(BODY, solution.body, surface), surface.bounds, around)

    @property
    def deepest(self) -> float:
        """Allowed penetration of a sphere on the path, metres."""
        return OUT * self.hand.span + self.hand.error

    def approach(self, afar: Phase, before: Phase) -> Iterator[str]:
        """Yield the errors in the stated clearance of the straight path to the pregrasp."""
        centres, radii, links = _link_spheres(replace(self.hand, posture={**self.hand.posture, **before.to_dict()}))
        if not len(radii):  # flat fingertips of links without shapes: no spheres
            return
        way = afar.palm_position - before.palm_position
        count = max(int(np.ceil(np.linalg.norm(way) / STEP)), 1)
        places = centres[None] + np.linspace(0.0, 1.0, count + 1)[:, None, None] * way
        least = np.inf
        for thing in (self.body, *self.around):
            distances = thing.distance(places.reshape(-1, 3)).reshape(places.shape[:2])
            room = distances - radii - thing.clearance + thing.rough
            least, deepest = min(least, float(np.min(room))), -float(np.min(room[:, :links], initial=np.inf))
            if not deepest <= self.deepest:
                yield f"a link is {1e3 * deepest:.3g} mm deep in {thing.name} on the way"
        if before.clearance is None or not before.clearance <= least + CLEAR + self.hand.error:
            yield f"clearance {before.clearance} m stated, {least:.6f} m found"

    def lift(self, up: Json) -> Iterator[str]:
        """Yield the obstructions of hand and body along a lift; they may stay as near as they are.

        Parameters
        ----------
        up : mapping
            ``direction`` and ``distance``.
        """
        direction = unit("hand.lift.direction", up["direction"], 3)
        distance = number("hand.lift.distance", up["distance"], at_least=0.0)
        centres, radii, _ = _link_spheres(self.hand)
        body = self._points_in_body()
        points, radii = np.concatenate([centres, body]), np.concatenate([radii, np.zeros(len(body))])
        for thing in self.around:
            first = room = thing.distance(points) - radii - thing.clearance
            lifted, least = 0.0, np.minimum(first, 0.0) - self.deepest - thing.rough
            while lifted < distance and np.all(room >= least):
                lifted = min(lifted + max(STEP, float(np.min(room - np.minimum(first, 0.0)))), distance)
                room = thing.distance(points + lifted * direction) - radii - thing.clearance
            if not np.all(room >= least):
                where = f"{thing.name} is in the way at {1e3 * lifted:.4g} mm"
                yield f"a lift by {1e3 * distance:.4g} mm is stated, {where}"

    def _points_in_body(self) -> FloatArray:
        """Return points (m, 3) in the body, with its corners if it is convex, metres."""
        sides = [np.linspace(low, high, GRID) for low, high in self.bounds.T]
        every = np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1).reshape(-1, 3)
        inside = every[self.body.distance(every) <= 0.0]
        return inside if self.body.corners is None else np.concatenate([inside, self.body.corners])


def _link_spheres(hand: URDFNumbers) -> tuple[FloatArray, FloatArray, int]:
    """Return centres (m, 3) and radii (m,) of a hand's spheres in its posture, and the number of links' spheres.

    The remaining ones are round fingertips.
    """
    balls = [(ball.centre, ball.radius) for ball in hand.link_balls]
    links = len(balls)
    for tip in hand.tips:
        if tip["type"] == "sphere":
            frame = hand.poses[str(tip["link"])]
            centre = frame[:3, :3] @ array("offset", tip["offset"], (3,)) + frame[:3, 3]
            balls.append((centre, float(tip["radius"])))
    return np.array([c for c, _ in balls]).reshape(-1, 3), np.array([r for _, r in balls]), links
