"""Inspection report of a hand: parts, opposition, suggested fingertips, warnings about its file."""

from __future__ import annotations

import json
import shlex
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from nlpgrasp.common.formatting import format_number
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import InputError
from nlpgrasp.hands.base import Hand
from nlpgrasp.hands.finger_chains import format_as_list, format_direction, suggested_approach
from nlpgrasp.hands.kinematics import LinkTree
from nlpgrasp.hands.link_spheres import WORTH_A_WARNING, SphereFit, fit_hand
from nlpgrasp.hands.linked_hand import LinkedHand
from nlpgrasp.hands.opposition import TOUCH, Opposition, TipMeeting, opposition
from nlpgrasp.hands.robot import Robot
from nlpgrasp.hands.robot_file import read_robot
from nlpgrasp.hands.suggested_tips import GUESS, End, end, leaves, overhang
from nlpgrasp.hands.tips import SphereTip
from nlpgrasp.hands.urdf_hand import approach_of, joint_remarks, torque_limits_of

SPHERES = 6  # per link, the default of URDFHand.load
EVEN = 0.1  # share of a joint's range: with its middle this near zero the joint rests at zero
CLOSED = 0.35  # share of its range at which any other joint rests
FULL = 2.0 * np.pi - 0.02  # radians, about a full turn
OFF, FAR_OFF = 1e-3, 5e-3  # metres that a fingertip reaches beyond its link: warned of, and grave
PLACEHOLDER = 100.0  # newton-metres, above any finger motor's torque; forces of sliding joints are not checked
LISTED = 12  # most links that are named
ALONG_Z = [0.0, 0.0, 1.0]  # default palm direction
# stated if there are no warnings
GOOD = "every visible link has a collision shape, every joint has limits, and every two fingertips can touch."


def inspect(hand: Hand | InspectedHand) -> Inspection:
    """Return the inspection of a hand.

    Raises
    ------
    InputError
        For a hand without links.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # the findings hold the same warnings
        shown = hand if isinstance(hand, InspectedHand) else inspection_data(hand)
    met = opposition(shown.tree, shown.at_rest) if shown.tree.tips else None
    return Inspection(shown, met, findings(shown, met))


@dataclass(frozen=True)
class Inspection:
    """Result of inspecting a hand.

    Parameters
    ----------
    hand : InspectedHand
    met : Opposition or None
        Opposition of the fingertips; None where none are stated.
    findings : tuple of FileWarning
        Warnings, grave ones first.
    """

    hand: InspectedHand
    met: Opposition | None
    findings: tuple[FileWarning, ...]

    @property
    def verdict(self) -> str:
        """The number of warnings as text, or that there are none."""
        if not self.hand.tree.tips:
            return "no fingertips stated"
        count = len(self.findings)
        return f"{_counted(count, 'thing')} to know" if count else "no problems found"

    @property
    def kind(self) -> str:
        """``good``, ``some`` (there are warnings) or ``bad`` (grasps may come out wrong)."""
        if not self.hand.tree.tips:
            return "some"
        if any(finding.grave for finding in self.findings):
            return "bad"
        return "some" if self.findings else "good"

    @property
    def sentences(self) -> tuple[FileWarning, ...]:
        """The warnings, after how to state fingertips where there are none; empty without problems."""
        if self.hand.tree.tips:
            return self.findings
        ends, more = leaf_links(self.hand), len(self.hand.leaves) - LISTED
        named = ", ".join(tip.link for tip in ends) + (f" and {more} more" if more > 0 else "")
        guess = ""
        if any(tip.guessed for tip in ends):
            guess = f" A radius of {GUESS:g} m stands for a link without a collision shape."
            robot = self.hand.tree.robot
            reaches = {t.link: overhang(SphereTip(GUESS), t.link, robot) or 0.0 for t in ends if t.guessed}
            off = {link: reach for link, reach in reaches.items() if reach > OFF}
            if off:
                told = ", ".join(f"{link} by up to {millimetres(reach)}" for link, reach in off.items())
                guess += f" It floats beyond the finger's own shapes at {told}: state tips that lie on the finger."
        return (
            FileWarning(f"No fingertips are stated. Links at the ends: {named}.{guess} To use them:"),
            *self.findings,
        )

    @property
    def to_paste(self) -> tuple[str, ...]:
        """A command and a line of Python that state fingertips, if there are none yet; else empty."""
        return () if self.hand.tree.tips else lines_to_paste(self.hand)

    @property
    def lines(self) -> tuple[str, ...]:
        """The hand's parts and the verdict, a line each, then the warnings."""
        robot = self.hand.tree.robot
        follow = sum(joint.moves for joint in robot.joints) - len(robot.free_joints)
        joints = _counted(len(robot.free_joints), "joint") + f" and {follow} more that follow{'s' * (follow == 1)}" * (
            follow > 0
        )
        parts = f"{_counted(len(robot.links), 'link')}, {joints}, {_counted(len(self.hand.tree.tips), 'fingertip')}"
        first = f"{robot.name}: {parts}"
        told = [f"  {'! ' if f.grave else '- '}{f.command or f.text}" for f in self.sentences]
        if not self.hand.tree.tips:  # the first sentence says what to do
            return (first, told[0], *(f"      {line}" for line in self.to_paste), *told[1:])
        return (first, f"{self.verdict}:{'' if told else f' {GOOD}'}", *told)


