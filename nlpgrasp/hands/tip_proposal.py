"""Proposal of fingertips for a robot file: leaf links of one hand that face others, tested on cylinders and boxes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, product

import numpy as np

from nlpgrasp.common.formatting import format_number
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.hands.closing_trial import FRICTION, MOST_TIPS, ClosingWidths, closing_widths
from nlpgrasp.hands.collision_shapes import CollisionShape
from nlpgrasp.hands.finger_chains import arm_above, common_ancestor, driving_joints
from nlpgrasp.hands.fitted_tips import link_poses_at
from nlpgrasp.hands.kinematics import LinkTree
from nlpgrasp.hands.opposition import mean_alignment, opposed_tips
from nlpgrasp.hands.robot import Robot
from nlpgrasp.hands.suggested_tips import GUESS, SuggestedTip, leaf_links, suggest_tip
from nlpgrasp.hands.urdf_hand import resolve_tips

NO_SHAPE, FACES_NONE, FOLLOWS = "no collision shape", "faces no other", "moves along behind a fingertip"
FIXED, CLOSES_WITH_NONE = "does not move against the palm", "does not close with the others"
SURFACE_SAMPLES, OVERLAP = 500, 1e-4  # points on a shape; metres by which parts that are joined overlap
POSTURES = 200  # random postures
LONGEST_FINGER = 0.4  # metres from the palm to a fingertip; 0.22 at most in hands of the tests, 0.54 in the least legs
SMALLEST_TIP = 3e-3  # metres: length of the shapes of a fingertip; smaller ones stand for motors and frames
MOST_PALMS = 4  # palms that are named


@dataclass(frozen=True)
class TipProposal:
    """Proposed fingertips of a robot file.

    Parameters
    ----------
    tips : tuple of SuggestedTip
    left_out : mapping of str to str
        Leaf links that are not proposed, with the reason.
    closing : ClosingWidths or None
        Bodies that all of them close on; None where that was not tried.
    refusal : str
        Sentence that says why the tips are no proposal; empty if they are one.
    """

    tips: tuple[SuggestedTip, ...]
    left_out: Mapping[str, str]
    closing: ClosingWidths | None = None
    refusal: str = ""

    @property
    def sentences(self) -> tuple[str, ...]:
        """Sentences about the bodies that the fingertips close on, and about the leaf links that are left out."""
        result = []
        if self.closing is not None:
            result.append(f"They close on {self.closing} (links checked at points, friction {FRICTION:g}).")
        elif len(self.tips) > MOST_TIPS:
            result.append(f"They were not tried on bodies: that is done for {MOST_TIPS} fingertips at most.")
        if self.left_out:
            result.append("Left out: " + ", ".join(f"{link} ({why})" for link, why in self.left_out.items()) + ".")
        return tuple(result)


def propose_tips(tree: LinkTree, rest_posture: FloatArray) -> TipProposal:
    """Return the proposed fingertips: leaf links with a shape that face other leaf links.

    Links that follow a fingertip in a linkage, that do not move against the palm or have tiny shapes are left out. A
    file with a single leaf link, or with more than a hand, has no proposal.

    Parameters
    ----------
    tree : LinkTree
        Without fingertips.
    rest_posture : (m,) array
        Positions of the free joints.
    """
    robot, left_out = tree.robot, dict[str, str]()
    links = list(leaf_links(robot))
    shaped = [link for link in links if robot.group_shapes(link)]
    if len(shaped) >= 2:
        left_out = {link: NO_SHAPE for link in links if link not in shaped}
        links = shaped
    sizes = {link: _shape_length(robot, link) for link in links}
    large = [link for link in links if not 0.0 < sizes[link] < SMALLEST_TIP]
    if len(large) >= 2:
        left_out |= {link: _format_size(sizes[link]) for link in links if link not in large}
        links = large
    refusal = _refusal(robot, links)
    if refusal:
        return TipProposal(tuple(suggest_tip(robot, link) for link in links), left_out, refusal=refusal)
    moving = _links_moving_against(robot, common_ancestor(robot, links), links)
    if len(moving) >= 2:
        left_out |= {link: FIXED for link in links if link not in moving}
        links = moving
    if not robot.free_joints or not 2 <= len(links) <= MOST_TIPS:
        return TipProposal(tuple(suggest_tip(robot, link) for link in links), left_out)
    with_tips = _with_tips(tree, links)
    joined = _followers(with_tips, joined=True)
    if len(links) - len(joined) >= 2:
        left_out |= {links[i]: FOLLOWS for i in joined}
        links = [link for i, link in enumerate(links) if i not in joined]
        with_tips = _with_tips(tree, links)
    opposed = opposed_tips(with_tips, rest_posture)
    if len(opposed) >= 2:
        left_out |= {link: FACES_NONE for i, link in enumerate(links) if i not in opposed}
        links = [links[i] for i in opposed]
        with_tips = LinkTree(robot, [with_tips.tips[i] for i in opposed], tree.approach)
    closing = closing_widths(with_tips)
    followers = _followers(with_tips)
    if followers:
        leaders = [tip for i, tip in enumerate(with_tips.tips) if i not in followers]
        closing_without = closing_widths(LinkTree(robot, leaders, tree.approach))
        if len(closing_without) > len(closing):
            left_out |= {links[i]: FOLLOWS for i in followers}
            links, closing = [link for link, _ in leaders], closing_without
    if not closing and len(links) > 2:
        pair = _most_opposed_pair(with_tips)
        closing = closing_widths(LinkTree(robot, [with_tips.tips[i] for i in pair], tree.approach))
        if closing:
            left_out |= {link: CLOSES_WITH_NONE for i, link in enumerate(links) if i not in pair}
            links = [links[i] for i in pair]
    tips = tuple(suggest_tip(robot, link) for link in links)
    names = ", ".join(links)
    refusal = "" if closing else f"Links at the ends: {names}. They close on {closing}: --fingertip LINK states others."
    return TipProposal(tips, left_out, closing, refusal)


def _most_opposed_pair(tree: LinkTree) -> tuple[int, int]:
    """Return the two fingertips that face each other most, on average over random postures."""
    lower, upper = tree.joint_limits
    alignment = mean_alignment(tree, np.random.default_rng(0).uniform(lower, upper, (POSTURES, len(lower))))
    return min(combinations(range(len(tree.tips)), 2), key=lambda pair: float(alignment[pair]))


def _shape_length(robot: Robot, link: str) -> float:
    """Return the longest side of the bounding box of a link's shapes, metres; 0 without shapes."""
    vertices = [shape.mesh.vertices @ T[:3, :3].T + T[:3, 3] for shape, T in robot.group_shapes(link)]
    return float(np.max(np.ptp(np.concatenate(vertices), axis=0))) if vertices else 0.0


