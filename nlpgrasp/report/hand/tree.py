"""Kinematic tree of a hand as data for the page's kinematics."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.hands.inspection.inspected import Inspected
from nlpgrasp.hands.robot.robot import Joint

DIGITS = 12  # decimals of lengths in metres and of cosines


def joint_tree(hand: Inspected) -> Json:
    """Return links, joints and their drivers.

    Returns
    -------
    dict
        ``links``: names, the palm first. ``joints``: parents before children, each with the numbers of its links
        ``parent`` and ``child``, ``origin`` (the child's frame in the parent's at position 0, the 12 numbers of its
        upper three rows), ``kind`` (fixed, turns, slides), unit ``axis`` in the joint's frame, and for one that moves
        ``driver``, ``multiplier`` and ``offset``: its position is ``multiplier * positions[driver] + offset``.
        ``drivers``: the free joints, with name, whether they turn, and limits, radians or metres.
    """
    robot = hand.tree.robot
    index = {name: i for i, name in enumerate(robot.links)}
    drivers = {joint.name: i for i, joint in enumerate(robot.free_joints)}
    joints = []
    for joint in robot.joints:
        entry = {
            "name": joint.name,
            "parent": index[joint.parent],
            "child": index[joint.child],
            "origin": listed(_origin(joint)[:3].ravel()),
            "kind": "fixed" if not joint.moves else "turns" if joint.turns else "slides",
            "axis": listed(joint.axis),
        }
        if joint.moves:
            driver, multiplier, offset = robot.follows(joint)
            entry |= {"driver": drivers[driver], "multiplier": multiplier, "offset": offset}
        joints.append(entry)
    ranges = [robot.ranges[joint.name] for joint in robot.free_joints]
    free = [
        {"name": joint.name, "turns": joint.turns, "lower": lower, "upper": upper}
        for joint, (lower, upper, _) in zip(robot.free_joints, ranges, strict=True)
    ]
    return {"links": list(robot.links), "joints": joints, "drivers": free}


def _origin(joint: Joint) -> FloatArray:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = Rotation.from_euler("xyz", joint.rpy).as_matrix(), joint.xyz
    return pose


def listed(values: FloatArray, digits: int = DIGITS) -> list[float]:
    """Return numbers as a rounded list, without -0."""
    return [float(v) + 0.0 for v in np.round(np.asarray(values, dtype=float), digits)]