def _counted(count: int, what: str) -> str:
    return f"{count} {what}{'' if count == 1 else 's'}"


def inspection_data(hand: Hand) -> InspectedHand:
    """Return the inspection data of a hand.

    Raises
    ------
    InputError
        For a hand without links.
    """
    fits = getattr(hand, "fits", None) if isinstance(hand, LinkedHand) else None
    if not isinstance(hand, LinkedHand) or fits is None:
        given = f"{type(hand).__name__}, which has no links to draw"
        raise InputError("hand.show", given, "a hand with links: ng.URDFHand.load or one of ng.hands")
    return InspectedHand(hand.tree, fits, hand.torque_limits)


def without_fingertips(path: str | Path, palm: str | None, approach: ArrayLike) -> InspectedHand:
    """Return the inspection data of a URDF without fingertips; arguments are those of ``ng.URDFHand.load``.

    Raises
    ------
    InputError
        As ``ng.URDFHand.load``.
    """
    robot = read_robot(path, palm)
    tree = LinkTree(robot, (), approach_of(approach))
    return InspectedHand(tree, fit_hand(robot, SPHERES), torque_limits_of(robot, None), str(path), palm)


@dataclass(frozen=True)
class InspectedHand:
    """A hand under inspection: kinematics, collision spheres and torque limits.

    Parameters
    ----------
    tree : LinkTree
        Without fingertips if none are stated.
    fits : mapping of str to SphereFit
        Spheres around the links.
    torque_limits : mapping of str to float
        By joint, newton-metres (newtons for sliding joints).
    file : str
        Path as given, where no fingertips are stated.
    palm : str, optional
        The palm as it was given.
    """

    tree: LinkTree
    fits: Mapping[str, SphereFit]
    torque_limits: Mapping[str, float]
    file: str = ""
    palm: str | None = None

    @property
    def at_rest(self) -> FloatArray:
        """Positions of the free joints in a relaxed posture, (m,): zero for ranges nearly symmetric about zero."""
        lower, upper = self.tree.joint_limits if self.tree.robot.free_joints else np.zeros((2, 0))
        even = np.abs(lower + upper) <= EVEN * (upper - lower)
        return np.where(even, 0.0, lower + CLOSED * (upper - lower))

    @property
    def leaves(self) -> tuple[str, ...]:
        """Leaf links of the kinematic tree, where fingertips often are."""
        return leaves(self.tree.robot)


