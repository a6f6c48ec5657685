"""Inspection of a hand: parts, opposition of the fingertips, suggested fingertips, warnings about the file."""

from __future__ import annotations

import json
import shlex
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from nlpgrasp.common.formatting import format_number
from nlpgrasp.common.robot_files import SI, UrdfUnits
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import InputError
from nlpgrasp.hands.base import Hand
from nlpgrasp.hands.file_units import check_units, unit_questions
from nlpgrasp.hands.finger_chains import format_as_list, format_direction, suggested_approach
from nlpgrasp.hands.kinematics import LinkTree
from nlpgrasp.hands.linked_hand import LinkedHand
from nlpgrasp.hands.opposition import TOUCH, Opposition, TipMeeting, opposition
from nlpgrasp.hands.presets import matching_preset
from nlpgrasp.hands.robot import Robot
from nlpgrasp.hands.robot_file import read_robot
from nlpgrasp.hands.suggested_tips import (
    GUESS,
    MOST_OVERHANG,
    leaf_links,
    noticeable_overhang,
    overhang,
    thick_link_warnings,
)
from nlpgrasp.hands.tip_proposal import TipProposal, propose_tips
from nlpgrasp.hands.urdf_hand import (
    missing_mesh_warning,
    modelling_warnings,
    resolve_torque_limits,
    unit_approach,
)
from nlpgrasp.hands.visible_shapes import visible_warning

EVEN_RANGE = 0.1  # share of a joint's range: with its middle this near zero the joint rests at zero
REST_SHARE = 0.35  # share of its range at which any other joint rests
FULL_CIRCLE = 2.0 * np.pi - 0.02  # radians: width of a joint's range that counts as a full turn
# newton-metres (newtons), from which on the effort of a revolute (sliding) joint of a hand is taken for a placeholder
PLACEHOLDER = {True: (100.0, "N m"), False: (1000.0, "N")}
MAX_LISTED = 12  # largest number of links that are named
ALONG_Z = [0.0, 0.0, 1.0]  # default palm direction
# verdict without warnings
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
        data = hand if isinstance(hand, InspectedHand) else inspection_data(hand)
    tip_opposition = opposition(data.tree, data.rest_posture) if data.tree.tips else None
    return Inspection(data, tip_opposition, findings(data, tip_opposition))


@dataclass(frozen=True)
class Inspection:
    """Result of inspecting a hand.

    Parameters
    ----------
    hand : InspectedHand
    opposition : Opposition or None
        Opposition of the fingertips; None where none are stated.
    findings : tuple of FileWarning
        Warnings, grave ones first.
    """

    hand: InspectedHand
    opposition: Opposition | None
    findings: tuple[FileWarning, ...]

    @property
    def verdict(self) -> str:
        """Verdict as text: the number of warnings, or that no fingertips are stated."""
        if not self.hand.tree.tips:
            return "no fingertips stated"
        count = len(self.findings)
        return f"{_format_count(count, 'thing')} to know" if count else "no problems found"

    @property
    def kind(self) -> str:
        """Severity of the findings: ``good``, ``some`` (there are warnings) or ``bad`` (grasps may come out wrong)."""
        if not self.hand.tree.tips:
            return "some"
        if any(finding.grave for finding in self.findings):
            return "bad"
        return "some" if self.findings else "good"

    @property
    def notices(self) -> tuple[FileWarning, ...]:
        """Warnings, preceded by a proposal of fingertips if none are stated."""
        if self.hand.tree.tips:
            return self.findings
        if self.hand.preset is not None:
            text = f"No fingertips are stated. The file has the links of the preset {self.hand.preset}. To use it:"
            return (FileWarning(text), *self.findings)
        proposal = self.hand.proposal
        if proposal.refusal:
            return (FileWarning(f"No fingertips are stated. {proposal.refusal}"), *self.findings)
        tips, unlisted = proposal.tips[:MAX_LISTED], len(proposal.tips) - MAX_LISTED
        names = ", ".join(tip.link for tip in tips) + (f" and {unlisted} more" if unlisted > 0 else "")
        sentences = [f"No fingertips are stated. Links at the ends: {names}.", *proposal.sentences]
        if any(tip.guessed for tip in tips):
            sentences.append(f"A radius of {GUESS:g} m stands for a link without a collision shape.")
        return (FileWarning(f"{' '.join(sentences)} To use them:"), *self.findings)

    @property
    def usage_lines(self) -> tuple[str, ...]:
        """Command and line of Python that state the proposed fingertips; empty if fingertips are stated or none fit."""
        if self.hand.tree.tips or (self.hand.preset is None and self.hand.proposal.refusal):
            return ()
        return format_usage(self.hand)

    @property
    def lines(self) -> tuple[str, ...]:
        """Summary of the hand's parts, verdict and warnings, as lines of text."""
        robot = self.hand.tree.robot
        followers = sum(joint.moves for joint in robot.joints) - len(robot.free_joints)
        joints = _format_count(len(robot.free_joints), "joint")
        if followers > 0:
            joints += f" and {followers} more that follow{'s' * (followers == 1)}"
        links, tips = _format_count(len(robot.links), "link"), _format_count(len(self.hand.tree.tips), "fingertip")
        parts = f"{links}, {joints}, {tips}"
        summary = f"{robot.name}: {parts}"
        notices = [f"  {'! ' if f.grave else '- '}{f.command or f.text}" for f in self.notices]
        if not self.hand.tree.tips:  # the first sentence says what to do
            return (summary, notices[0], *(f"      {line}" for line in self.usage_lines), *notices[1:])
        return (summary, f"{self.verdict}:{'' if notices else f' {GOOD}'}", *notices)


