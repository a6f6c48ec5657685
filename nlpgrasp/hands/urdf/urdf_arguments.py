"""Arguments of a URDF hand: fingertips, approach and torque limits; warnings about the file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from nlpgrasp.common.given.lengths import LARGEST_TIP, of_a_hand
from nlpgrasp.common.given.names import MOST, listed
from nlpgrasp.common.validation import FloatArray, array, number
from nlpgrasp.errors import InputError
from nlpgrasp.hands.robot.ends import end, leaves
from nlpgrasp.hands.robot.robot import Robot
from nlpgrasp.hands.tips import SphereTip, Tip
from nlpgrasp.hands.tips.of_shape import tip_of

MEANT_AS_RADIANS = float(np.radians(2.0 * np.pi))  # radians: a full turn in radians, misread as degrees
Fingertips = Mapping[str, float | Tip | Sequence[Tip] | None] | Sequence[str]


def tips_of(robot: Robot, fingertips: Fingertips | None) -> list[tuple[str, Tip]]:
    """Return link and patch of each contact, in the given order."""
    if fingertips is None:
        raise InputError("URDFHand.fingertips", "nothing", f"links with their radii, such as {_at_the_ends(robot)}")
    if isinstance(fingertips, list | tuple) and all(isinstance(name, str) for name in fingertips):
        fingertips = dict.fromkeys(fingertips)
    if not isinstance(fingertips, Mapping) or not fingertips:
        raise InputError("URDFHand.fingertips", fingertips, "link names, each with a radius or a tip")
    unknown = [name for name in fingertips if name not in robot.links]
    if unknown:
        raise InputError("URDFHand.fingertips", ", ".join(map(str, unknown)), f"links: {listed(unknown, robot.links)}")
    result: list[tuple[str, Tip]] = []
    for link, said in fingertips.items():
        given = _own_shape(robot, link) if said is None else said
        several = list(given) if isinstance(given, list | tuple) else [given]
        if not several:
            raise InputError(f"URDFHand.fingertips[{link!r}]", given, "a radius, a tip, or several tips")
        for one in several:
            tip = one if isinstance(one, Tip) else SphereTip(_radius(f"URDFHand.fingertips[{link!r}]", one))
            if (link, tip) in result:
                raise InputError(f"URDFHand.fingertips[{link!r}]", given, "tips that are not the same")
            result.append((link, tip))
    if not result:
        raise InputError("URDFHand.fingertips", fingertips, "at least one tip")
    return result


def _radius(field: str, given: object) -> float:
    """Return a fingertip's radius, checked, metres."""
    return of_a_hand(field, number(field, given, above=0.0), LARGEST_TIP)


def _at_the_ends(robot: Robot) -> str:
    """Return the fingertips that the leaf links suggest, as Python code."""
    names = leaves(robot)
    each = ", ".join(f'"{link}": {end(robot, link).code}' for link in names[:MOST])
    more = f" ({len(names) - MOST} more links are at ends)" if len(names) > MOST else ""
    return f"{{{each}}}{more}"


def _own_shape(robot: Robot, link: str) -> Tip:
    """Return the fingertip given by a link's collision shape."""
    shapes = robot.shapes.get(link, ())
    tip = tip_of(shapes)
    if tip is None:
        kinds = ", ".join(shape.kind for shape in shapes) or "none"
        allowed = "a radius or a tip: its collision shapes are no single sphere or capsule"
        raise InputError(f"URDFHand.fingertips[{link!r}]", f"nothing for shapes {kinds}", allowed)
    return tip


def approach_of(given: ArrayLike) -> FloatArray:
    """Return the palm's facing direction as a unit vector (3,)."""
    direction = array("URDFHand.approach", given, (3,))
    if np.linalg.norm(direction) == 0.0:
        raise InputError("URDFHand.approach", given, "a direction in the palm's frame")
    return direction / np.linalg.norm(direction)


def torque_limits_of(robot: Robot, given: Mapping[str, float] | float | None) -> dict[str, float]:
    """Return the torque limits by joint: those given, or the URDF's efforts."""
    names = [j.name for j in robot.free_joints]
    if given is None:
        return {j.name: j.effort for j in robot.free_joints if j.effort}
    if isinstance(given, Mapping):
        unknown = [name for name in given if name not in names]
        if unknown:
            allowed = f"joints: {listed(unknown, names)}"
            raise InputError("URDFHand.torque_limits", ", ".join(map(str, unknown)), allowed)
        return {k: number(f"URDFHand.torque_limits[{k!r}]", v, above=0.0) for k, v in given.items()}
    return dict.fromkeys(names, number("URDFHand.torque_limits", given, above=0.0))


def remarks(robot: Robot) -> list[str]:
    """Return the warnings about a file that is accepted, a sentence each."""
    found = []
    if robot.missing:
        found.append(f"left out {'; '.join(robot.missing)}")
    if robot.bare:
        found.append(f"nothing keeps links without a collision shape off the body: {', '.join(robot.bare)}")
    return found + joint_remarks(robot)


def joint_remarks(robot: Robot) -> list[str]:
    """Return the warnings about joints that are modelled otherwise than in the file, a sentence each."""
    found = []
    if robot.turned:
        found.append(f"taken with the other sign: {'; '.join(robot.turned)}")
    if robot.unmodelled:
        found.append(f"joints move on their own where the file couples them: {'; '.join(robot.unmodelled)}")
    turning = [joint for joint in robot.free_joints if joint.kind == "revolute"]
    widest = max((max(abs(j.lower), abs(j.upper)) for j in turning), default=0.0)
    if robot.source.endswith(".xml") and 0.0 < widest < MEANT_AS_RADIANS:
        said = '<compiler angle="radian"/>, without which MuJoCo reads degrees'
        found.append(f"no joint turns by more than {np.degrees(widest):.3g} degrees: the file may lack {said}")
    return found