def findings(hand: InspectedHand, met: Opposition | None) -> tuple[FileWarning, ...]:
    """Return the warnings about a hand, grave ones first.

    Parameters
    ----------
    hand : InspectedHand
    met : Opposition or None
        Opposition of its fingertips; None where none are stated.
    """
    found = [
        *_palm_warning(hand),
        *_shape_warnings(hand),
        *_overhangs(hand),
        *_joint_warnings(hand),
        *([] if met is None else _tip_warnings(hand, met)),
    ]
    return tuple(sorted(found, key=lambda finding: not finding.grave))


@dataclass(frozen=True)
class FileWarning:
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


def _palm_warning(hand: InspectedHand) -> list[FileWarning]:
    """Return a warning where the palm probably faces another way than stated."""
    better = suggested_approach(hand.tree)
    if better is None:
        return []
    said, seen = format_direction(hand.tree.approach), format_direction(better)
    text = f"The palm is said to face {said}, but its fingertips lie towards {seen}:"
    faces = format_as_list(better)
    option = faces.strip("[]").replace(" ", "")
    return [FileWarning(f"{text} approach={faces}?", command=f"{text} --approach {option}?")]


def _shape_warnings(hand: InspectedHand) -> list[FileWarning]:
    robot = hand.tree.robot
    found = [FileWarning(f"Left out: {name}.", grave=True) for name in robot.missing]
    if robot.bare:
        one, text = len(robot.bare) == 1, ", ".join(robot.bare)
        them, has, may = (f"Link {text} is", "has", "it may") if one else (f"Links {text} are", "have", "they may")
        found.append(
            FileWarning(f"{them} visible but {has} no collision shape: {may} pass through the body.", grave=True)
        )
    if not robot.shapes:
        found.append(
            FileWarning("No link has a collision shape: all but the fingertips may pass through the body.", grave=True)
        )
    for link, fit in hand.fits.items():
        if fit.uncovered > WORTH_A_WARNING:
            deep = format_number(1e3 * fit.uncovered, 2)
            text = f"Link {link} is thicker than its fingertip: beside a contact it may reach {deep} mm into the body."
            found.append(FileWarning(text))
    return found


def _overhangs(hand: InspectedHand) -> list[FileWarning]:
    """Return warnings about fingertips that reach beyond the shapes of their links."""
    found = []
    for i, (link, tip) in enumerate(hand.tree.tips):
        beyond = overhang(tip, link, hand.tree.robot)
        if beyond is not None and beyond > OFF:
            text = f"Fingertip {i} ({link}) reaches up to {millimetres(beyond)} beyond the shapes of its link"
            found.append(
                FileWarning(f"{text}: where it touches there, the finger itself does not.", grave=beyond > FAR_OFF)
            )
    return found


def _joint_warnings(hand: InspectedHand) -> list[FileWarning]:
    robot = hand.tree.robot
    if not robot.free_joints:
        return [FileWarning(f"No joint below {robot.root} moves: a grasp needs joints that move.", grave=True)]
    found = [FileWarning(f"{text[0].upper()}{text[1:]}.") for text in joint_remarks(robot)]
    weak = [j.name for j in robot.free_joints if j.name not in hand.torque_limits]
    if weak:
        every = len(weak) == len(robot.free_joints) > 1
        whose = "No joint has an effort limit" if every else f"No effort limit at {_format_some(weak, 'joint')}"
        found.append(FileWarning(f'{whose}: the force budget "hand_torques" needs torque_limits.'))
    strong = [j.name for j in robot.free_joints if j.is_revolute and hand.torque_limits.get(j.name, 0.0) > PLACEHOLDER]
    if strong:
        text = f"An effort above {PLACEHOLDER:g} N m at {_format_some(strong, 'joint', len(robot.free_joints))}"
        found.append(FileWarning(f"{text} looks like a placeholder: state torque_limits."))
    wide = [
        name for name, (lower, upper, _) in robot.ranges.items() if _is_revolute(robot, name) and upper - lower >= FULL
    ]
    if wide:
        text = _format_some(wide, "joint", len(robot.free_joints))
        found.append(
            FileWarning(f"{text[0].upper()}{text[1:]} can turn a full circle or more: cables may not allow that.")
        )
    return found