def _format_count(count: int, noun: str) -> str:
    """Return a count with a noun in singular or plural, as text."""
    return f"{count} {noun}{'' if count == 1 else 's'}"


def inspection_data(hand: Hand) -> InspectedHand:
    """Return the inspection data of a hand.

    Raises
    ------
    InputError
        For a hand without links.
    """
    if not isinstance(hand, LinkedHand):
        kind = f"{type(hand).__name__}, which has no links to draw"
        raise InputError("hand.show", kind, "a hand with links: ng.URDFHand.load or one of ng.hands")
    return InspectedHand(hand.tree, hand.torque_limits)


def inspect_without_tips(
    path: str | Path, palm: str | None, approach: ArrayLike, units: UrdfUnits = SI
) -> InspectedHand:
    """Return the inspection data of a robot file without fingertips; arguments as in ``ng.URDFHand.load``.

    The hand of a preset is that below the preset's palm.

    Raises
    ------
    InputError
        As ``ng.URDFHand.load``.
    """
    units = check_units(units.scale, units.degrees)
    match = matching_preset(path, palm, units)
    robot = read_robot(path, palm, units) if match is None else match.robot
    preset, palm = (None, palm) if match is None else (match.name, match.palm)
    tree = LinkTree(robot, (), unit_approach(approach))
    return InspectedHand(tree, resolve_torque_limits(robot, None), str(path), palm, preset)


@dataclass(frozen=True)
class InspectedHand:
    """Data of a hand under inspection: kinematics and torque limits.

    Parameters
    ----------
    tree : LinkTree
        Without fingertips if none are stated.
    torque_limits : mapping of str to float
        By joint, newton-metres (newtons for sliding joints).
    file : str
        Path as given, where no fingertips are stated.
    palm : str, optional
        The palm as it was given; with a preset, where the file has several of its hands.
    preset : str, optional
        Name of the preset that has this hand's fingertips, where these are not stated.
    """

    tree: LinkTree
    torque_limits: Mapping[str, float]
    file: str = ""
    palm: str | None = None
    preset: str | None = None

    @property
    def rest_posture(self) -> FloatArray:
        """Positions of the free joints in a relaxed posture, (m,).

        Joints with a range nearly symmetric about zero rest at zero.
        """
        lower, upper = self.tree.joint_limits if self.tree.robot.free_joints else np.zeros((2, 0))
        is_symmetric = np.abs(lower + upper) <= EVEN_RANGE * (upper - lower)
        return self.tree.close(np.where(is_symmetric, 0.0, lower + REST_SHARE * (upper - lower)))

    @cached_property
    def proposal(self) -> TipProposal:
        """Proposed fingertips, tested on cylinders and boxes."""
        return propose_tips(self.tree, self.rest_posture)

    @property
    def leaf_links(self) -> tuple[str, ...]:
        """Leaf links of the kinematic tree, where fingertips often are."""
        return leaf_links(self.tree.robot)


def findings(hand: InspectedHand, opposition: Opposition | None) -> tuple[FileWarning, ...]:
    """Return the warnings about a hand, grave warnings first.

    Parameters
    ----------
    hand : InspectedHand
    opposition : Opposition or None
        Opposition of its fingertips; None where none are stated.
    """
    result = [
        *_palm_warning(hand),
        *_shape_warnings(hand),
        *_overhangs(hand),
        *_joint_warnings(hand),
        *([] if opposition is None else _tip_warnings(hand, opposition)),
    ]
    return tuple(sorted(result, key=lambda finding: not finding.grave))


