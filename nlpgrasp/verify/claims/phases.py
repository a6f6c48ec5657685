"""Whether the phases of a hand follow from its grasp, and whether the approach is as clear as the file says.

The way of the approach is looked at every two millimetres, with this room's own kinematics and distances: of the links'
balls and round fingertips from the body and from tables. Obstacles are not looked at here.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array
from nlpgrasp.solution.phases.phase import APPROACH, GRASP, LIFT, PREGRASP, SQUEEZE, Phase
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.verify.check import NO_BODY, Check, NotMadeError
from nlpgrasp.verify.constraints.regions import unit
from nlpgrasp.verify.hands.unknown import UnknownHand
from nlpgrasp.verify.hands.urdf import URDFNumbers
from nlpgrasp.verify.placement import HandNumbers, Surface

SAME = 1e-9  # metres, radians: what sums may be off by
STEP = 2e-3  # metres between two looks
CLEAR = 2e-4  # metres that a stated clearance may be too large by: it is to a tenth of a millimetre
OUT = 1e-3  # of the hand's span: how deep a ball may be in anything on the way


def phase_checks(solution: GraspSolution, hand: HandNumbers | None, surface: Surface | None) -> list[Check]:
    """Check that each of ``hand.phases`` follows from the others, then the approach's clearance."""
    phases = {phase.name: phase for phase in solution.phases}
    if not phases:
        return []
    posture = solution.hand or {}
    wrong = "; ".join([*_poses(posture, phases), *_commands(solution, phases)])
    checks = [Check("phases", not wrong, wrong or ", ".join(phases))]
    if APPROACH not in phases:
        return checks
    try:
        wrong = "; ".join(_way(solution, phases, hand, surface))
    except NotMadeError as reason:
        return [*checks, Check.not_made("approach", str(reason))]
    return [*checks, Check("approach", not wrong, wrong or f"looked at every {1e3 * STEP:g} mm")]


def _poses(posture: Json, phases: dict[str, Phase]) -> Iterator[str]:
    """Yield what is wrong with where palm and joints are."""
    if GRASP not in phases:
        yield "no grasp among the phases"
        return
    grasp, here = phases[GRASP], Phase.of(GRASP, posture)
    unit("hand.phases.quaternion_wxyz", grasp.palm_quaternion, 4)
    if not (_near(grasp.palm_position, here.palm_position) and _joined(grasp, here)):
        yield "the grasp's palm or joints are not those of the hand"
    for phase in (here, *phases.values()):
        if not _near(phase.palm_quaternion, grasp.palm_quaternion):
            yield f"the palm turns: {phase.name}"
    if APPROACH in phases:
        if PREGRASP not in phases or not _joined(phases[APPROACH], phases[PREGRASP]):
            yield "the joints of the approach are not those of the pregrasp"
            return
        way = posture["approach"]
        direction = unit("hand.approach.direction", way["direction"], 3)
        back = phases[PREGRASP].palm_position - way["distance"] * direction
        if not _near(phases[APPROACH].palm_position, back):
            yield "the approach does not begin its distance before the pregrasp"
    elif (posture.get("approach") or {}).get("direction") is not None:
        yield "a direction of the approach without its keyframe"


def _commands(solution: GraspSolution, phases: dict[str, Phase]) -> Iterator[str]:
    """Yield what is wrong with squeeze and lift."""
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
    if not _near(squeezed.palm_position, grasp.palm_position):
        yield "the palm moves in the squeeze"
    if lift is not None:
        up = (solution.hand or {})["lift"]
        raised = grasp.palm_position + up["distance"] * unit("hand.lift.direction", up["direction"], 3)
        if not (_joined(lift, squeezed) and _near(lift.palm_position, raised)):
            yield "the lift is not the squeeze raised by its distance"


def _near(a: FloatArray, b: FloatArray) -> bool:
    return bool(np.max(np.abs(a - b)) <= SAME)


def _joined(a: Phase, b: Phase) -> bool:
    """Return whether the joints of two phases are the same."""
    return a.joints.keys() == b.joints.keys() and all(abs(a.joints[j] - b.joints[j]) <= SAME for j in a.joints)


def _way(
    solution: GraspSolution, phases: dict[str, Phase], hand: HandNumbers | None, surface: Surface | None
) -> Iterator[str]:
    """Yield what is wrong with the approach's clearance."""
    if isinstance(hand, UnknownHand):
        raise NotMadeError(hand.why)
    if not isinstance(hand, URDFNumbers):
        raise NotMadeError("nothing recomputes the links of a hand of this type")
    if surface is None:
        raise NotMadeError(NO_BODY)
    afar, before = phases[APPROACH], phases[PREGRASP]
    there = replace(hand, posture={**hand.posture, **before.to_dict()})
    balls = [(ball.centre, ball.radius) for ball in there.link_balls]
    links = len(balls)
    for tip in hand.tips:
        if tip["type"] == "sphere":
            frame = there.poses[str(tip["link"])]
            centre = frame[:3, :3] @ array("offset", tip["offset"], (3,)) + frame[:3, 3]
            balls.append((centre, float(tip["radius"])))
    if not balls:  # flat fingertips of links without shapes: nothing that could be near anything
        return
    centres, radii = np.array([c for c, _ in balls]), np.array([r for _, r in balls])
    way = afar.palm_position - before.palm_position
    count = max(int(np.ceil(np.linalg.norm(way) / STEP)), 1)
    shares = np.linspace(0.0, 1.0, count + 1)
    places = centres[None] + shares[:, None, None] * way
    rooms = [surface.distance(places.reshape(-1, 3)).reshape(places.shape[:2]) - radii]
    for data in solution.problem["constraints"]:
        if data["type"] == "table":
            rooms.append(places[..., 2] - radii - data["height"] - data["clearance"])
    least, deepest = float(np.min(rooms)), float(min(np.min(room[:, :links], initial=np.inf) for room in rooms))
    if not deepest >= -OUT * hand.span - hand.error:
        yield f"a link is {-1e3 * deepest:.3g} mm deep in body or table on the way"
    stated = before.clearance
    if stated is None or not stated <= least + CLEAR + hand.error:
        yield f"clearance {stated} m stated, {least:.6f} m found"
