"""Warnings about a hand's file, palm, joints and fingertips."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nlpgrasp.common.shown.numbers import rounded
from nlpgrasp.hands.inspection.facing import better_approach, direction_words, listed
from nlpgrasp.hands.inspection.inspected import Inspected
from nlpgrasp.hands.inspection.opposition import TOUCH, Meeting, Opposition
from nlpgrasp.hands.robot.robot import Robot
from nlpgrasp.hands.spheres.hand_fits import WORTH_A_WARNING
from nlpgrasp.hands.tips.of_shape import overhang
from nlpgrasp.hands.urdf.urdf_arguments import joint_remarks

FULL = 2.0 * np.pi - 0.02  # radians, about a full turn
OFF, FAR_OFF = 1e-3, 5e-3  # metres that a fingertip reaches beyond its link: warned of, and grave
PLACEHOLDER = 100.0  # newton-metres, above any finger motor's torque; forces of sliding joints are not checked


@dataclass(frozen=True)
class Finding:
    """A warning about a hand.

    Parameters
    ----------
    text : str
        A sentence.
    grave : bool
        Whether it may lead to wrong grasps.
    command : str
        The sentence for the command line, where it differs.
    """

    text: str
    grave: bool = False
    command: str = ""


def findings(hand: Inspected, met: Opposition | None) -> tuple[Finding, ...]:
    """Return the warnings about a hand, grave ones first.

    Parameters
    ----------
    hand : Inspected
    met : Opposition or None
        Opposition of its fingertips; None where none are stated.
    """
    found = [
        *_palm(hand),
        *_shapes(hand),
        *_overhangs(hand),
        *_joints(hand),
        *([] if met is None else _tips(hand, met)),
    ]
    return tuple(sorted(found, key=lambda finding: not finding.grave))


def _palm(hand: Inspected) -> list[Finding]:
    """Return a warning where the palm probably faces another way than stated."""
    better = better_approach(hand.tree)
    if better is None:
        return []
    said, seen = direction_words(hand.tree.approach), direction_words(better)
    text = f"The palm is said to face {said}, but its fingertips lie towards {seen}:"
    faces = listed(better)
    option = faces.strip("[]").replace(" ", "")
    return [Finding(f"{text} approach={faces}?", command=f"{text} --approach {option}?")]


def _shapes(hand: Inspected) -> list[Finding]:
    robot = hand.tree.robot
    found = [Finding(f"Left out: {name}.", grave=True) for name in robot.missing]
    if robot.bare:
        one, text = len(robot.bare) == 1, ", ".join(robot.bare)
        them, has, may = (f"Link {text} is", "has", "it may") if one else (f"Links {text} are", "have", "they may")
        found.append(Finding(f"{them} visible but {has} no collision shape: {may} pass through the body.", grave=True))
    if not robot.shapes:
        found.append(
            Finding("No link has a collision shape: all but the fingertips may pass through the body.", grave=True)
        )
    for link, fit in hand.fits.items():
        if fit.uncovered > WORTH_A_WARNING:
            deep = rounded(1e3 * fit.uncovered, 2)
            text = f"Link {link} is thicker than its fingertip: beside a contact it may reach {deep} mm into the body."
            found.append(Finding(text))
    return found


def _overhangs(hand: Inspected) -> list[Finding]:
    """Return warnings about fingertips that reach beyond the shapes of their links."""
    found = []
    for i, (link, tip) in enumerate(hand.tree.tips):
        beyond = overhang(tip, link, hand.tree.robot)
        if beyond is not None and beyond > OFF:
            text = f"Fingertip {i} ({link}) reaches up to {millimetres(beyond)} beyond the shapes of its link"
            found.append(
                Finding(f"{text}: where it touches there, the finger itself does not.", grave=beyond > FAR_OFF)
            )
    return found


def _joints(hand: Inspected) -> list[Finding]:
    robot = hand.tree.robot
    if not robot.free_joints:
        return [Finding(f"No joint below {robot.root} moves: a grasp needs joints that move.", grave=True)]
    found = [Finding(f"{text[0].upper()}{text[1:]}.") for text in joint_remarks(robot)]
    weak = [j.name for j in robot.free_joints if j.name not in hand.torque_limits]
    if weak:
        every = len(weak) == len(robot.free_joints) > 1
        whose = "No joint has an effort limit" if every else f"No effort limit at {_some(weak, 'joint')}"
        found.append(Finding(f'{whose}: the force budget "hand_torques" needs torque_limits.'))
    strong = [j.name for j in robot.free_joints if j.turns and hand.torque_limits.get(j.name, 0.0) > PLACEHOLDER]
    if strong:
        text = f"An effort above {PLACEHOLDER:g} N m at {_some(strong, 'joint', len(robot.free_joints))}"
        found.append(Finding(f"{text} looks like a placeholder: state torque_limits."))
    wide = [name for name, (lower, upper, _) in robot.ranges.items() if _turns(robot, name) and upper - lower >= FULL]
    if wide:
        text = _some(wide, "joint", len(robot.free_joints))
        found.append(Finding(f"{text[0].upper()}{text[1:]} can turn a full circle or more: cables may not allow that."))
    return found


def _tips(hand: Inspected, met: Opposition) -> list[Finding]:
    if len(hand.tree.tips) == 1:
        return [Finding("Only one fingertip is stated: to hold a body takes two at least.", grave=True)]
    found = []
    if met.pairs and not any(pair.faces for pair in met.pairs):
        found.append(Finding("No two fingertips ever face each other: they cannot press from two sides.", grave=True))
    else:
        found += [_pair(hand, pair) for pair in met.pairs if not pair.touches]
    for several in met.apart:
        text = f"Fingertips {_named(hand, several.fingers)} come together in smaller sets but not all at once"
        found.append(Finding(f"{text}: at least two of them stay {millimetres(several.nearest)} apart."))
    return found


def _pair(hand: Inspected, pair: Meeting) -> Finding:
    """Return the warning about two fingertips that cannot touch face to face."""
    names = f"Fingertips {_named(hand, pair.fingers)}"
    if not pair.faces:
        near = "touch without facing" if pair.nearest <= TOUCH else f"come within {millimetres(pair.nearest)}"
        return Finding(f"{names} never face each other; they {near}.")
    far = millimetres(pair.opposed)
    return Finding(f"{names} cannot meet: they stay {far} apart and can hold nothing thinner between them.")


def millimetres(distance: float) -> str:
    """Return a distance in metres as text, to a tenth of a millimetre."""
    return f"{rounded(round(1e3 * distance, 1))} mm"


def _named(hand: Inspected, fingers: Sequence[int]) -> str:
    """Return fingertips by number and link, as text."""
    names = [f"{i} ({hand.tree.tips[i][0]})" for i in fingers]
    return f"{', '.join(names[:-1])} and {names[-1]}"


def _turns(robot: Robot, name: str) -> bool:
    return next(j.turns for j in robot.free_joints if j.name == name)


def _some(names: Sequence[str], what: str, count: int = 0) -> str:
    """Return names as text, or ``all n`` where they are all of a count."""
    if len(names) == count > 1:
        return f"all {count} {what}s"
    return f"{what}{'s' if len(names) > 1 else ''} {', '.join(names)}"