@dataclass(frozen=True)
class FileWarning:
    """Warning about a hand or its file, with its severity.

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
    """Return a warning if the palm probably faces another way than stated; else an empty list."""
    axis = suggested_approach(hand.tree)
    if axis is None:
        return []
    stated, measured = format_direction(hand.tree.approach), format_direction(axis)
    text = f"The palm is said to face {stated}, but its fingertips lie towards {measured}:"
    axis_list = format_as_list(axis)
    option = axis_list.strip("[]").replace(" ", "")
    return [FileWarning(f"{text} approach={axis_list}?", command=f"{text} --approach {option}?")]


def _shape_warnings(hand: InspectedHand) -> list[FileWarning]:
    """Return warnings about implausible units, missing collision shapes, and links thicker than their fingertips."""
    robot = hand.tree.robot
    result = [FileWarning(f"{_capitalised(text)}.", grave=True) for text in unit_questions(robot)]
    if robot.missing:
        result.append(FileWarning(f"{_capitalised(missing_mesh_warning(robot))}.", grave=True))
    if robot.shapeless:
        names = ", ".join(robot.shapeless)
        text = f"Links {names} are visible but have no collision shape: they may pass through the body."
        if len(robot.shapeless) == 1:
            text = f"Link {names} is visible but has no collision shape: it may pass through the body."
        result.append(FileWarning(text, grave=True))
    if text := visible_warning(robot, robot.links):
        result.append(FileWarning(f"{_capitalised(text)}."))
    if not robot.shapes:
        result.append(
            FileWarning("No link has a collision shape: all but the fingertips may pass through the body.", grave=True)
        )
    result += [FileWarning(f"{_capitalised(text)}.") for text in thick_link_warnings(robot, hand.tree.tips)]
    return result


def _capitalised(text: str) -> str:
    """Return text with a capital first letter."""
    return text[:1].upper() + text[1:]


def _overhangs(hand: InspectedHand) -> list[FileWarning]:
    """Return warnings about fingertips that protrude from the shapes of their links."""
    result = []
    for i, (link, tip) in enumerate(hand.tree.tips):
        distance = overhang(tip, link, hand.tree.robot)
        if distance is not None and distance > noticeable_overhang(tip):  # None for a link without shapes
            text = f"Fingertip {i} ({link}) reaches up to {millimetres(distance)} beyond the shapes of its link"
            result.append(
                FileWarning(
                    f"{text}: where it touches there, the finger itself does not.", grave=distance > MOST_OVERHANG
                )
            )
    return result


def _joint_warnings(hand: InspectedHand) -> list[FileWarning]:
    """Return warnings about joints: no moving joint, effort limits, full turns, couplings."""
    robot = hand.tree.robot
    if not robot.free_joints:
        return [FileWarning(f"No joint below {robot.root} moves: a grasp needs joints that move.", grave=True)]
    result = [FileWarning(f"{_capitalised(text)}.") for text in modelling_warnings(robot)]
    limited = [*hand.torque_limits, *robot.passive]
    unlimited = [j.name for j in robot.free_joints if j.name not in limited]
    if unlimited:
        subject = f"No effort limit at {_format_some(unlimited, 'joint')}"
        if len(unlimited) == len(robot.free_joints) > 1:
            subject = "No joint has an effort limit"
        result.append(FileWarning(f'{subject}: the force budget "hand_torques" needs torque_limits.'))
    result += [FileWarning(f"{text}: state torque_limits.") for text in _placeholder_efforts(hand)]
    full_turns = [
        name
        for name, (lower, upper, _) in robot.ranges.items()
        if _is_revolute(robot, name) and upper - lower >= FULL_CIRCLE
    ]
    if full_turns:
        text = _format_some(full_turns, "joint", len(robot.free_joints))
        result.append(
            FileWarning(f"{text[0].upper()}{text[1:]} can turn a full circle or more: cables may not allow that.")
        )
    return result


def _placeholder_efforts(hand: InspectedHand) -> list[str]:
    """Return phrases on efforts of the file that are too large for a hand, or one power of ten at all joints."""
    joints = hand.tree.robot.free_joints
    efforts = {j.name: j.effort for j in joints if j.effort and hand.torque_limits.get(j.name) == j.effort}
    result = []
    for is_revolute, (least, unit) in PLACEHOLDER.items():
        names = [j.name for j in joints if j.is_revolute == is_revolute and efforts.get(j.name, 0.0) >= least]
        if names:
            text = f"An effort of {least:g} {unit} or more at {_format_some(names, 'joint', len(joints))}"
            result.append(f"{text} looks like a placeholder")
    (effort, *others) = set(efforts.values()) or {0.0}
    if not result and not others and len(efforts) == len(joints) > 1 and np.log10(effort) % 1.0 == 0.0:
        result.append(f"All {len(joints)} joints state one effort, {effort:g}, which may be a placeholder")
    return result


def _tip_warnings(hand: InspectedHand, opposition: Opposition) -> list[FileWarning]:
    """Return warnings about fingertips that cannot press from two sides or cannot meet."""
    if len(hand.tree.tips) == 1:
        return [FileWarning("Only one fingertip is stated: to hold a body takes two at least.", grave=True)]
    result = []
    if opposition.pairs and not any(pair.faces for pair in opposition.pairs):
        result.append(
            FileWarning("No two fingertips ever face each other: they cannot press from two sides.", grave=True)
        )
    else:
        result += [_pair_warning(hand, pair) for pair in opposition.pairs if not pair.touches]
    for tips in opposition.separated:
        text = f"Fingertips {_format_tips(hand, tips.fingers)} come together in smaller sets but not all at once"
        result.append(FileWarning(f"{text}: at least two of them stay {millimetres(tips.nearest)} apart."))
    return result


def _pair_warning(hand: InspectedHand, pair: TipMeeting) -> FileWarning:
    """Return the warning about two fingertips that cannot touch face to face."""
    names = f"Fingertips {_format_tips(hand, pair.fingers)}"
    if not pair.faces:
        closest = "touch without facing" if pair.nearest <= TOUCH else f"come within {millimetres(pair.nearest)}"
        return FileWarning(f"{names} never face each other; they {closest}.")
    distance = millimetres(pair.opposed)
    return FileWarning(f"{names} cannot meet: they stay {distance} apart and can hold nothing thinner between them.")


def format_usage(hand: InspectedHand) -> tuple[str, str]:
    """Return the command and the line of Python that load the hand with its preset or proposed fingertips."""
    path = json.dumps(hand.file, ensure_ascii=False)
    units = hand.tree.robot.units.to_dict()
    options = [
        part for name, value in units.items() for part in (f"--{name}", *([] if value is True else [str(value)]))
    ]
    arguments = "".join(f", {name}={value}" for name, value in units.items())
    if hand.palm is not None:
        options += ["--palm", hand.palm]
        arguments += f", palm={json.dumps(hand.palm, ensure_ascii=False)}"
    if hand.preset is not None:
        command = ["nlpgrasp", "hand", hand.file, "--preset", hand.preset, *options]
        return shlex.join(command), f"ng.hands.{hand.preset}({path}{arguments})"
    tips, approach = hand.proposal.tips[:MAX_LISTED], hand.tree.approach.tolist()
    command = ["nlpgrasp", "hand", hand.file, *options]
    if approach != ALONG_Z:
        axis_list = format_as_list(hand.tree.approach)
        command += ["--approach", axis_list.strip("[]").replace(" ", "")]
        arguments += f", approach={axis_list}"
    for tip in tips:
        command += ["--fingertip", tip.command]
    mapping = ", ".join(f"{json.dumps(tip.link, ensure_ascii=False)}: {tip.code}" for tip in tips)
    return shlex.join(command), f"ng.URDFHand.load({path}, {{{mapping}}}{arguments})"


def millimetres(distance: float) -> str:
    """Return a distance in metres as text, to a tenth of a millimetre."""
    return f"{format_number(round(1e3 * distance, 1))} mm"


def _format_tips(hand: InspectedHand, fingers: Sequence[int]) -> str:
    """Return fingertips as text, by index and link."""
    names = [f"{i} ({hand.tree.tips[i][0]})" for i in fingers]
    return f"{', '.join(names[:-1])} and {names[-1]}"


def _is_revolute(robot: Robot, name: str) -> bool:
    """Return whether the free joint with a name is revolute."""
    return next(j.is_revolute for j in robot.free_joints if j.name == name)


def _format_some(names: Sequence[str], noun: str, count: int = 0) -> str:
    """Return names as text, or ``all n`` if all n of them are named."""
    if len(names) == count > 1:
        return f"all {count} {noun}s"
    return f"{noun}{'s' if len(names) > 1 else ''} {', '.join(names)}"
