"""Proposal of fingertips for a robot file: leaf links that face others, tested on cylinders and boxes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.hands.closing_trial import FRICTION, MOST_TIPS, ClosingWidths, closing_widths
from nlpgrasp.hands.finger_chains import driving_joints
from nlpgrasp.hands.kinematics import LinkTree
from nlpgrasp.hands.link_spheres import SphereFit
from nlpgrasp.hands.opposition import mean_alignment, opposed_tips
from nlpgrasp.hands.suggested_tips import GUESS, SuggestedTip, leaf_links, suggest_tip
from nlpgrasp.hands.urdf_hand import resolve_tips

NO_SHAPE, FACES_NONE, FOLLOWS = "no collision shape", "faces no other", "moves along behind a fingertip"
POSTURES = 200  # random postures


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
    """

    tips: tuple[SuggestedTip, ...]
    left_out: Mapping[str, str]
    closing: ClosingWidths | None

    @property
    def sentences(self) -> tuple[str, ...]:
        """Sentences about the bodies that the fingertips close on, and about the leaf links that are left out."""
        result = []
        if self.closing is not None:
            result.append(f"They close on {self.closing} (links as spheres, friction {FRICTION:g}).")
        if self.left_out:
            result.append("Left out: " + ", ".join(f"{link} ({why})" for link, why in self.left_out.items()) + ".")
        return tuple(result)


def propose_tips(tree: LinkTree, fits: Mapping[str, SphereFit], rest_posture: FloatArray) -> TipProposal:
    """Return the proposed fingertips: leaf links with a shape that face other leaf links.

    Links of a linkage that follow a fingertip are left out.

    Parameters
    ----------
    tree : LinkTree
        Without fingertips.
    fits : mapping of str to SphereFit
        Spheres of the links.
    rest_posture : (m,) array
        Positions of the free joints.
    """
    robot, left_out = tree.robot, dict[str, str]()
    links = list(leaf_links(robot))
    shaped = [link for link in links if robot.group_shapes(link)]
    if len(shaped) >= 2:
        left_out = {link: NO_SHAPE for link in links if link not in shaped}
        links = shaped
    if not robot.free_joints or not 2 <= len(links) <= MOST_TIPS:
        return TipProposal(tuple(suggest_tip(robot, link) for link in links), left_out, None)
    with_tips = _with_tips(tree, links)
    opposed = opposed_tips(with_tips, rest_posture)
    if len(opposed) >= 2:
        left_out |= {link: FACES_NONE for i, link in enumerate(links) if i not in opposed}
        links = [links[i] for i in opposed]
        with_tips = LinkTree(robot, [with_tips.tips[i] for i in opposed], tree.approach)
    closing = closing_widths(with_tips, fits)
    followers = _followers(with_tips)
    if followers:
        leaders = [tip for i, tip in enumerate(with_tips.tips) if i not in followers]
        closing_without = closing_widths(LinkTree(robot, leaders, tree.approach), fits)
        if len(closing_without) > len(closing):
            left_out |= {links[i]: FOLLOWS for i in followers}
            links, closing = [link for link, _ in leaders], closing_without
    return TipProposal(tuple(suggest_tip(robot, link) for link in links), left_out, closing)


def _with_tips(tree: LinkTree, links: Sequence[str]) -> LinkTree:
    """Return the kinematic tree with the suggested fingertips on given links."""
    guessed = {link: GUESS if suggest_tip(tree.robot, link).guessed else None for link in links}
    return LinkTree(tree.robot, resolve_tips(tree.robot, guessed), tree.approach)


def _followers(tree: LinkTree) -> set[int]:
    """Return the fingertips that lie behind another one, face the same way and are moved by the same joints.

    Such are the knuckles of a linkage, and the shorter fingers of a hand whose fingers have one motor.
    """
    lower, upper = tree.joint_limits
    joints = np.random.default_rng(0).uniform(lower, upper, (POSTURES, len(lower)))
    alignment = mean_alignment(tree, joints)
    reach = np.mean(np.linalg.norm(tree.palm_tips(joints), axis=2), axis=0)
    drivers = [driving_joints(tree.robot, link) for link, _ in tree.tips]
    return {
        i
        for i in range(len(drivers))
        for j in range(len(drivers))
        if drivers[i] == drivers[j] and alignment[i, j] > 0.0 and reach[i] < reach[j]
    }
