"""Straight approach of the palm with an open hand: a collision-free direction and opening.

The fingers open from the grasp towards the pregrasp or wider (``opened``). From there the palm leaves in the first
direction that is free (``free_approach``); the approach is that path in reverse.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.unit_directions import directions_around, directions_beside
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.hands import URDFHand
from nlpgrasp.hands.base import Values
from nlpgrasp.motion.link_clearance import BoolArray, CollisionModel
from nlpgrasp.motion.straight_path import PathPosture, StraightPath, straight_way

WIDER = (1.0, 2.0, 4.0)  # openings tried, times the pregrasp's
CLOSER, BESIDE = np.radians([13.0, 6.5, 3.2, 1.6]), 6  # angles from the direction free longest; directions at each
SAME = 1e-9  # difference of a cosine from 1 below which two directions count as one


def free_approach(
    around: CollisionModel,
    open_hand: Callable[[float], OpeningPath],
    ways: Sequence[FloatArray],
    distance: Callable[[Values, FloatArray], float],
    locate: bool = True,
) -> ApproachPath:
    """Return the first collision-free approach direction of the open hand, opened wider where none is free.

    Where none of several is, others are looked at about the one that is free longest, nearer and nearer to it: the way
    out of a narrow place lies between the directions of any list.

    Parameters
    ----------
    around : CollisionModel
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
            return ApproachPath(f"the fingers cannot open: {opened.blocked_by}", (), fingers)
        fingers = fingers or opened
        for way in _closer_directions(ways, blocked):
            longest = distance(opened.values, way)
            found = _free_part(around, opened.values, way, longest, locate)
            if not found.blocked_by:
                return ApproachPath("", tuple(blocked), opened, way, longest, found.places)
            blocked.append(BlockedDirection(way, found.free * longest, times, found.blocked_by))
    count = sum(b.times == WIDER[0] for b in blocked)
    return ApproachPath(_blocking_reason(blocked, count, longest), tuple(blocked), fingers)


@dataclass(frozen=True)
class ApproachPath:
    """Result of a search for a free approach: a direction, or the reason why there is none.

    Parameters
    ----------
    reason : str
        Why no direction is free; empty where one is.
    blocked : tuple of BlockedDirection
        Those that were looked at before.
    fingers : OpeningPath or None
        The hand as wide open as at the last look; None where it does not open.
    direction : (3,) array or None
        In which the palm moves towards the grasp, unit, body frame.
    distance : float
        How far, metres.
    outside : tuple of PathPosture
        From the open hand at the grasp on, away from it.
    """

    reason: str
    blocked: tuple[BlockedDirection, ...] = ()
    fingers: OpeningPath | None = None
    direction: FloatArray | None = None
    distance: float = 0.0
    outside: tuple[PathPosture, ...] = ()


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


def approach_candidates(hand: URDFHand, values: Values, count: int) -> list[FloatArray]:
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
    first = palm_direction(hand, values)
    ways = directions_around(first, count)
    if count > 1:
        axes = np.concatenate([hand.tree.palm_frame(values)[:3, :3].T, np.eye(3)])
        ways = np.concatenate([ways, axes, -axes])
    kept: list[FloatArray] = []
    for way in ways[np.argsort(-(ways @ first), kind="stable")]:
        if all(way @ other < 1.0 - SAME for other in kept):
            kept.append(way)
    return kept


def palm_direction(hand: URDFHand, values: Values) -> FloatArray:
    """Return the direction in which the palm faces, (3,), body frame."""
    return np.asarray(hand.tree.palm_frame(values)[:3, :3] @ hand.tree.approach)


def opened(around: CollisionModel, grasp: Values, pregrasp: Values, times: float) -> OpeningPath:
    """Return the hand opened from its grasp towards a multiple of its pregrasp, within the joint limits.

    All go on together; what is blocked stays where it is, and the others go on without. Fingertips may be as near the
    body as in the program (``CollisionModel.allowed``): they touch it in the end. Balls of links that overlap in
    the grasp, which the program allows where they hardly ever do, may go on doing so, no deeper.

    Parameters
    ----------
    around : CollisionModel
    grasp, pregrasp : dict
        Values of the hand's variables.
    times : float
        1 for the pregrasp itself.
    """
    lower, upper = around.hand.tree.joint_limits
    joints = grasp["joints"] + times * (pregrasp["joints"] - grasp["joints"])
    aim = {**grasp, "joints": np.clip(joints, lower, upper), "palm_position": pregrasp["palm_position"]}
    places, free, blocked, legs = list[PathPosture](), np.ones(len(lower), bool), "", 0
    while not places or free.any():
        here = places[-1].values if places else grasp
        way = straight_way(around, _towards(here, aim, free), partial(_least_clearances, around))
        if not way.places:
            return OpeningPath((), way.blocked_by)
        legs += len(way.places) > 1
        places += way.places[1:] if places else way.places
        while len(places) > 1 and _least_clearance(around, places[-1]) < min(0.0, _least_clearance(around, places[0])):
            places.pop()  # open, the fingers stay out of everything, also by less than the tolerance
        blocked = blocked or way.blocked_by
        if not np.any(free & way.moved_by):  # nothing is in the way, or nothing that a joint moves
            break
        free &= ~way.moved_by
    return OpeningPath(tuple(places), "" if len(places) > 1 else blocked, legs <= 1)