def _tip_warnings(hand: InspectedHand, met: Opposition) -> list[FileWarning]:
    if len(hand.tree.tips) == 1:
        return [FileWarning("Only one fingertip is stated: to hold a body takes two at least.", grave=True)]
    found = []
    if met.pairs and not any(pair.faces for pair in met.pairs):
        found.append(
            FileWarning("No two fingertips ever face each other: they cannot press from two sides.", grave=True)
        )
    else:
        found += [_pair(hand, pair) for pair in met.pairs if not pair.touches]
    for several in met.apart:
        text = f"Fingertips {_format_tips(hand, several.fingers)} come together in smaller sets but not all at once"
        found.append(FileWarning(f"{text}: at least two of them stay {millimetres(several.nearest)} apart."))
    return found


def _pair(hand: InspectedHand, pair: TipMeeting) -> FileWarning:
    """Return the warning about two fingertips that cannot touch face to face."""
    names = f"Fingertips {_format_tips(hand, pair.fingers)}"
    if not pair.faces:
        near = "touch without facing" if pair.nearest <= TOUCH else f"come within {millimetres(pair.nearest)}"
        return FileWarning(f"{names} never face each other; they {near}.")
    far = millimetres(pair.opposed)
    return FileWarning(f"{names} cannot meet: they stay {far} apart and can hold nothing thinner between them.")


def lines_to_paste(hand: InspectedHand) -> tuple[str, str]:
    """Return the command and the line of Python that state the leaf links as fingertips."""
    ends, approach = leaf_links(hand), hand.tree.approach.tolist()
    command, more = ["nlpgrasp", "hand", hand.file], ""
    if hand.palm is not None:
        command += ["--palm", hand.palm]
        more += f", palm={json.dumps(hand.palm, ensure_ascii=False)}"
    if approach != ALONG_Z:
        faces = format_as_list(hand.tree.approach)
        command += ["--approach", faces.strip("[]").replace(" ", "")]
        more += f", approach={faces}"
    for tip in ends:
        command += ["--fingertip", tip.command]
    tips = ", ".join(f"{json.dumps(tip.link, ensure_ascii=False)}: {tip.code}" for tip in ends)
    return shlex.join(command), f"ng.URDFHand.load({json.dumps(hand.file, ensure_ascii=False)}, {{{tips}}}{more})"


def leaf_links(hand: InspectedHand) -> tuple[End, ...]:
    """Return the first leaf links, with the fingertips that their shapes suggest."""
    return tuple(end(hand.tree.robot, link) for link in hand.leaves[:LISTED])


def millimetres(distance: float) -> str:
    """Return a distance in metres as text, to a tenth of a millimetre."""
    return f"{format_number(round(1e3 * distance, 1))} mm"


def _format_tips(hand: InspectedHand, fingers: Sequence[int]) -> str:
    """Return fingertips by number and link, as text."""
    names = [f"{i} ({hand.tree.tips[i][0]})" for i in fingers]
    return f"{', '.join(names[:-1])} and {names[-1]}"


def _is_revolute(robot: Robot, name: str) -> bool:
    return next(j.is_revolute for j in robot.free_joints if j.name == name)


def _format_some(names: Sequence[str], what: str, count: int = 0) -> str:
    """Return names as text, or ``all n`` where they are all of a count."""
    if len(names) == count > 1:
        return f"all {count} {what}s"
    return f"{what}{'s' if len(names) > 1 else ''} {', '.join(names)}"
