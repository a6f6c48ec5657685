"""Plausibility of a robot file's units: meshes in millimetres, joint limits in degrees."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from nlpgrasp.common.robot_files import MJCF_ENDINGS, UrdfUnits
from nlpgrasp.common.validation import LONGEST_BODY, TURN, number
from nlpgrasp.errors import InputError
from nlpgrasp.hands.robot import Robot

LONG_MESH, LONG_SHARE = 1.0, 10.0  # m, and times the distance of the joints: a mesh longer than both is asked about
SHORT_SHARE = 0.01  # of the distance of the joints: a hand whose meshes are all shorter is asked about
SHORT_REACH = 0.01  # m, least reach that lengths are compared with
UNIT_FACTORS = {1e-3: "millimetres", 1e-2: "centimetres"}  # by their length, m
MOST_DEGREES = 360.0  # a limit beyond it means no limit
DEGREES_SHARE = 0.5  # of the revolute joints: limits of fewer beyond a turn are those of geared or tendon-driven joints
MOST_NAMES = 3  # names in a sentence
SCALE_CURE = "if their scale in the file is too small, scale=1000 makes up for it"


def check_units(scale: object, degrees: object) -> UrdfUnits:
    """Return validated units of a URDF's numbers, given as in ``URDFHand.load``.

    Raises
    ------
    InputError
        On a scale that is not above zero, and on ``degrees`` other than True or False.
    """
    if not isinstance(degrees, bool):
        raise InputError("URDFHand.degrees", degrees, "True or False")
    return UrdfUnits(number("URDFHand.scale", scale, above=0.0), degrees)


def unit_questions(robot: Robot) -> list[str]:
    """Return doubts about the units of a robot file's meshes, offsets and joint limits, one sentence each."""
    return [f"{question.observation}: {question.cure}" for question in _unit_doubts(robot)]


def refuse_implausible_lengths(robot: Robot) -> None:
    """Raise for meshes longer than 10 m, or joints more than 10 m from the palm.

    Raises
    ------
    InputError
        With the likely unit and its cure.
    """
    for question in _unit_doubts(robot):
        if question.longest > LONGEST_BODY:
            raise InputError(f"URDFHand.path: {robot.source}", question.observation, f"metres: {question.cure}")


def joint_reach(robot: Robot) -> float:
    """Return the largest sum of joint offset lengths from the palm to a link, metres."""
    reach = {robot.root: 0.0}
    for joint in robot.joints:
        reach[joint.child] = reach[joint.parent] + float(np.linalg.norm(joint.xyz))
    return max(reach.values())


class UnitQuestion(NamedTuple):
    """A doubt about a unit: suspicious values, the remedy, and the largest length among them, metres."""

    observation: str
    cure: str
    longest: float = 0.0


def _unit_doubts(robot: Robot) -> Iterator[UnitQuestion]:
    """Yield all doubts about a robot file's units."""
    reach = joint_reach(robot)
    if reach > LONGEST_BODY:
        cure = f"if these are millimetres, divide all lengths of {robot.source} by 1000"
        yield UnitQuestion(f"joints up to {reach:.3g} m from {robot.root}", cure, reach)
    else:
        yield from _mesh_doubts(robot, reach)
    yield from _limit_doubts(robot)


def _mesh_doubts(robot: Robot, reach: float) -> Iterator[UnitQuestion]:
    """Yield a doubt if the meshes are much longer or much shorter than the reach of the joints, metres."""
    lengths = {
        link: max(lengths)
        for link, shapes in robot.shapes.items()
        if (lengths := [float(np.max(np.ptp(s.mesh.vertices, axis=0))) for s in shapes if s.kind == "mesh"])
    }
    longest, limit = max(lengths.values(), default=0.0), max(LONG_MESH, LONG_SHARE * reach)
    context = f"at joints that reach {reach:.3g} m"
    if longest > limit:
        large = [link for link, length in lengths.items() if length > limit]
        factor = min(UNIT_FACTORS, key=lambda f: abs(np.log(f * longest / max(reach, SHORT_REACH))))
        stated = f'scale="{factor:g} {factor:g} {factor:g}" in their <mesh>'
        cure = f"scale={factor:g}" if len(large) == len(lengths) else stated
        observation = f"meshes up to {longest:.3g} m long ({_format_first_names('link', large)}) {context}"
        yield UnitQuestion(observation, f"if they are {UNIT_FACTORS[factor]}, {cure} says so", longest)
    elif 0.0 < longest < SHORT_SHARE * reach:
        observation = f"meshes at most {1e3 * longest:.2g} mm long {context}"
        yield UnitQuestion(observation, SCALE_CURE)


def _limit_doubts(robot: Robot) -> Iterator[UnitQuestion]:
    """Yield a doubt if most joint limits of a URDF look like degrees."""
    limits = {j.name: max(abs(j.lower), abs(j.upper)) for j in robot.joints if j.kind == "revolute"}
    doubtful = [name for name, limit in limits.items() if TURN < limit <= MOST_DEGREES]
    if len(doubtful) > DEGREES_SHARE * len(limits) and not robot.source.endswith(MJCF_ENDINGS):
        widest = max(limits[name] for name in doubtful)
        observation = (
            f"limits up to {widest:.4g} rad, {widest / TURN:.1f} turns ({_format_first_names('joint', doubtful)})"
        )
        yield UnitQuestion(observation, "if they are degrees, degrees=True says so")


def _format_first_names(noun: str, names: Sequence[str]) -> str:
    """Return a noun with the first few names and the count of the others, as text."""
    more = f" and {len(names) - MOST_NAMES} more" if len(names) > MOST_NAMES else ""
    return f"{noun}{'' if len(names) == 1 else 's'} {', '.join(names[:MOST_NAMES])}{more}"
