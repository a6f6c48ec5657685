"""Joint-torque limits of a hand in a given posture."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from nlpgrasp.budgets.joint_torques import JointTorqueLimits
from nlpgrasp.errors import InputError
from nlpgrasp.hands import URDFHand
from nlpgrasp.validation import array

STILL = 1e-12  # metres or radians a joint rate: a joint that does not move the contact


def hand_torque_limits(hand: URDFHand, posture: Mapping[str, Any], points: ArrayLike) -> JointTorqueLimits:
    """Return the force budget that a hand's joint-torque limits are in a grasp.

    The forces f_i that the joints can hold are those with ``|J_i^T f_i| <= tau``, with J_i the Jacobian of contact i
    in the posture (Murray, Li and Sastry 1994, Section 5.2).

    Parameters
    ----------
    hand : URDFHand
        With torque limits for every joint that moves a contact.
    posture : mapping
        ``joint_positions`` and ``palm_pose``, as in ``GraspSolution.hand``.
    points : (k, 3) array
        Contact points, metres, body frame; contact i is fixed to fingertip i's link.

    Raises
    ------
    InputError
        When joints without a limit move a contact, or one joint moves several contacts (their forces then share
        its torque, which this budget does not know).
    """
    places = array("points", points, (hand.count, 3))
    try:
        joints = np.array([float(posture["joint_positions"][j.name]) for j in hand.robot.free_joints])
        pose = posture["palm_pose"]
        turn = Rotation.from_quat(np.asarray(pose["quaternion_wxyz"], float), scalar_first=True).as_matrix()
        origin = np.asarray(pose["position"], float)
    except (KeyError, TypeError, ValueError) as error:
        given = f"{type(error).__name__}: {error}"
        raise InputError("posture", given, "joint_positions and palm_pose as in GraspSolution.hand") from None
    names = [j.name for j in hand.robot.free_joints]
    jacobians, limits = [], []
    used: dict[str, int] = {}
    for i, ((link, _), place) in enumerate(zip(hand.tips, places, strict=True)):
        J = hand.tree.jacobian(link, joints, (place - origin) @ turn)
        J = np.concatenate([turn @ J[:3], turn @ J[3:]])
        moving = [j for j in range(len(names)) if np.max(np.abs(J[:, j])) > STILL]
        for j in moving:
            if names[j] not in hand.torque_limits:
                raise InputError("URDFHand.torque_limits", f"none for {names[j]}", "one for each joint of a finger")
            if names[j] in used:
                given = f"joint {names[j]} that moves contacts {used[names[j]]} and {i}"
                raise InputError("hand", given, "fingers with one contact each and joints of their own")
            used[names[j]] = i
        jacobians.append(J[:, moving])
        limits.append(np.array([hand.torque_limits[names[j]] for j in moving]))
    return JointTorqueLimits(jacobians, limits)
