"""Controls of a hand's page: postures, joint sliders by finger, and visibility switches."""

from __future__ import annotations

from html import escape

import numpy as np

from nlpgrasp.common.shown.numbers import rounded, typeset
from nlpgrasp.common.types import Json
from nlpgrasp.hands.inspection.fingers import Finger, fingers
from nlpgrasp.hands.inspection.inspected import Inspected
from nlpgrasp.hands.inspection.opposition import Opposition
from nlpgrasp.report.hand.tree import listed

ONE_DIGIT = 100.0  # degrees or millimetres below which one decimal is shown
GENERAL = ("relaxed", "zero", "lower limits", "upper limits")
SWITCHES = (
    ("links", "Links", True),
    ("spheres", "Spheres", False),
    ("tips", "Fingertips", True),
    ("approach", "Palm direction", True),
    ("triad", "Palm axes", True),
    ("axes", "Joint axes", False),
)


def postures(hand: Inspected, met: Opposition | None) -> Json:
    """Return positions of the free joints for each posture button; radians or metres."""
    found = {"relaxed": listed(hand.at_rest)}
    if hand.tree.robot.free_joints:
        lower, upper = hand.tree.joint_limits
        zero = np.clip(0.0, lower, upper)
        found |= {"zero": listed(zero), "lower limits": listed(lower), "upper limits": listed(upper)}
    for meeting in () if met is None else (*met.pairs, *met.apart):
        found[posture_name(meeting.fingers)] = listed(meeting.joints)
    return found


def posture_name(numbers: tuple[int, ...]) -> str:
    """Return the name of the posture in which given fingertips are nearest to each other."""
    return "tips " + " ".join(map(str, numbers))


def posture_button(name: str, text: str, pressed: bool = False) -> str:
    """Return a button that sets the joints to a posture."""
    return (
        f'<button type="button" data-posture="{escape(name)}" aria-pressed="{str(pressed).lower()}">'
        f"{escape(text)}</button>"
    )


def general_postures() -> str:
    """Return the buttons of the postures common to all hands."""
    named = "".join(posture_button(name, name.capitalize(), name == "relaxed") for name in GENERAL)
    return f'<div class="postures">{named}</div>'


def sliders(hand: Inspected) -> str:
    """Return the sliders of all free joints, by finger, with their mimic joints."""
    groups = "".join(_group(hand, finger) for finger in fingers(hand.tree))
    if not groups:
        return '<aside class="sliders"><p class="note">No joint moves.</p></aside>'
    return f'<aside class="sliders" aria-label="Joints">{general_postures()}{groups}</aside>'


def _group(hand: Inspected, finger: Finger) -> str:
    numbers = "".join(f'<span class="number">{i}</span>' for i in finger.tips)
    rows = "".join(_slider(hand, i) for i in finger.joints)
    return f"<fieldset><legend><h3>{numbers}<span>{escape(finger.name)}</span></h3></legend>{rows}</fieldset>"


def _slider(hand: Inspected, number: int) -> str:
    """Return the slider of a free joint, with the positions of its mimic joints."""
    robot = hand.tree.robot
    joint = robot.free_joints[number]
    lower, upper, _ = robot.ranges[joint.name]
    start = float(hand.at_rest[number])
    followers = "".join(
        f'<div class="follower"><span title="{escape(other.name)}">{escape(other.name)} follows</span>'
        f'<output data-joint="{i}"></output></div>'
        for i, other in enumerate(robot.joints)
        if other.moves and other.mimic is not None and robot.follows(other)[0] == joint.name
    )
    name = escape(joint.name)
    ends = f"<i>{position_words(lower, joint.turns)}</i><i>{position_words(upper, joint.turns)}</i>"
    return (
        f'<div class="joint"><label for="joint{number}" title="{name}">{name}</label>'
        f'<output for="joint{number}">{position_words(start, joint.turns)}</output>'
        f'<div class="track-of"><input id="joint{number}" type="range" data-driver="{number}" '
        f'min="{lower:.12g}" max="{upper:.12g}" step="any" value="{start:.12g}">'
        f'<span class="ends" aria-hidden="true">{ends}</span></div></div>{followers}'
    )


def position_words(position: float, turns: bool) -> str:
    """Return a joint's position as text: degrees, or millimetres."""
    number = float(np.degrees(position)) if turns else 1e3 * position
    text = rounded(round(number, 1 if abs(number) < ONE_DIGIT else 0), 8)
    return typeset(f"{text}°" if turns else f"{text} mm")