def _format_size(length: float) -> str:
    """Return the reason to leave out a link with tiny shapes of a given length, metres."""
    return f"shapes of only {format_number(1e3 * length, 2)} mm"


def _refusal(robot: Robot, links: Sequence[str]) -> str:
    """Return the sentence that says why given leaf links are not the fingertips of one hand; empty if they may be."""
    if len(links) < 2:
        need = "To hold a body takes two fingertips at least: --fingertip LINK states each, also on a fixed jaw."
        return f"Only one link is at an end: {links[0]}. {need}"
    palm = common_ancestor(robot, links)
    longest = max(_finger_length(robot, palm, link) for link in links)
    if longest <= LONGEST_FINGER:
        arm = arm_above(robot, links)
        return (
            ""
            if arm is None
            else f"An arm of {len(arm[1])} joints is above the fingers: --palm {arm[0]} leaves it out."
        )
    palms = _palms(robot, links)
    names = ", ".join(palms[:MOST_PALMS])
    likely = f" (likely {names})" if names else ""
    contents = f"{len(links)} links at the ends, up to {format_number(longest, 2)} m from {palm}"
    return (
        f"The file holds more than a hand ({contents}): --palm LINK names the hand's palm{likely}, or --fingertip LINK "
        "each of its fingertips."
    )


