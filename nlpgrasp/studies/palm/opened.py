"""The hand at its grasp, opened as far towards its pregrasp as it is free."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.hands.base import Values
from nlpgrasp.studies.space.straight import Place, straight_way
from nlpgrasp.studies.space.surroundings import Surroundings


@dataclass(frozen=True)
class Opened:
    """Places from the grasp to the open hand.

    Parameters
    ----------
    places : tuple of Place
        The grasp first.
    blocked_by : str
        What is in the way where the fingers cannot open at all; empty otherwise.
    """

    places: tuple[Place, ...]
    blocked_by: str

    @property
    def values(self) -> Values:
        """Values of the hand's variables when it is open."""
        return self.places[-1].values

    @property
    def share(self) -> float:
        """Share of the pregrasp's opening."""
        return self.places[-1].share


def opened(around: Surroundings, grasp: Values, pregrasp: Values) -> Opened:
    """Return the hand opened from its grasp towards its pregrasp, on a straight line of its variables.

    The fingertips may be as near the body as in the program (``Surroundings.allowed``): they touch it in the end.
    """

    def posture(share: float) -> Values:
        moved = {name: grasp[name] + share * (pregrasp[name] - grasp[name]) for name in ("palm_position", "joints")}
        return {**grasp, **moved}

    def allowed(first: Place) -> FloatArray:
        del first
        return around.allowed()

    way = straight_way(around, posture, allowed)
    places = list(way.places)
    while len(places) > 1 and _least(around, places[-1]) < min(0.0, _least(around, places[0])):
        places.pop()  # open, the fingers stay out of everything, also by less than the tolerance
    return Opened(tuple(places), "" if len(places) > 1 else way.blocked_by)


def _least(around: Surroundings, place: Place) -> float:
    return float(np.min(place.clearances - around.allowed()))
