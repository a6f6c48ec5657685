"""Check of the stated palm direction against the mean direction of the fingers."""

from __future__ import annotations

import casadi as ca
import numpy as np

from nlpgrasp.common.shown.numbers import rounded
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.hands.inspection.fingers import knuckles
from nlpgrasp.hands.urdf.kinematics import link_poses
from nlpgrasp.hands.urdf.link_tree import LinkTree

POSTURES = 512  # random postures, uniform over the joint ranges
ALIKE = 0.2  # share of the mean finger length below which the mean direction is not used
ASKEW, NEARER = 45.0, 15.0  # degrees: least angle of a doubtful palm direction, least gain of another axis


def fingers_lie(tree: LinkTree) -> FloatArray | None:
    """Return the mean direction, over random postures, of the fingertips from their fingers' first joints.

    Fingers bend towards the side that the palm faces, so this direction lies between the palm's direction and that of
    straight fingers: within 35 degrees of the palm's direction for Allegro, Shadow, Panda and Robotiq hands.

    Returns
    -------
    (3,) array or None
        Unit, palm frame; None without moving joints, or where the directions cancel.
    """
    links = knuckles(tree)
    if not links or not tree.robot.free_joints:
        return None
    lower, upper = tree.joint_limits
    joints = np.random.default_rng(0).uniform(lower, upper, (POSTURES, len(lower)))
    q = ca.SX.sym("q", len(lower))
    poses = link_poses(tree.robot, set(links), q)
    first = ca.Function("knuckles", [q], [ca.vertcat(*[poses[link][:3, 3] for link in links])])
    begin = np.asarray(first.map(POSTURES)(joints.T).full()).T.reshape(POSTURES, len(links), 3)
    ways = tree.palm_tips(joints) - begin
    mean, length = ways.mean(axis=(0, 1)), float(np.mean(np.linalg.norm(ways, axis=2)))
    size = float(np.linalg.norm(mean))
    return None if size <= ALIKE * length else mean / size


def better_approach(tree: LinkTree) -> FloatArray | None:
    """Return the axis of the palm frame, (3,), nearest to the fingers; None where the stated approach is plausible.

    Parameters
    ----------
    tree : LinkTree
        With fingertips and the stated direction.
    """
    lie = fingers_lie(tree)
    if lie is None:
        return None
    most = int(np.argmax(np.abs(lie)))
    axis = np.zeros(3)
    axis[most] = np.sign(lie[most])
    off, near = (float(np.degrees(np.arccos(np.clip(lie @ way, -1.0, 1.0)))) for way in (tree.approach, axis))
    return axis if off > ASKEW and off - near >= NEARER else None


def direction_words(direction: FloatArray) -> str:
    """Return a unit direction (3,) as text: ``+z`` along an axis, else three numbers."""
    most = int(np.argmax(np.abs(direction)))
    if abs(direction[most]) > 1.0 - 1e-9:
        return f"{'+' if direction[most] > 0.0 else '-'}{'xyz'[most]}"
    return listed(direction)


def listed(direction: FloatArray) -> str:
    """Return a direction (3,) as a Python list with few digits, such as ``[1, 0, 0]``."""
    return f"[{', '.join(rounded(v, 3, 1e-4) for v in direction)}]"
