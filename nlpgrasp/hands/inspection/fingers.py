"""Grouping of joints into fingers: kinematic chains that begin at the palm."""

from __future__ import annotations

from dataclasses import dataclass

from nlpgrasp.hands.robot.robot import Joint, Robot
from nlpgrasp.hands.urdf.link_tree import LinkTree


@dataclass(frozen=True)
class Finger:
    """Joints of one finger's kinematic chain.

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
    """Return the free joints by finger: those with fingertips first, in the contacts' order; shared joints last."""
    robot = tree.robot
    hub, shared = _trunk(robot)
    groups: dict[str, list[int]] = {}
    for i, joint in enumerate(robot.free_joints):
        groups.setdefault("" if joint.name in shared else _branch(robot, joint, hub), []).append(i)
    found = []
    for branch, numbers in groups.items():
        names = {robot.free_joints[i].name for i in numbers}
        tips = tuple(i for i, (link, _) in enumerate(tree.tips) if branch and names & _drivers(robot, link))
        last = robot.free_joints[numbers[-1]].child
        name = ", ".join(dict.fromkeys(tree.tips[i][0] for i in tips)) or last
        found.append(Finger(name if branch else f"{robot.root} to {last}", tips, tuple(numbers)))
    return tuple(sorted(found, key=lambda finger: finger.tips[0] if finger.tips else len(tree.tips)))


def knuckles(tree: LinkTree) -> tuple[str, ...]:
    """Return the first link of each fingertip's finger, in the contacts' order; the palm for a tip on no finger."""
    robot = tree.robot
    hub, _ = _trunk(robot)
    groups = robot.rigid_groups
    found = []
    for link, _ in tree.tips:
        chain = [joint for joint in robot.chain(link) if joint.moves]
        found.append(next((joint.child for joint in chain if groups[joint.parent] == hub), robot.root))
    return tuple(found)


def _trunk(robot: Robot) -> tuple[str, set[str]]:
    """Return the link at which the fingers branch, and the joints above it: an arm or a wrist.

    A hand without branches is one finger that begins at the root.
    """
    groups, here = robot.rigid_groups, robot.root
    joints: set[str] = set()
    while True:
        out = [j for j in robot.joints if j.moves and groups[j.parent] == here]
        if len(out) != 1:
            return (here, joints) if out else (robot.root, set())
        joints.add(robot.follows(out[0])[0])
        here = out[0].child


def _branch(robot: Robot, joint: Joint, hub: str) -> str:
    """Return the name of the first moving joint of a joint's finger, beyond the link at which fingers branch."""
    chain = [j for j in robot.chain(joint.child) if j.moves]
    return next((j.name for j in chain if robot.rigid_groups[j.parent] == hub), chain[0].name)


def _drivers(robot: Robot, link: str) -> set[str]:
    """Return the names of the free joints that move a link."""
    return {robot.follows(joint)[0] for joint in robot.chain(link) if joint.moves}