def _palms(robot: Robot, links: Sequence[str]) -> tuple[str, ...]:
    """Return the links from which several of the given leaf links branch, all of them within a finger's length."""
    if len(links) < 2:
        return ()
    palm = common_ancestor(robot, links)
    moving = _links_moving_against(robot, palm, links)
    if len(moving) < len(links):
        return _palms(robot, moving)
    if all(_finger_length(robot, palm, link) <= LONGEST_FINGER for link in links):
        return (palm,)
    branches: dict[str, list[str]] = {}
    depth = len(robot.chain(palm))
    for link in links:
        branches.setdefault(robot.chain(link)[depth].child, []).append(link)
    return tuple(name for branch in branches.values() for name in _palms(robot, branch))


def _links_moving_against(robot: Robot, palm: str, links: Sequence[str]) -> list[str]:
    """Return the links that are not rigidly connected to the palm."""
    return [link for link in links if robot.rigid_groups[link] != robot.rigid_groups[palm]]


def _finger_length(robot: Robot, palm: str, link: str) -> float:
    """Return the sum of the joint offset lengths from a palm to a link, metres."""
    chain = robot.chain(link)[len(robot.chain(palm)) :]
    return sum(float(np.linalg.norm(joint.xyz)) for joint in chain)


def _with_tips(tree: LinkTree, links: Sequence[str]) -> LinkTree:
    """Return the kinematic tree with the suggested fingertips on given links."""
    guessed = {link: GUESS if suggest_tip(tree.robot, link).guessed else None for link in links}
    return LinkTree(tree.robot, resolve_tips(tree.robot, guessed), tree.approach)


def _joined(robot: Robot, link: str, other: str) -> bool:
    """Return whether a link's shapes overlap those of a part of another link's chain that its own chain lacks.

    So do rods and couplers of a linkage, which is a tree in the file, with what they are joined to. The posture is that
    of the file, all joints as near to zero as their limits allow.
    """
    lower, upper = np.array([robot.ranges[joint.name][:2] for joint in robot.free_joints]).T
    posture = np.clip(np.zeros((1, len(lower))), lower, upper)
    groups, own = robot.rigid_groups, {joint.child for joint in robot.chain(link)}
    parts = {groups[joint.child] for joint in robot.chain(other) if joint.moves and joint.child not in own}
    transforms = {part: link_poses_at(robot, part, posture)[0] for part in (link, *parts)}
    shapes = robot.group_shapes(link)
    for part in parts:
        to_part = np.linalg.inv(transforms[part]) @ transforms[link]
        for (a, Ta), (b, Tb) in product(shapes, robot.group_shapes(part)):
            relative = np.linalg.inv(Tb) @ to_part @ Ta
            if _overlap(a, b, relative):
                return True
    return False


def _overlap(a: CollisionShape, b: CollisionShape, relative: FloatArray) -> bool:
    """Return whether two shapes overlap, by samples of their surfaces.

    The first is at a pose (4, 4) in the second's frame.
    """
    for first, second, pose in ((a, b, relative), (b, a, np.linalg.inv(relative))):
        points = first.mesh.sample(SURFACE_SAMPLES, seed=0) @ pose[:3, :3].T + pose[:3, 3]
        low, high = second.mesh.bounds
        near = points[np.all((points > low) & (points < high), axis=1)]
        if len(near) and np.max(second.depth(near)) > OVERLAP:
            return True
    return False


def _followers(tree: LinkTree, joined: bool = False) -> set[int]:
    """Return the fingertips that lie behind another one, face the same way and are moved by the same joints.

    Such are the knuckles of a linkage, and the shorter fingers of a hand whose fingers have one motor. With ``joined``,
    those whose links are joined to the other's finger instead: rods and couplers of a linkage, moved by joints of their
    own where the file's tree leaves the linkage open.
    """
    joints = tree.random_joints(POSTURES, np.random.default_rng(0))
    alignment = mean_alignment(tree, joints)
    reach = np.mean(np.linalg.norm(tree.palm_tips(joints), axis=2), axis=0)
    drivers = [driving_joints(tree.robot, link) for link, _ in tree.tips]
    return {
        i
        for i in range(len(drivers))
        for j in range(len(drivers))
        if (alignment[i, j] > 0.0 or joined)
        and reach[i] < reach[j]
        and (_joined(tree.robot, tree.tips[i][0], tree.tips[j][0]) if joined else drivers[i] == drivers[j])
    }
