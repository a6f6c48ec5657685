"""Checks of a hand's phases against its grasp, and of the stated approach."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.solution.phases.phase import APPROACH, GRASP, LIFT, PREGRASP, SQUEEZE, Phase
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.verify.check import Check
from nlpgrasp.verify.claims.version import states_all
from nlpgrasp.verify.constraints.regions import unit

SAME = 1e-9  # metres, radians: rounding tolerance of sums


def phase_checks(solution: GraspSolution) -> list[Check]:
    """Check that each of ``hand.phases`` follows from the others, and that ``hand.approach`` is stated."""
    phases, posture = {phase.name: phase for phase in solution.phases}, solution.hand or {}
    checks = []
    if phases:
        wrong = "; ".join([*_poses(posture, phases), *_commands(solution, phases)])
        checks.append(Check("phases", not wrong, wrong or ", ".join(phases)))
    if (solution.problem.get("hand") or {}).get("type") == "urdf" and states_all(solution):
        wrong, told = _way_in(posture, phases)
        checks.append(Check("way in", not wrong, wrong or told))
    return checks


def _way_in(posture: Json, phases: dict[str, Phase]) -> tuple[str, str]:
    """Return the error in the statement of an approach, and otherwise what it states."""
    way = posture.get("approach")
    if way is None:
        return "the file does not state hand.approach", ""
    if way.get("direction") is not None:
        return ("" if phases else "hand.approach states a direction, and the file no phases of the hand"), "free"
    reason = str(way.get("reason") or "").strip()
    return ("" if reason else "hand.approach states neither a direction nor the reason why none is free"), reason


def _poses(posture: Json, phases: dict[str, Phase]) -> Iterator[str]:
    """Yield the errors in palm pose and joints."""
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
    """Return whether the joint positions of two phases are equal."""
    return a.joints.keys() == b.joints.keys() and all(abs(a.joints[j] - b.joints[j]) <= SAME for j in a.joints)
