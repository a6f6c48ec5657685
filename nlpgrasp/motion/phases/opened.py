"""Opening of a hand from its grasp, finger by finger as far as is collision-free."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.hands.base import Values
from nlpgrasp.motion.space.straight import Place, straight_way
from nlpgrasp.motion.space.surroundings import BoolArray, Surroundings


@dataclass(frozen=True)
class Opened:
    """Path of postures from the grasp to the open hand.

    Parameters
    ----------
    places : tuple of Place
        The grasp first.
    blocked_by : str
        What is in the way where no finger opens at all; empty otherwise.
    straight : bool
        Whether all joints go on one straight line.
    """

    places: tuple[Place, ...]
    blocked_by: str
    straight: bool = True

    @property
    def values(self) -> Values:
        """Values of the hand's variables when it is open."""
        return self.places[-1].values


def opened(around: Surroundings, grasp: Values, pregrasp: Values, times: float) -> Opened:
    """Return the hand opened from its grasp towards a multiple of its pregrasp, within the joint limits.

    All go on together; what is blocked stays where it is, and the others go on without. Fingertips may be as near the
    body as in the program (``Surroundings.allowed``): they touch it in the end. Balls of links that overlap in
    the grasp, which the program allows where they hardly ever do, may go on doing so, no deeper.

    Parameters
    ----------
    around : Surroundings
    grasp, pregrasp : dict
        Values of the hand's variables.
    times : float
        1 for the pregrasp itself.
    """
    lower, upper = around.hand.tree.joint_limits
    joints = grasp["joints"] + times * (pregrasp["joints"] - grasp["joints"])
    aim = {**grasp, "joints": np.clip(joints, lower, upper), "palm_position": pregrasp["palm_position"]}
    places, free, blocked, legs = list[Place](), np.ones(len(lower), bool), "", 0
    while not places or free.any():
        here = places[-1].values if places else grasp
        way = straight_way(around, _towards(here, aim, free), partial(_allowed, around))
        if not way.places:
            return Opened((), way.blocked_by)
        legs += len(way.places) > 1
        places += way.places[1:] if places else way.places
        while len(places) > 1 and _least(around, places[-1]) < min(0.0, _least(around, places[0])):
            places.pop()  # open, the fingers stay out of everything, also by less than the tolerance
        blocked = blocked or way.blocked_by
        if not np.any(free & way.moved_by):  # nothing is in the way, or nothing that a joint moves
            break
        free &= ~way.moved_by
    return Opened(tuple(places), "" if len(places) > 1 else blocked, legs <= 1)


def opened_straight(around: Surroundings, grasp: Values, pregrasp: Values, times: float) -> Opened:
    """Return the hand opened as by ``opened``, or less, along one straight joint path."""
    found = opened(around, grasp, pregrasp, times)
    if found.blocked_by or found.straight:
        return found
    ends, free = found.values, np.ones(len(grasp["joints"]), bool)
    way = straight_way(around, _towards(grasp, ends, free), partial(_allowed, around))
    places = list(way.places)
    while len(places) > 1 and _least(around, places[-1]) < min(0.0, _least(around, places[0])):
        places.pop()
    return Opened(tuple(places), "" if len(places) > 1 else way.blocked_by)


def _allowed(around: Surroundings, first: Place) -> FloatArray:
    """Return the least clearances, (n,), metres; links that overlap in the grasp may do so, no deeper."""
    least, pairs = around.allowed(), around.of_pairs()
    least[pairs] = np.minimum(first.clearances[pairs], 0.0)
    return least


def _towards(here: Values, aim: Values, free: BoolArray) -> Callable[[float], Values]:
    """Return the straight path of the free joints to their goal; the palm moves along while all are free."""
    ends = {"joints": np.where(free, aim["joints"], here["joints"])}
    ends["palm_position"] = aim["palm_position"] if free.all() else here["palm_position"]

    def posture(share: float) -> Values:
        return {**here, **{name: here[name] + share * (end - here[name]) for name, end in ends.items()}}

    return posture


def _least(around: Surroundings, place: Place) -> float:
    return float(np.min(place.clearances - around.allowed(), initial=np.inf))


def openings(around: Surroundings, values: Values, grasp: Values) -> FloatArray:
    """Return each fingertip's distance from its position in the grasp, palm frame, (k,), metres."""
    there, here = around.hand.tree.palm_tips(np.stack([values["joints"], grasp["joints"]]))
    return np.asarray(np.linalg.norm(there - here, axis=1))
