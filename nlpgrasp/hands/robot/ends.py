"""Leaf links of a robot and the fingertips that their shapes suggest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlpgrasp.common.shown.numbers import rounded
from nlpgrasp.hands.robot.robot import Robot
from nlpgrasp.hands.tips import SphereTip
from nlpgrasp.hands.tips.of_shape import sphere_about, tip_of

GUESS = 0.01  # metres: radius of a fingertip whose link has no shape
DIGITS = 4  # significant digits of a radius
NOTHING = 5e-5  # metres: smaller coordinates count as 0


@dataclass(frozen=True)
class End:
    """A leaf link as a possible fingertip.

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


def leaves(robot: Robot) -> tuple[str, ...]:
    """Return the leaf links, one per rigid group; only those that move against the palm, where any do.

    Of several links fixed to each other, it is the first with a collision shape.
    """
    parents, groups = set(robot.parents.values()), robot.rigid_groups
    last = [link for link in robot.links if link not in parents]
    moving = [link for link in last if groups[link] != robot.root]
    if not moving:
        return tuple(last)
    chosen: dict[str, str] = {}
    for link in sorted(moving, key=lambda link: not robot.shapes.get(link)):
        chosen.setdefault(groups[link], link)
    return tuple(link for link in moving if chosen[groups[link]] == link)


def end(robot: Robot, link: str) -> End:
    """Return the fingertip that a leaf link's shapes suggest, as command and code."""
    shapes = robot.shapes.get(link, ())
    own = tip_of(shapes)
    tip = own or sphere_about(shapes)
    if tip is None:
        return End(link, f"{link}={GUESS:g}", f"{GUESS:g}", guessed=True)
    if not isinstance(tip, SphereTip):
        return End(link, link, "None")
    radius = rounded(tip.radius, DIGITS)
    if not np.any(tip.centre):
        return End(link, f"{link}={radius}", radius)
    centre = ", ".join(rounded(v, DIGITS, NOTHING) for v in tip.centre)
    return End(link, link, "None" if own is not None else f"ng.SphereTip({radius}, [{centre}])")
