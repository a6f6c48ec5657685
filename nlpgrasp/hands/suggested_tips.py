"""Suggestion of fingertips from the collision shapes of a robot's leaf links."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nlpgrasp.common.formatting import format_number
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.hands.collision_shapes import CollisionShape
from nlpgrasp.hands.robot import Robot
from nlpgrasp.hands.tips import CapsuleTip, FlatTip, HullTip, SphereTip, Tip

GUESS = 0.01  # metres: radius of a fingertip whose link has no shape
DIGITS = 4  # significant digits of a radius
OVERHANG, MOST_OVERHANG = 1e-3, 5e-3  # metres that a fingertip reaches beyond its link: warned of, and refused
FLAT_SHARE, ROUND_SHARE = 0.9, 0.3  # share of a flat (round) patch that has to lie on the shapes
MOST_INSET = 6e-4  # metres: depth of such a share inside the shapes that is warned of
BRIDGED_HOLLOW = 2e-3  # metres: depth of a hollow that a convex hull bridges which is warned of


def tip_from_shapes(shapes: Sequence[CollisionShape]) -> Tip | None:
    """Return a fingertip from a link's only sphere or capsule; None if there is not exactly one.

    A capsule's end is the one farther from the link's origin.
    """
    round_shapes = [shape for shape in shapes if shape.kind in ("sphere", "capsule")]
    if len(round_shapes) != 1:
        return None
    shape = round_shapes[0]
    if shape.ends is not None and np.ptp(shape.ends, axis=0).any():
        start, end = sorted(shape.ends, key=lambda point: float(np.linalg.norm(point)))
        return CapsuleTip(shape.radius, start, end)
    return None if shape.centre is None else SphereTip(shape.radius, shape.centre)


def overhang(tip: Tip, link: str, robot: Robot) -> float | None:
    """Return how far a fingertip's patch protrudes from the shapes of its link at most, metres.

    Links fixed to this link count too. Where the patch is beyond them, the finger itself does not touch. None if none
    of these links has a shape. Links of a rigid group do not move against each other, so the result holds in every
    posture.
    """
    depths = _patch_depths(tip, link, robot)
    return max(0.0, -float(np.min(depths))) if len(depths) else None


def fits_shapes(tip: Tip, link: str, robot: Robot) -> bool:
    """Return whether a fingertip lies on the shapes of its link, so that the finger touches where the fingertip does.

    It reaches at most a millimetre beyond them, and a share of its patch is at most as far inside. True for a link
    without shapes, also among those fixed to it.
    """
    depths = _patch_depths(tip, link, robot)
    return not len(depths) or bool(np.min(depths) >= -OVERHANG and _inset(tip, depths) <= OVERHANG)


def thick_link_warnings(robot: Robot, tips: Sequence[tuple[str, Tip]]) -> list[str]:
    """Return a warning for each link that encloses its fingertip, which then does not touch a body before the link.

    Fingertips fitted to their links as hulls are as thick as these.
    """
    stated = [(link, tip) for link, tip in tips if not isinstance(tip, HullTip)]
    depths = [(link, _inset(tip, _patch_depths(tip, link, robot))) for link, tip in stated]
    largest = dict(sorted(depths, key=lambda entry: entry[1]))
    return [
        f"link {link} is thicker than its fingertip: beside a contact it may reach {format_number(1e3 * depth, 2)} mm "
        "into the body"
        for link in dict(stated)
        if (depth := largest[link]) > MOST_INSET
    ]


def _patch_depths(tip: Tip, link: str, robot: Robot) -> FloatArray:
    """Return the depths of a patch's points in the shapes of a link and those fixed to it, metres, negative outside.

    Empty if none of these links has a shape.
    """
    surface = tip.surface().vertices
    depths = [shape.depth((surface - T[:3, 3]) @ T[:3, :3]) for shape, T in robot.group_shapes(link)]
    return np.max(depths, axis=0) if depths else np.zeros(0)


def _inset(tip: Tip, depths: FloatArray) -> float:
    """Return the depth that a share of a patch's points does not exceed, metres, 0 where there are none.

    The share is that of a ball's outer side, or nearly all of a flat pad.
    """
    share = FLAT_SHARE if isinstance(tip, FlatTip) else ROUND_SHARE
    return float(np.quantile(depths, share, method="inverted_cdf")) if len(depths) else 0.0


def noticeable_overhang(tip: Tip) -> float:
    """Return the overhang of a fingertip above which a warning is given, metres.

    It is larger for a convex hull, which may bridge hollows.
    """
    return BRIDGED_HOLLOW if isinstance(tip, HullTip) else OVERHANG


@dataclass(frozen=True)
class SuggestedTip:
    """A leaf link suggested as a fingertip, with command and code that state it.

    Parameters
    ----------
    link : str
    command : str
        Value of ``--fingertip``: the link, with a radius where its sphere is about the link's origin.
    code : str
        Python expression for ``ng.URDFHand.load``.
    guessed : bool
        Whether it has no shape, so that its radius is a guess.
    """

    link: str
    command: str
    code: str
    guessed: bool = False


def leaf_links(robot: Robot) -> tuple[str, ...]:
    """Return the links at the ends of chains, one per rigid group, without those that do not move against the palm.

    Of several links fixed to each other, it is the first leaf with a collision shape; where none has one, as frames and
    links that are only visible, it is the last link with a shape above the first leaf.
    """
    parents, groups = set(robot.parents.values()), robot.rigid_groups
    leaves = [link for link in robot.links if link not in parents]
    moving = [link for link in leaves if groups[link] != robot.root]
    if not moving:
        return tuple(leaves)
    chosen: dict[str, str] = {}
    for link in sorted(moving, key=lambda link: not robot.shapes.get(link)):
        chosen.setdefault(groups[link], _nearest_with_shape(robot, link))
    return tuple(dict.fromkeys(chosen[groups[link]] for link in moving))


def _nearest_with_shape(robot: Robot, link: str) -> str:
    """Return the nearest link with a shape above a link, itself included, in its rigid group; itself without any."""
    above = [joint.child for joint in robot.chain(link) if robot.rigid_groups[joint.child] == robot.rigid_groups[link]]
    return next((other for other in reversed(above) if robot.shapes.get(other)), link)


def borrowed_shapes(robot: Robot, link: str) -> tuple[str, ...]:
    """Return the links whose shapes serve for a link without its own, as they are fixed to it; empty if it has some."""
    if robot.shapes.get(link):
        return ()
    return tuple(other for other in robot.shapes if robot.rigid_groups[other] == robot.rigid_groups[link])


def suggest_tip(robot: Robot, link: str) -> SuggestedTip:
    """Return the fingertip suggested by a leaf link's shapes, as command and code."""
    tip = tip_from_shapes(robot.shapes.get(link, ()))
    if isinstance(tip, SphereTip) and not np.any(tip.centre):
        radius = format_number(tip.radius, DIGITS)
        return SuggestedTip(link, f"{link}={radius}", radius)
    if tip is not None or robot.group_shapes(link):
        return SuggestedTip(link, link, "None")
    return SuggestedTip(link, f"{link}={GUESS:g}", f"{GUESS:g}", guessed=True)
