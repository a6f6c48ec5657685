"""Straight approach of the palm to the open hand: choice of a collision-free direction and opening."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from nlpgrasp.common.directions import directions_around, directions_beside
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.hands import URDFHand
from nlpgrasp.hands.base import Values
from nlpgrasp.motion.phases.opened import Opened
from nlpgrasp.motion.space.straight import Place, StraightWay, straight_way
from nlpgrasp.motion.space.surroundings import Surroundings

WIDER = (1.0, 2.0, 4.0)  # openings tried, times the pregrasp's
CLOSER, BESIDE = np.radians([13.0, 6.5, 3.2, 1.6]), 6  # radians from the direction free longest; directions at each
SAME = 1e-9  # of a cosine: nearer directions count as one


@dataclass(frozen=True)
class BlockedDirection:
    """Approach direction that is not collision-free.

    Parameters
    ----------
    direction : (3,) array
        Of the palm towards the grasp, unit, body frame.
    free : float
        Metres before the grasp from which on it is free.
    times : float
        How wide the fingers were open, times the pregrasp's opening.
    reason : str
        What is in the way farther out.
    """

    direction: FloatArray
    free: float
    times: float
    reason: str

    def to_dict(self) -> Json:
        """Return the direction as JSON data."""
        return {
            "direction": self.direction.tolist(),
            "free": self.free,
            "times": self.times,
            "reason": self.reason,
        }


@dataclass(frozen=True)
class Approach:
    """Result of a search for a free approach: a direction, or the reason why there is none.

    Parameters
    ----------
    reason : str
        Why no direction is free; empty where one is.
    blocked : tuple of BlockedDirection
        Those that were looked at before.
    fingers : Opened or None
        The hand as wide open as at the last look; None where it does not open.
    direction : (3,) array or None
        In which the palm moves towards the grasp, unit, body frame.
    distance : float
        How far, metres.
    outside : tuple of Place
        From the open hand at the grasp on, away from it.
    """

    reason: str
    blocked: tuple[BlockedDirection, ...] = ()
    fingers: Opened | None = None
    direction: FloatArray | None = None
    distance: float = 0.0
    outside: tuple[Place, ...] = ()


def free_approach(
    around: Surroundings,
    open_hand: Callable[[float], Opened],
    ways: Sequence[FloatArray],
    distance: Callable[[Values, FloatArray], float],
    locate: bool = True,
) -> Approach:
    """Return the first collision-free approach direction of the open hand, opened wider where none is free.

    Where none of several is, others are looked at about the one that is free longest, nearer and nearer to it: the way
    out of a narrow place lies between the directions of any list.

    Parameters
    ----------
    around : Surroundings
    open_hand : callable
        How wide, times the pregrasp's opening, to the opened hand.
    ways : sequence of (3,) arrays
        Directions of the palm towards the grasp, unit, body frame, those that are liked best first.
    distance : callable
        The open hand and a direction to how far the palm moves, metres.
    locate : bool
        Whether ``BlockedDirection.free`` is to be found to the tolerance.
    """
    blocked = list[BlockedDirection]()
    fingers, longest = None, 0.0
    for times in WIDER:
        opened = open_hand(times)
        if opened.blocked_by:
            return Approach(f"the fingers cannot open: {opened.blocked_by}", (), fingers)
        fingers = fingers or opened
        for way in _closer(ways, blocked):
            longest = distance(opened.values, way)
            found = _away(around, opened.values, way, longest, locate)
            if not found.blocked_by:
                return Approach("", tuple(blocked), opened, way, longest, found.places)
            blocked.append(BlockedDirection(way, found.free * longest, times, found.blocked_by))
    count = sum(b.times == WIDER[0] for b in blocked)
    return Approach(_why_none(blocked, count, longest), tuple(blocked), fingers)


def _closer(ways: Sequence[FloatArray], blocked: Sequence[BlockedDirection]) -> Iterator[FloatArray]:
    """Yield directions, then ones ever nearer to the longest free one; ``blocked`` grows by all but the last."""
    before = len(blocked)
    yield from ways
    if len(ways) == 1:
        return
    for angle in CLOSER:
        best = max(blocked[before:], key=lambda b: b.free)
        if best.free <= 0.0:
            return
        yield from directions_beside(best.direction, angle, BESIDE)


def _away(around: Surroundings, start: Values, way: FloatArray, distance: float, locate: bool) -> StraightWay:
    """Return the collision-free part of the path out along a direction, from the open hand at the grasp."""

    def away(share: float) -> Values:
        return {**start, "palm_position": start["palm_position"] - share * distance * way}

    def allowed(first: Place) -> FloatArray:
        least = around.allowed()
        as_there = around.of_tips() | around.of_pairs()
        least[as_there] = np.minimum(first.clearances[as_there], 0.0)
        return least

    return straight_way(around, away, allowed, locate)


def _why_none(blocked: list[BlockedDirection], count: int, distance: float) -> str:
    """Return the reason why every direction is blocked: that of the longest free one."""
    best = max(blocked, key=lambda b: b.free)
    which = np.array2string(best.direction, precision=2, suppress_small=True)
    said = f"the longest, along {which}, is free for {1e3 * best.free:.0f} mm: {best.reason}"
    one = "the direction is not" if count == 1 else f"none of {count} directions is"
    return f"{one} free for {1e3 * distance:.0f} mm; {said}"


def ways_of_palm(hand: URDFHand, values: Values, count: int) -> list[FloatArray]:
    """Return candidate approach directions of the palm, the one in which it faces first, the nearest to it next.

    Parameters
    ----------
    hand : URDFHand
    values : dict
        Of its variables in the grasp.
    count : int
        How many are spread over the sphere; beside them are the axes of palm and body, both ways. One is that in which
        the palm faces alone.

    Returns
    -------
    list of (3,) arrays
        Unit, body frame.
    """
    first = facing(hand, values)
    ways = directions_around(first, count)
    if count > 1:
        axes = np.concatenate([hand.tree.palm_frame(values)[:3, :3].T, np.eye(3)])
        ways = np.concatenate([ways, axes, -axes])
    kept: list[FloatArray] = []
    for way in ways[np.argsort(-(ways @ first), kind="stable")]:
        if all(way @ other < 1.0 - SAME for other in kept):
            kept.append(way)
    return kept


def facing(hand: URDFHand, values: Values) -> FloatArray:
    """Return the direction in which the palm faces, (3,), body frame."""
    return np.asarray(hand.tree.palm_frame(values)[:3, :3] @ hand.tree.approach)