def open_hand_straight(around: CollisionModel, grasp: Values, pregrasp: Values, times: float) -> OpeningPath:
    """Return the hand opened as by ``opened``, or less, along one straight joint path."""
    found = opened(around, grasp, pregrasp, times)
    if found.blocked_by or found.straight:
        return found
    ends, free = found.values, np.ones(len(grasp["joints"]), bool)
    way = straight_way(around, _towards(grasp, ends, free), partial(_least_clearances, around))
    places = list(way.places)
    while len(places) > 1 and _least_clearance(around, places[-1]) < min(0.0, _least_clearance(around, places[0])):
        places.pop()
    return OpeningPath(tuple(places), "" if len(places) > 1 else way.blocked_by)


@dataclass(frozen=True)
class OpeningPath:
    """Path of postures from the grasp to the open hand.

    Parameters
    ----------
    places : tuple of PathPosture
        The grasp first.
    blocked_by : str
        What is in the way where no finger opens at all; empty otherwise.
    straight : bool
        Whether all joints go on one straight line.
    """

    places: tuple[PathPosture, ...]
    blocked_by: str
    straight: bool = True

    @property
    def values(self) -> Values:
        """Values of the hand's variables when it is open."""
        return self.places[-1].values


def opening_distances(around: CollisionModel, values: Values, grasp: Values) -> FloatArray:
    """Return each fingertip's distance from its position in the grasp, palm frame, (k,), metres."""
    there, here = around.hand.tree.palm_tips(np.stack([values["joints"], grasp["joints"]]))
    return np.asarray(np.linalg.norm(there - here, axis=1))


def _closer_directions(ways: Sequence[FloatArray], blocked: Sequence[BlockedDirection]) -> Iterator[FloatArray]:
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


def _free_part(around: CollisionModel, start: Values, way: FloatArray, distance: float, locate: bool) -> StraightPath:
    """Return the collision-free part of the path out along a direction, from the open hand at the grasp."""

    def away(share: float) -> Values:
        return {**start, "palm_position": start["palm_position"] - share * distance * way}

    def allowed(first: PathPosture) -> FloatArray:
        least = around.least_clearances()
        as_there = around.of_tips() | around.is_of_pair()
        least[as_there] = np.minimum(first.clearances[as_there], 0.0)
        return least

    return straight_way(around, away, allowed, locate)


def _blocking_reason(blocked: list[BlockedDirection], count: int, distance: float) -> str:
    """Return the reason why every direction is blocked: that of the longest free one."""
    best = max(blocked, key=lambda b: b.free)
    which = np.array2string(best.direction, precision=2, suppress_small=True)
    said = f"the longest, along {which}, is free for {1e3 * best.free:.0f} mm: {best.reason}"
    one = "the direction is not" if count == 1 else f"none of {count} directions is"
    return f"{one} free for {1e3 * distance:.0f} mm; {said}"


def _least_clearances(around: CollisionModel, first: PathPosture) -> FloatArray:
    """Return the least clearances, (n,), metres; links that overlap in the grasp may do so, no deeper."""
    least, pairs = around.least_clearances(), around.is_of_pair()
    least[pairs] = np.minimum(first.clearances[pairs], 0.0)
    return least


def _towards(here: Values, aim: Values, free: BoolArray) -> Callable[[float], Values]:
    """Return the straight path of the free joints to their goal; the palm moves along while all are free."""
    ends = {"joints": np.where(free, aim["joints"], here["joints"])}
    ends["palm_position"] = aim["palm_position"] if free.all() else here["palm_position"]

    def posture(share: float) -> Values:
        return {**here, **{name: here[name] + share * (end - here[name]) for name, end in ends.items()}}

    return posture


def _least_clearance(around: CollisionModel, place: PathPosture) -> float:
    return float(np.min(place.clearances - around.least_clearances(), initial=np.inf))
