"""Warnings on exported hands: mismatched closing axes, missing squeezes and blocked approaches."""

from __future__ import annotations

from collections.abc import Mapping

from nlpgrasp.common.shown.said import warn
from nlpgrasp.hands.jaw_pose import direction_of, named
from nlpgrasp.interop.base import ExportOptions
from nlpgrasp.interop.robots.states import NOT_ADDED, HandStates

CLOSING_AXES = {  # part of a gripper's name in public models to its closing axis, base frame
    "panda": "y",  # franka_description: both fingers slide along y of panda_hand or fr3_hand
    "franka": "y",
    "fr3_hand": "y",
    "robotiq_arg2f": "y",  # robotiq_2f_85_gripper_visualization of ROS-Industrial
    "robotiq_85_base_link": "x",  # robotiq_description of ros2_robotiq_gripper
}
ALONG = 1e-3  # tolerance of parallel unit directions
MOST = 3  # most grasps named in a warning


def warn_of_axes(hand: HandStates, options: ExportOptions) -> None:
    """Warn where options name a gripper whose known closing axis differs from that of the pose.

    The sign does not matter: the jaws of such a gripper are symmetric.

    Parameters
    ----------
    hand : HandStates
    options : ExportOptions
        Whose ``gripper`` and ``joints`` may name a known gripper.
    """
    if hand.closing is None:
        return
    for name in filter(None, (options.gripper, *options.joints)):
        for part, axis in CLOSING_AXES.items():
            if part in name.lower() and not abs(float(direction_of("axis", axis) @ hand.closing)) >= 1.0 - ALONG:
                stated = named(hand.closing)
                text = f"{name} closes along its {axis} axis, the exported pose along {stated} of the gripper's frame"
                warn(f'{text}: solve with ng.ParallelJaw(..., closing_axis="{axis}")')
                return


def warn_of_squeezes(hands: Mapping[str, HandStates], empty: str) -> None:
    """Warn of grasps without a squeeze.

    Parameters
    ----------
    hands : mapping of str to HandStates
        By the names of the grasps.
    empty : str
        What the export contains instead, as text.
    """
    left = [name for name, hand in hands.items() if hand.no_squeeze == NOT_ADDED]
    if left:
        stated = "states" if len(left) == 1 else "state"
        warn(f"{_names(left)} {stated} no squeeze, so {empty}: ng.analyse(solution, problem=problem) adds it")


def warn_of_ways(hands: Mapping[str, HandStates]) -> None:
    """Warn of grasps without a free straight approach, for formats without a field for it."""
    blocked = {name: hand.blocked for name, hand in hands.items() if hand.blocked}
    if blocked:
        first = next(iter(blocked.values()))
        warn(f"the straight way in of {_names(list(blocked))} is not free, so the pregrasp may not be reached: {first}")


def not_free(hand: HandStates) -> str:
    """Return the reason why approach or pregrasp is unreliable, as text; empty where both are fine."""
    return hand.blocked or ("" if hand.has_pregrasp else "no pregrasp is stated: its joints are those of the grasp")


def axes_comment(hand: HandStates) -> str:
    """Return the axes of a gripper's own frame as a comment line; empty for other hands."""
    axes = {name: [round(x, 9) for x in (axis + 0.0).tolist()] for name, axis in hand.axes().items()}
    return "".join(f"# {name} of the gripper's frame: {axis}\n" for name, axis in axes.items())


def _names(names: list[str]) -> str:
    more = [f"{len(names) - MOST} more"] if len(names) > MOST else []
    *first, last = [*names[:MOST], *more]
    return f"{', '.join(first)} and {last}" if first else last
