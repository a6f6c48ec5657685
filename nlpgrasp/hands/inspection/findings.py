"""What is to be known of a hand before anything is solved with it, in sentences."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nlpgrasp.common.shown.numbers import rounded
from nlpgrasp.hands.inspection.inspected import Inspected
from nlpgrasp.hands.inspection.opposition import TOUCH, Meeting, Opposition
from nlpgrasp.hands.robot.robot import Robot
from nlpgrasp.hands.spheres.hand_fits import WORTH_A_WARNING
from nlpgrasp.hands.urdf.urdf_arguments import joint_remarks

FULL = 2.0 * np.pi - 0.02  # radians, about a full turn
PLACEHOLDER = 100.0  # newton-metres that no motor of a finger has; newtons of a sliding joint are not judged


@dataclass(frozen=True)
class Finding:
    """Something to know.

    Parameters
    ----------
    text : str
        A sentence.
    grave : bool
        Whether grasps may come out wrong for it.
    """

    text: str
    grave: bool = False


def findings(hand: Inspected, met: Opposition | None) -> tuple[Finding, ...]:
    """Return what is to be known of a hand, grave things first.

    Parameters
    ----------
    hand : Inspected
    met : Opposition or None
        Which of its fingertips come together; None where none are stated.
    """
    found = [*_shapes(hand), *_joints(hand), *([] if met is None else _tips(hand, met))]
    return tuple(sorted(found, key=lambda finding: not finding.grave))


def _shapes(hand: Inspected) -> list[Finding]:
    robot = hand.tree.robot
    found = [Finding(f"Left out: {name}.", grave=True) for name in robot.missing]
    if robot.bare:
        one, text = len(robot.bare) == 1, ", ".join(robot.bare)
        has, them = (f"Link {text} has", "it") if one else (f"Links {text} have", "them")
        found.append(Finding(f"{has} a visual and no collision shape: nothing keeps {them} off the body.", grave=True))
    if not robot.shapes:
        found.append(Finding("No link has a collision shape: only fingertips are kept off the body.", grave=True))
    for link, fit in hand.fits.items():
        if fit.uncovered > WORTH_A_WARNING:
            deep = rounded(1e3 * fit.uncovered, 2)
            text = f"Link {link} is thicker than its fingertip: it may be {deep} mm deep in the body beside a contact."
            found.append(Finding(text))
    return found


def _joints(hand: Inspected) -> list[Finding]:
    robot = hand.tree.robot
    if not robot.free_joints:
        return [Finding(f"No joint below {robot.root} moves: a grasp needs joints that do.", grave=True)]
    found = [Finding(f"{text[0].upper()}{text[1:]}.") for text in joint_remarks(robot)]
    weak = [j.name for j in robot.free_joints if j.name not in hand.torque_limits]
    if weak:
        whose = f"no effort limit at {_some(weak, len(robot.free_joints), 'joint')}"
        found.append(Finding(f'{whose[0].upper()}{whose[1:]}: the force budget "hand_torques" needs torque_limits.'))
    strong = [j.name for j in robot.free_joints if j.turns and hand.torque_limits.get(j.name, 0.0) > PLACEHOLDER]
    if strong:
        text = f"An effort above {PLACEHOLDER:g} N m at {_some(strong, len(robot.free_joints), 'joint')}"
        found.append(Finding(f"{text} looks like a placeholder: state torque_limits."))
    wide = [name for name, (lower, upper, _) in robot.ranges.items() if _turns(robot, name) and upper - lower >= FULL]
    if wide:
        text = f"A full turn or more at {_some(wide, len(robot.free_joints), 'joint')}"
        found.append(Finding(f"{text}: cables and neighbours may not let them."))
    return found


def _tips(hand: Inspected, met: Opposition) -> list[Finding]:
    if len(hand.tree.tips) == 1:
        return [Finding("One fingertip alone: a hand that holds needs two at least.", grave=True)]
    found = []
    if met.pairs and not any(pair.faces for pair in met.pairs):
        found.append(Finding("No two fingertips ever face each other: they cannot press from two sides.", grave=True))
    else:
        found += [_pair(hand, pair) for pair in met.pairs if not pair.touches]
    for several in met.apart:
        text = f"Fingertips {_named(hand, several.fingers)} come together in smaller sets and not at once"
        found.append(Finding(f"{text}: some two of them stay {millimetres(several.nearest)} apart."))
    return found


def _pair(hand: Inspected, pair: Meeting) -> Finding:
    """Return what is said of two fingertips that do not touch face to face."""
    names = f"Fingertips {_named(hand, pair.fingers)}"
    if not pair.faces:
        near = "touch without that" if pair.nearest <= TOUCH else f"come within {millimetres(pair.nearest)}"
        return Finding(f"{names} never face each other; they {near}.")
    far = millimetres(pair.opposed)
    return Finding(f"{names} cannot meet: they stay {far} apart, and hold nothing thinner between them.")


def millimetres(distance: float) -> str:
    """Return a distance in metres as text, to a tenth of a millimetre."""
    return f"{rounded(round(1e3 * distance, 1))} mm"


def _named(hand: Inspected, fingers: Sequence[int]) -> str:
    """Return fingertips by number and link."""
    names = [f"{i} ({hand.tree.tips[i][0]})" for i in fingers]
    return f"{', '.join(names[:-1])} and {names[-1]}"


def _turns(robot: Robot, name: str) -> bool:
    return next(j.turns for j in robot.free_joints if j.name == name)


def _some(names: Sequence[str], count: int, what: str) -> str:
    """Return names, or how many where they are all."""
    if len(names) == count > 1:
        return f"all {count} {what}s"
    return f"{what}{'s' if len(names) > 1 else ''} {', '.join(names)}"
