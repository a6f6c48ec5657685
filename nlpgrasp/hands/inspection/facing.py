"""Whether a palm faces where it is said to: where its fingertips are, seen from where their fingers begin."""

from __future__ import annotations

import casadi as ca
import numpy as np

from nlpgrasp.common.shown.numbers import rounded
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.hands.inspection.fingers import knuckles
from nlpgrasp.hands.urdf.kinematics import link_poses
from nlpgrasp.hands.urdf.link_tree import LinkTree

POSTURES = 512  # random ones, over the joint ranges
ALIKE = 0.2  # of the fingers' lengths: a mean direction shorter than that says nothing
ASKEW, NEARER = 45.0, 15.0  # degrees: how far off a palm is asked about, and by how much another axis has to be nearer


def fingers_lie(tree: LinkTree) -> FloatArray | None:
    """Return the direction in which fingertips lie from their fingers' first joints, in the mean over postures.

    A finger bends towards the side that the palm faces, so that this direction is between it and the way in which
    straight fingers point: within 35 degrees of where the palm faces for Allegro, Shadow, Panda and Robotiq hands.

    Returns
    -------
    (3,) array or None
        Unit, palm frame; None where nothing moves, or fingers lie in all directions alike.
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
    """Return the axis of the palm's frame, (3,), that its fingers say it faces; None where what is stated may be.

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
    """Return a unit direction (3,) as text: ``+z`` of an axis, else its numbers."""
    most = int(np.argmax(np.abs(direction)))
    if abs(direction[most]) > 1.0 - 1e-9:
        return f"{'+' if direction[most] > 0.0 else '-'}{'xyz'[most]}"
    return listed(direction)


def listed(direction: FloatArray) -> str:
    """Return a direction (3,) as Python writes it, in few digits, such as ``[1, 0, 0]``."""
    return f"[{', '.join(rounded(v, 3, 1e-4) for v in direction)}]"
