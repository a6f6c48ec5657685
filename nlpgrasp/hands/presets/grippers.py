"""Presets of grippers with two and three fingers."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Unpack

import numpy as np

from nlpgrasp.hands.presets.preset import Options, Preset, by_ending
from nlpgrasp.hands.robot.robot import Joint, Robot
from nlpgrasp.hands.tips import FlatTip, SphereTip
from nlpgrasp.hands.urdf.urdf_hand import URDFHand

QUARTER = np.pi / 2.0
PANDA_FORCE = 70.0  # newtons on each finger


def _panda_pad(joint: Joint) -> FlatTip:
    """Return a finger's pad, which faces where the finger closes to: against its joint's axis (y or -y)."""
    side = 1.0 if joint.axis[1] > 0.0 else -1.0
    return FlatTip((0.0175, 0.0185), (0.0, 0.0, 0.04525), (side * QUARTER, 0.0, 0.0))


def _panda_limits(robot: Robot) -> Mapping[str, float]:
    """Return the continuous force of each finger, times the fingers that a joint drives, newtons."""
    driven = [robot.follows(joint)[0] for joint in robot.joints if joint.kind == "prismatic"]
    return {joint.name: PANDA_FORCE * driven.count(joint.name) for joint in robot.free_joints}


PANDA = Preset(
    "panda",
    ("panda_hand", "hand"),
    {"leftfinger": _panda_pad, "rightfinger": _panda_pad},
    (0.0, 0.0, 1.0),
    _panda_limits,
    "panda_description",
)
ROBOTIQ_PAD = FlatTip((0.022, 0.0375), (0.0, -0.003175, 0.0), (QUARTER, 0.0, 0.0))
ROBOTIQ_2F85 = Preset(
    "robotiq_2f85",
    ("robotiq_arg2f_base_link", "robotiq_85_base_link"),
    {"left_inner_finger_pad": ROBOTIQ_PAD, "right_inner_finger_pad": ROBOTIQ_PAD},
    (0.0, 0.0, 1.0),
    by_ending({"finger_joint": 25.0}),
    "robotiq_2f85_description",
)
ROBOTIQ_3F = Preset(
    "robotiq_3f",
    ("palm",),
    {f"finger_{name}_link_3": SphereTip(0.011, (0.0205, 0.016, 0.0)) for name in ("1", "2", "middle")},
    (0.0, 1.0, 0.0),
    by_ending({"joint_1": 7.0, "joint_2": 4.0, "joint_3": 1.6}),
)
BARRETT = Preset(
    "barrett",
    ("base_link",),
    {f"finger_{i}_dist_link": SphereTip(0.007, (-0.038, 0.034, 0.0)) for i in (1, 2, 3)},
    (0.0, 0.0, 1.0),
    by_ending({"prox_joint": 1.7, "med_joint": 1.7, "dist_joint": 0.77}),
    "barrett_hand_description",
)


def panda(urdf: str | Path | None = None, **options: Unpack[Options]) -> URDFHand:
    """Return the gripper of a Panda or FR3 arm (Franka Hand): two pads, one joint; the arm is left out.

    Contacts: the pads of the left and right finger (links ``leftfinger``, ``rightfinger``, with any prefix), flat
    rectangles of 17.5 mm by 18.5 mm where the maker's URDF has the rubber tips. The palm (``panda_hand``) faces along
    its z axis.

    Force limits: 70 N on each finger, the maker's continuous grasping force (140 N is the greatest, for a moment). A
    joint that drives both fingers therefore gets 140 N.

    Parameters
    ----------
    urdf : str or Path, optional
        The URDF of gripper or arm; from ``robot_descriptions`` when left out (extra ``descriptions``).
    **options
        ``palm``, ``torque_limits``, ``clearance``, ``spheres_per_link``, ``self_collision``: as for ``URDFHand.load``.

    Raises
    ------
    InputError
        When there is no URDF, or it lacks one of these links.
    """
    return PANDA.hand(urdf, **options)


def robotiq_2f85(urdf: str | Path | None = None, **options: Unpack[Options]) -> URDFHand:
    """Return the Robotiq 2F-85 gripper: two pads, one joint.

    Contacts: the pads ``left_inner_finger_pad`` and ``right_inner_finger_pad`` of the ROS-Industrial description, flat
    rectangles of 22 mm by 37.5 mm. The palm (``robotiq_arg2f_base_link``) faces along its z axis.

    Torque limit: 25 N m at ``finger_joint``. The maker's greatest grip force is 235 N; a pad's stroke of 42.5 mm over
    0.8 rad is 53 mm a radian, and the joint moves both pads: 2 x 235 N x 0.053 m. The URDF's 1000 is a placeholder.

    Parameters
    ----------
    urdf : str or Path, optional
        Its URDF; from ``robot_descriptions`` when left out (extra ``descriptions``).
    **options
        ``palm``, ``torque_limits``, ``clearance``, ``spheres_per_link``, ``self_collision``: as for ``URDFHand.load``.

    Raises
    ------
    InputError
        When there is no URDF, or it lacks one of these links.
    """
    return ROBOTIQ_2F85.hand(urdf, **options)


def robotiq_3f(urdf: str | Path | None = None, **options: Unpack[Options]) -> URDFHand:
    """Return the Robotiq 3-Finger gripper, with all of its joints free (its linkage couples those of a finger).

    Contacts: ``finger_1_link_3``, ``finger_2_link_3`` and ``finger_middle_link_3``, spheres of 11 mm in the end of the
    last link, 26 mm from its joint. The palm (``palm``) faces along its y axis.

    Torque limits of a finger's joints: 7, 4 and 1.6 N m, which its greatest force of 60 N at the tip (the maker's
    manual, register FORCE) takes of each with the finger straight. The joints that spread the fingers keep the URDF's
    effort, a placeholder.

    Parameters
    ----------
    urdf : str or Path, optional
        Its URDF. ``robot_descriptions`` has none.
    **options
        ``palm``, ``torque_limits``, ``clearance``, ``spheres_per_link``, ``self_collision``: as for ``URDFHand.load``.

    Raises
    ------
    InputError
        When there is no URDF, or it lacks one of these links.
    """
    return ROBOTIQ_3F.hand(urdf, **options)


def barrett(urdf: str | Path | None = None, **options: Unpack[Options]) -> URDFHand:
    """Return the BarrettHand (BH8-28x): three fingers.

    Contacts: ``finger_1_dist_link``, ``finger_2_dist_link`` and ``finger_3_dist_link``, spheres of 7 mm in the end of
    each link, 51 mm from its joint. The palm (``base_link``) faces along its z axis.

    Torque limits: the maker's 15 N at the fingertip takes 1.7 N m of a finger's inner joint, 114 mm away with the
    finger straight, and 0.77 N m of the outer one (its torque sensor ends at 1 N m). The joints that spread the
    fingers, with the same motors, are taken to hold 1.7 N m. The URDF states an effort of 0. One motor drives both
    joints of a finger; the URDF lets them move on their own.

    Parameters
    ----------
    urdf : str or Path, optional
        Its URDF; from ``robot_descriptions`` when left out (extra ``descriptions``).
    **options
        ``palm``, ``torque_limits``, ``clearance``, ``spheres_per_link``, ``self_collision``: as for ``URDFHand.load``.

    Raises
    ------
    InputError
        When there is no URDF, or it lacks one of these links.
    """
    return BARRETT.hand(urdf, **options)
