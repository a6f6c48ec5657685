"""Approach of a hand to its grasp, as positions of its drawn parts for a slider."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import InputError
from nlpgrasp.hands.base import Hand
from nlpgrasp.hands.urdf.linked_hand import LinkedHand
from nlpgrasp.solution.phases.phase import GRASP, LIFT, Phase
from nlpgrasp.solution.solution import GraspSolution

FAR = 0.6  # share of the body's size: retreat of free fingertips


@dataclass(frozen=True)
class Way:
    """Approach path of a hand.

    Parameters
    ----------
    names : tuple of str
        Names of the keyframes.
    grasp : int
        Index of the grasp's keyframe.
    put : callable
        Moves the drawn parts to a position on the path, from 0 to the index of the last keyframe.
    """

    names: tuple[str, ...]
    grasp: int
    put: Callable[[float], None]

    def where(self, at: float) -> str:
        """Return a position on the path as text."""
        before = self.names[int(at)]
        return before if at == int(at) else f"{before} to {self.names[int(at) + 1]}"


def own_hand(solution: GraspSolution, hand: Hand | None) -> None:
    """Refuse another hand than the problem's.

    Raises
    ------
    InputError
        Naming the hand.
    """
    asked = solution.problem.get("hand") or {}
    stated = {} if hand is None else hand.to_dict() if isinstance(hand, Hand) else {"type": type(hand).__name__}
    if hand is not None and any(stated.get(key) != asked.get(key) for key in ("type", "sha256")):
        raise InputError("show.hand", stated.get("source", stated["type"]), "the hand that the grasp was found with")


def hand_way(
    solution: GraspSolution, data: Json, links: Mapping[str, Any], tips: Sequence[Any], hand: Hand | None = None
) -> Way | None:
    """Return the approach of a hand with links, or of free fingertips; None for a hand that cannot be moved.

    Parameters
    ----------
    solution : GraspSolution
    data : mapping
        Scene of the solution.
    links : mapping of str to handle
        Drawn parts of the hand's links, by name.
    tips : sequence of handle
        Free fingertips.
    hand : Hand or None
        The hand with the links.
    """
    if tips:
        return _tips_back(data, tips)
    phases = [phase for phase in solution.phases if phase.name != LIFT]  # in a lift the body moves along
    if not links or [phase.name for phase in phases].count(GRASP) != 1 or len(phases) < 2:
        return None
    return _links_along(hand, phases, links) if isinstance(hand, LinkedHand) else None


def between(phases: Sequence[Phase], at: float) -> Phase:
    """Return the hand interpolated linearly between keyframes of one palm orientation."""
    i = min(int(at), len(phases) - 2)
    share, first, last = at - i, phases[i], phases[i + 1]
    joints = {name: (1.0 - share) * value + share * last.joints[name] for name, value in first.joints.items()}
    place = (1.0 - share) * first.palm_position + share * last.palm_position
    return replace(first, palm_position=place, joints=joints)


def _links_along(hand: LinkedHand, phases: Sequence[Phase], links: Mapping[str, Any]) -> Way:
    names = tuple(phase.name for phase in phases)
    grasp = names.index(GRASP)
    drawn = _poses(hand, phases[grasp])

    def put(at: float) -> None:
        for name, pose in _poses(hand, between(phases, at)).items():
            if name in links:
                moved = pose @ np.linalg.inv(drawn[name])
                links[name].wxyz = Rotation.from_matrix(moved[:3, :3]).as_quat(scalar_first=True)
                links[name].position = moved[:3, 3]

    return Way(names, grasp, put)


def _poses(hand: LinkedHand, phase: Phase) -> dict[str, FloatArray]:
    """Return the poses (4, 4) of the links in the body's frame."""
    return hand.tree.body_poses(hand.values_of(phase.to_dict()))


def _tips_back(data: Json, tips: Sequence[Any]) -> Way:
    """Return the approach of free fingertips, along their contacts' normals."""
    contacts = [contact for contact in data["contacts"] if contact["tip"] > 0.0]

    def put(at: float) -> None:
        for contact, tip in zip(contacts, tips, strict=True):
            back = contact["tip"] + (1.0 - at) * FAR * float(data["size"])
            tip.position = np.array(contact["at"]) - back * np.array(contact["inward"])

    return Way(("away", GRASP), 1, put)
