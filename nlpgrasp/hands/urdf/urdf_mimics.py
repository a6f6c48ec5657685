"""Mimic joints of a URDF: validation and limits."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from nlpgrasp.hands.robot.robot import Joint, Robot
from nlpgrasp.hands.urdf.urdf_values import bad


def check_mimics(source: Path, joints: tuple[Joint, ...]) -> None:
    """Refuse joints that follow missing joints, or each other."""
    by_name = {j.name: j for j in joints if j.moves}
    for joint in by_name.values():
        seen, here = [joint.name], joint
        while here.mimic is not None:
            wanted = here.mimic.joint
            if wanted not in by_name:
                others = [name for name in by_name if name != here.name]
                like = [name for name in others if wanted and name.endswith(wanted)]
                bad(source, f"joint {here.name} that mimics {wanted!r}", "a moving joint: " + ", ".join(like or others))
            here = by_name[wanted]
            if here.name in seen:
                bad(source, f"joints that mimic each other: {', '.join(seen)}", "a joint to follow")
            seen.append(here.name)


def with_signs(joints: tuple[Joint, ...]) -> tuple[tuple[Joint, ...], tuple[str, ...]]:
    """Return the joints with the limits of mimic joints in their direction of motion, and those that were negated.

    Files often give a mimic joint with a negative multiplier the limits of the joint it follows, without the sign, so
    that at most one position keeps both. Such limits are negated where that leaves a range.

    Returns
    -------
    joints : tuple of Joint
    turned : tuple of str
        Each joint whose limits were taken with the other sign, with what it follows and its limits.
    """
    by_name = {j.name: j for j in joints}
    result, turned = [], []
    for joint in joints:
        mimic = joint.mimic
        if joint.moves and mimic is not None and mimic.multiplier < 0.0:
            other = by_name[mimic.joint]
            ends = [mimic.multiplier * end + mimic.offset for end in (other.upper, other.lower)]
            stated = min(ends[1], joint.upper) - max(ends[0], joint.lower)
            signed = min(ends[1], -joint.lower) - max(ends[0], -joint.upper)
            if stated <= 0.0 < signed:
                text = f"limits {joint.lower:g} to {joint.upper:g} of joint {joint.name}, which follows joint"
                turned.append(f"{text} {other.name} with multiplier {mimic.multiplier:g}")
                joint = replace(joint, lower=0.0 - joint.upper, upper=0.0 - joint.lower)
        result.append(joint)
    return tuple(result), tuple(turned)


def check_ranges(source: Path, robot: Robot) -> None:
    """Refuse joints whose mimic joints leave them an empty range."""
    for joint in robot.free_joints:
        lower, upper, why = robot.ranges[joint.name]
        if lower > upper or (lower == upper and joint.lower < joint.upper):
            bad(source, f"joint {joint.name} with joint {why} that follows it", "limits that both can keep")
