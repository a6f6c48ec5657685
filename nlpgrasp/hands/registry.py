"""Registry of hand types for loading from JSON data."""

from __future__ import annotations

from typing import TypeVar

from nlpgrasp.common.registry import Registry, from_registered
from nlpgrasp.common.types import Json
from nlpgrasp.hands.base import Hand
from nlpgrasp.hands.fingertips import Fingertips
from nlpgrasp.hands.parallel_jaw import ParallelJaw
from nlpgrasp.hands.urdf_hand import URDFHand

Kind = TypeVar("Kind", bound=Hand)
HANDS: Registry[Hand] = Registry("hand.type")


def register(hand: type[Kind]) -> type[Kind]:
    """Register a hand type for JSON files; usable as a decorator.

    Parameters
    ----------
    hand : subclass of Hand
        With ``kind``, the name that its ``to_dict`` gives as ``type``. A class that is not a dataclass needs
        ``from_dict`` as well.

    Raises
    ------
    InputError
        When another hand has that name.
    """
    HANDS.add(hand.kind, hand)
    return hand


def hand_from_dict(data: Json) -> Hand:
    """Return a hand of any registered type from the data of its ``to_dict``.

    Raises
    ------
    InputError
        When the type is unknown, or the data are invalid or incomplete.
    """
    return from_registered(HANDS, "hand", data)


register(Fingertips)
register(ParallelJaw)
register(URDFHand)
