"""Data for inspecting a hand: links and spheres, with or without fingertips."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import InputError
from nlpgrasp.hands.base import Hand
from nlpgrasp.hands.robot.ends import leaves
from nlpgrasp.hands.robot.robot_file import read_robot
from nlpgrasp.hands.spheres.hand_fits import fits_of
from nlpgrasp.hands.spheres.link_spheres import SphereFit
from nlpgrasp.hands.urdf.link_tree import LinkTree
from nlpgrasp.hands.urdf.linked_hand import LinkedHand
from nlpgrasp.hands.urdf.urdf_arguments import approach_of, torque_limits_of

SPHERES = 6  # per link, the default of URDFHand.load
EVEN = 0.1  # share of a joint's range: with its middle this near zero the joint rests at zero
CLOSED = 0.35  # share of its range at which any other joint rests


@dataclass(frozen=True)
class Inspected:
    """A hand under inspection: kinematics, collision spheres and torque limits.

    Parameters
    ----------
    tree : LinkTree
        Without fingertips if none are stated.
    fits : mapping of str to SphereFit
        Spheres around the links.
    torque_limits : mapping of str to float
        By joint, newton-metres (newtons for sliding joints).
    file : str
        Path as given, where no fingertips are stated.
    palm : str, optional
        The palm as it was given.
    """

    tree: LinkTree
    fits: Mapping[str, SphereFit]
    torque_limits: Mapping[str, float]
    file: str = ""
    palm: str | None = None

    @property
    def at_rest(self) -> FloatArray:
        """Positions of the free joints in a relaxed posture, (m,): zero for ranges nearly symmetric about zero."""
        lower, upper = self.tree.joint_limits if self.tree.robot.free_joints else np.zeros((2, 0))
        even = np.abs(lower + upper) <= EVEN * (upper - lower)
        return np.where(even, 0.0, lower + CLOSED * (upper - lower))

    @property
    def leaves(self) -> tuple[str, ...]:
        """Leaf links of the kinematic tree, where fingertips often are."""
        return leaves(self.tree.robot)


def inspected(hand: Hand) -> Inspected:
    """Return the inspection data of a hand.

    Raises
    ------
    InputError
        For a hand without links.
    """
    fits = getattr(hand, "fits", None) if isinstance(hand, LinkedHand) else None
    if not isinstance(hand, LinkedHand) or fits is None:
        given = f"{type(hand).__name__}, which has no links to draw"
        raise InputError("hand.show", given, "a hand with links: ng.URDFHand.load or one of ng.hands")
    return Inspected(hand.tree, fits, hand.torque_limits)


def without_fingertips(path: str | Path, palm: str | None, approach: ArrayLike) -> Inspected:
    """Return the inspection data of a URDF without fingertips; arguments are those of ``ng.URDFHand.load``.

    Raises
    ------
    InputError
        As ``ng.URDFHand.load``.
    """
    robot = read_robot(path, palm)
    tree = LinkTree(robot, (), approach_of(approach))
    return Inspected(tree, fits_of(robot, SPHERES), torque_limits_of(robot, None), str(path), palm)
