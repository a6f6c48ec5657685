"""Fingers as kinematic chains: joints, first links, mean direction."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from nlpgrasp.common.formatting import format_number
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.hands.kinematics import LinkTree, link_poses
from nlpgrasp.hands.robot import Joint, Robot

POSTURES = 512  # random postures, uniform over the joint ranges
LEAST_ARM = 3  # moving joints above a palm that are an arm, or its carriage; a wrist has fewer
MIN_MEAN_SHARE = 0.2  # share of the mean finger length below which the mean direction is not used
DOUBTFUL_ANGLE, LEAST_GAIN = 45.0, 15.0  # degrees: least angle of a doubtful palm direction, least gain of another axis


@dataclass(frozen=True)
class Finger:
    """A finger's kinematic chain: free joints and contacts.

    Parameters
    ----------
    name : str
        A link of it: that of its fingertip, else the one farthest from the palm.
    tips : tuple of int
        Its contacts.
    joints : tuple of int
        Numbers of the free joints, from the palm outwards.
    """

    name: str
    tips: tuple[int, ...]
    joints: tuple[int, ...]


def fingers(tree: LinkTree) -> tuple[Finger, ...]:
    """Return the fingers of a hand: first those with fingertips, in the order of the contacts.

    Joints shared by several fingers come last.
    """
    robot = tree.robot
    branching_link, shared = _trunk(robot)
    groups: dict[str, list[int]] = {}
    for i, joint in enumerate(robot.free_joints):
        groups.setdefault("" if joint.name in shared else _branch(robot, joint, branching_link), []).append(i)
    result = []
    for branch, indices in groups.items():
        names = {robot.free_joints[i].name for i in indices}
        tips = tuple(i for i, (link, _) in enumerate(tree.tips) if branch and names & driving_joints(robot, link))
        last = robot.free_joints[indices[-1]].child
        name = ", ".join(dict.fromkeys(tree.tips[i][0] for i in tips)) or last
        result.append(Finger(name if branch else f"{robot.root} to {last}", tips, tuple(indices)))
    return tuple(sorted(result, key=lambda finger: finger.tips[0] if finger.tips else len(tree.tips)))


def first_finger_links(tree: LinkTree) -> tuple[str, ...]:
    """Return the first link of each fingertip's finger, in the order of the contacts.

    The palm stands for a fingertip that is on no finger.
    """
    robot = tree.robot
    branching_link, _ = _trunk(robot)
    groups = robot.rigid_groups
    result = []
    for link, _ in tree.tips:
        chain = [joint for joint in robot.chain(link) if joint.moves]
        result.append(next((joint.child for joint in chain if groups[joint.parent] == branching_link), robot.root))
    return tuple(result)


def _trunk(robot: Robot) -> tuple[str, set[str]]:
    """Return the link at which the fingers branch, and the joints before it (arm or wrist).

    A hand without branches is one finger that begins at the root.
    """
    groups, link = robot.rigid_groups, robot.root
    joints: set[str] = set()
    while True:
        outgoing = [j for j in robot.joints if j.moves and groups[j.parent] == link]
        if len(outgoing) != 1:
            return (link, joints) if outgoing else (robot.root, set())
        joints.add(robot.driving_joint(outgoing[0])[0])
        link = outgoing[0].child


def _branch(robot: Robot, joint: Joint, branching_link: str) -> str:
    """Return the name of the first moving joint of the finger to which a joint belongs."""
    chain = [j for j in robot.chain(joint.child) if j.moves]
    return next((j.name for j in chain if robot.rigid_groups[j.parent] == branching_link), chain[0].name)


def driving_joints(robot: Robot, link: str) -> set[str]:
    """Return the names of the free joints that move a link."""
    return {robot.driving_joint(joint)[0] for joint in robot.chain(link) if joint.moves}


def common_ancestor(robot: Robot, links: Sequence[str]) -> str:
    """Return the nearest link from which all given links hang."""
    ancestor = robot.root
    for joints in zip(*(robot.chain(link) for link in links), strict=False):
        if len({joint.child for joint in joints}) > 1:
            break
        ancestor = joints[0].child
    return ancestor


def arm_above(robot: Robot, links: Sequence[str]) -> tuple[str, tuple[str, ...]] | None:
    """Return the likely palm of the fingertips on given links, and the joints of the arm above it; None without an arm.

    The palm is where the fingertips' fingers branch, or where other fingers branch from the only one with fingertips.
    """
    groups = robot.rigid_groups
    palm = common_ancestor(robot, links)
    if any(groups[link] == groups[palm] for link in links):
        on_way = {joint.name for joint in robot.chain(palm)}
        branching = {groups[j.parent] for j in robot.joints if j.moves and j.name not in on_way}
        above = [j.parent for j in robot.chain(palm) if j.moves and groups[j.parent] in branching]
        palm = above[-1] if above else robot.root
    joints = tuple(joint.name for joint in robot.chain(palm) if joint.moves)
    return (palm, joints) if len(joints) >= LEAST_ARM else None


def mean_finger_direction(tree: LinkTree) -> FloatArray | None:
    """Return the mean direction from the fingers' first joints to the fingertips, over random postures.

    Fingers bend towards the side that the palm faces, so this direction lies between the palm's direction and that of
    straight fingers: within 35 degrees of the palm's direction for Allegro, Shadow, Panda and Robotiq hands.

    Returns
    -------
    (3,) array or None
        Unit, palm frame; None without moving joints, or where the directions cancel.
    """
    links = first_finger_links(tree)
    if not links or not tree.robot.free_joints:
        return None
    joints = tree.random_joints(POSTURES, np.random.default_rng(0))
    q = ca.SX.sym("q", joints.shape[1])
    poses = link_poses(tree.robot, set(links), q)
    base_function = ca.Function("knuckles", [q], [ca.vertcat(*[poses[link][:3, 3] for link in links])])
    bases = np.asarray(base_function.map(POSTURES)(joints.T).full()).T.reshape(POSTURES, len(links), 3)
    spans = tree.palm_tips(joints) - bases
    mean, length = spans.mean(axis=(0, 1)), float(np.mean(np.linalg.norm(spans, axis=2)))
    norm = float(np.linalg.norm(mean))
    return None if norm <= MIN_MEAN_SHARE * length else mean / norm


def suggested_approach(tree: LinkTree) -> FloatArray | None:
    """Return the palm-frame axis nearest to the fingers, (3,), if the stated approach is implausible; else None.

    Parameters
    ----------
    tree : LinkTree
        With fingertips and the stated direction.
    """
    mean = mean_finger_direction(tree)
    if mean is None:
        return None
    index = int(np.argmax(np.abs(mean)))
    axis = np.zeros(3)
    axis[index] = np.sign(mean[index])
    cosines = np.clip([mean @ tree.approach, mean @ axis], -1.0, 1.0)
    stated_angle, axis_angle = (float(np.degrees(np.arccos(cosine))) for cosine in cosines)
    return axis if stated_angle > DOUBTFUL_ANGLE and stated_angle - axis_angle >= LEAST_GAIN else None


def format_direction(direction: FloatArray) -> str:
    """Return a unit direction (3,) as text: ``+z`` if along an axis, else three numbers."""
    index = int(np.argmax(np.abs(direction)))
    if abs(direction[index]) > 1.0 - 1e-9:
        return f"{'+' if direction[index] > 0.0 else '-'}{'xyz'[index]}"
    return format_as_list(direction)


def format_as_list(direction: FloatArray) -> str:
    """Return a direction (3,) as a Python list with few digits, such as ``[1, 0, 0]``."""
    return f"[{', '.join(format_number(v, 3, 1e-4) for v in direction)}]"
