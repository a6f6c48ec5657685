"""Straight approach of the palm with an open hand: search for a collision-free direction and opening.

The fingers open from the grasp towards the pregrasp or wider (``open_fingers``). From there the palm leaves in the
first direction that is free (``find_free_approach``); the approach is that path in reverse.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.unit_directions import directions_around, directions_beside
from nlpgrasp.common.validation import BoolArray, FloatArray
from nlpgrasp.hands import URDFHand
from nlpgrasp.hands.base import Values
from nlpgrasp.motion.clearance import HandClearance
from nlpgrasp.motion.straight_path import PathPosture, StraightPath, follow_straight_path
from nlpgrasp.solution.obstructions import TABLE

OPENING_FACTORS = (1.0, 2.0, 4.0)  # openings tried, times the pregrasp's
CLOSER_ANGLES = np.radians([13.0, 6.5, 3.2, 1.6])  # radians from the direction that is free longest
CLOSER_COUNT = 6  # directions at each of these angles
ROOM_STEP = 2e-3  # metres between samples of a retreat, for the room that is missing on it
MOST_ROOMS = 5  # directions that are tried with more room
DIRECTION_TOLERANCE = 1e-9  # difference of a cosine from 1 below which two directions count as one


def find_free_approach(
    model: HandClearance,
    open_hand: Callable[[float], OpeningPath],
    directions: Sequence[FloatArray],
    distance: Callable[[Values, FloatArray], float],
    locate: bool = True,
    depth: float = 0.0,
) -> ApproachPath:
    """Return the first collision-free approach direction of the open hand.

    If none is free, the hand is opened wider. Where none of several is free, others are tried about the one that is
    free longest, nearer and nearer to it: the path out of a narrow place lies between the directions of any list.

    Parameters
    ----------
    model : HandClearance
    open_hand : callable
        Opening, as a multiple of the pregrasp's, to the path of the opening hand.
    directions : sequence of (3,) arrays
        Directions of the palm towards the grasp, unit, body frame, in order of preference.
    distance : callable
        The open hand's values and a direction to the distance that the palm moves, metres.
    locate : bool
        Whether ``BlockedDirection.free`` is computed to the tolerance, in place of a 32nd of the way or better.
    depth : float
        How deep links may be in the body on the way, metres; no deeper than in the first posture counts as free.
    """
    blocked = list[BlockedDirection]()
    opening, length = None, 0.0
    for factor in OPENING_FACTORS:
        path = open_hand(factor)
        if path.blocked_by:
            return ApproachPath(f"the fingers cannot open: {path.blocked_by}", (), opening)
        opening = opening or path
        limits = _clearance_limits(model, depth, PathPosture(0.0, path.values, model.clearances(path.values)))
        for direction in _refined_directions(directions, blocked):
            length = distance(path.values, direction)
            if not locate:  # most blocked directions are seen to be so by few points of the links, at once all the way
                lengths = np.linspace(0.0, length, 33).tolist()
                entry = model.first_entry([_retreat(path.values, direction, far) for far in lengths[1:]], limits)
                if entry is not None:
                    reason = model.describe_clearance(entry[1])
                    blocked.append(BlockedDirection(direction, lengths[entry[0]], factor, reason))
                    continue
            section = _free_retreat(model, path.values, direction, length, locate, depth)
            if not section.blocked_by:
                return ApproachPath("", tuple(blocked), path, direction, length, section.postures)
            blocked.append(BlockedDirection(direction, section.free_share * length, factor, section.blocked_by))
    count = sum(b.times == OPENING_FACTORS[0] for b in blocked)
    reason = _blocking_reason(blocked, count, length)
    if opening is not None:
        reason += missing_room(model, opening.values, [b.direction for b in blocked[:count]], length)
    return ApproachPath(reason, tuple(blocked), opening)


@dataclass(frozen=True)
class ApproachPath:
    """Result of a search for a free approach: a direction, or the reason why there is none.

    Parameters
    ----------
    reason : str
        Why no direction is free; empty where one is.
    blocked : tuple of BlockedDirection
        The blocked directions that were tried before.
    fingers : OpeningPath or None
        Opening of the fingers; None where they do not open.
    direction : (3,) array or None
        Direction of the palm's motion towards the grasp, unit, body frame.
    distance : float
        Length of the path, metres.
    outside : tuple of PathPosture
        Postures from the open hand at the grasp on, away from it.
    """

    reason: str
    blocked: tuple[BlockedDirection, ...] = ()
    fingers: OpeningPath | None = None
    direction: FloatArray | None = None
    distance: float = 0.0
    outside: tuple[PathPosture, ...] = ()


@dataclass(frozen=True)
class BlockedDirection:
    """Approach direction that is not collision-free, with the obstruction.

    Parameters
    ----------
    direction : (3,) array
        Of the palm towards the grasp, unit, body frame.
    free : float
        Distance from the grasp up to which the path is free, metres.
    times : float
        How wide the fingers were open, times the pregrasp's opening.
    reason : str
        What blocks the path there.
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
    """Return candidate approach directions, by increasing angle from the direction in which the palm faces.

    Parameters
    ----------
    hand : URDFHand
    values : dict
        Of its variables in the grasp.
    count : int
        Number of directions spread over the sphere, to which the axes of palm and body are added, both ways; 1 for the
        palm's facing direction alone.

    Returns
    -------
    list of (3,) arrays
        Unit, body frame.
    """
    facing = palm_direction(hand, values)
    directions = directions_around(facing, count)
    if count > 1:
        axes = np.concatenate([hand.tree.palm_frame(values)[:3, :3].T, np.eye(3)])
        directions = np.concatenate([directions, axes, -axes])
    result: list[FloatArray] = []
    for direction in directions[np.argsort(-(directions @ facing), kind="stable")]:
        if all(direction @ other < 1.0 - DIRECTION_TOLERANCE for other in result):
            result.append(direction)
    return result


def palm_direction(hand: URDFHand, values: Values) -> FloatArray:
    """Return the direction in which the palm faces, (3,), body frame."""
    return np.asarray(hand.tree.palm_frame(values)[:3, :3] @ hand.tree.approach)


def open_fingers(
    model: HandClearance, grasp: Values, pregrasp: Values, factor: float, depth: float = 0.0
) -> OpeningPath:
    """Return the path on which the hand opens, from the grasp towards a multiple of the pregrasp's opening.

    All joints move together; those that are blocked stop, and the others continue. Links that penetrate something in
    the grasp may do so on the path too, no deeper.

    Parameters
    ----------
    model : HandClearance
    grasp, pregrasp : dict
        Values of the hand's variables.
    factor : float
        1 for the pregrasp itself.
    depth : float
        How deep links may be in the body, metres.
    """
    lower, upper = model.hand.tree.joint_limits
    joints = grasp["joints"] + factor * (pregrasp["joints"] - grasp["joints"])
    goal = {**grasp, "joints": np.clip(joints, lower, upper), "palm_position": pregrasp["palm_position"]}
    limits = partial(_clearance_limits, model, depth)
    postures, is_free, blocked_by, leg_count = list[PathPosture](), np.ones(len(lower), bool), "", 0
    while not postures or is_free.any():
        start = postures[-1].values if postures else grasp
        leg = follow_straight_path(model, _straight_motion(model, start, goal, is_free), limits)
        if not leg.postures:
            return OpeningPath((), leg.blocked_by)
        leg_count += len(leg.postures) > 1
        postures += leg.postures[1:] if postures else leg.postures
        _drop_penetrating(postures, depth)
        blocked_by = blocked_by or leg.blocked_by
        # no obstruction, or none that a free joint moves; joints of a linkage do not stop on their own
        if not np.any(is_free & leg.moving_joints) or model.hand.closed_linkages:
            break
        is_free &= ~leg.moving_joints
    return OpeningPath(tuple(postures), "" if len(postures) > 1 else blocked_by, leg_count <= 1)


def open_hand_straight(
    model: HandClearance, grasp: Values, pregrasp: Values, factor: float, depth: float = 0.0
) -> OpeningPath:
    """Return a path on which the hand opens along one straight line in joint space.

    It leads towards the last posture of ``open_fingers``, whose path is returned if it is straight or blocked.
    """
    opening = open_fingers(model, grasp, pregrasp, factor, depth)
    if opening.blocked_by or opening.straight:
        return opening
    goal, is_free = opening.values, np.ones(len(grasp["joints"]), bool)
    limits = partial(_clearance_limits, model, depth)
    path = follow_straight_path(model, _straight_motion(model, grasp, goal, is_free), limits)
    postures = list(path.postures)
    _drop_penetrating(postures, depth)
    return OpeningPath(tuple(postures), "" if len(postures) > 1 else path.blocked_by)


@dataclass(frozen=True)
class OpeningPath:
    """Opening path of a hand: postures from the grasp to the open hand.

    Parameters
    ----------
    postures : tuple of PathPosture
        The grasp first.
    blocked_by : str
        The obstruction where no finger opens at all; empty otherwise.
    straight : bool
        Whether the path is one straight line in joint space.
    """

    postures: tuple[PathPosture, ...]
    blocked_by: str
    straight: bool = True

    @property
    def values(self) -> Values:
        """Values of the hand's variables at the end of the path."""
        return self.postures[-1].values


def opening_distances(model: HandClearance, values: Values, grasp: Values) -> FloatArray:
    """Return each fingertip's distance from its place in the grasp, (k,), metres, palm frame."""
    open_tips, grasp_tips = model.hand.tree.palm_tips(np.stack([values["joints"], grasp["joints"]]))
    return np.asarray(np.linalg.norm(open_tips - grasp_tips, axis=1))


def _refined_directions(directions: Sequence[FloatArray], blocked: Sequence[BlockedDirection]) -> Iterator[FloatArray]:
    """Yield given directions, then ever closer neighbours of the direction with the longest free path.

    The caller extends ``blocked``.
    """
    count = len(blocked)
    yield from directions
    if len(directions) == 1:
        return
    for angle in CLOSER_ANGLES:
        best = max(blocked[count:], key=lambda b: b.free)
        if best.free <= 0.0:
            return
        yield from directions_beside(best.direction, angle, CLOSER_COUNT)


def _free_retreat(
    model: HandClearance, start: Values, direction: FloatArray, distance: float, locate: bool, depth: float = 0.0
) -> StraightPath:
    """Return the collision-free part of the open hand's straight retreat from the grasp."""
    limits = partial(_clearance_limits, model, depth)
    return follow_straight_path(model, lambda share: _retreat(start, direction, share * distance), limits, locate)


def _retreat(start: Values, direction: FloatArray, distance: float) -> Values:
    """Return the open hand's variables after a retreat by a distance, metres."""
    return {**start, "palm_position": start["palm_position"] - distance * direction}


def missing_room(model: HandClearance, start: Values, directions: Sequence[FloatArray], length: float) -> str:
    """Return the table or obstacle that alone blocks a direction, and by how much, as text.

    Of several the one with the least missing room; empty where every direction has other obstructions, too. A table
    that is lower by as much is out of the way. Of an obstacle the depth of the links is stated, which is less than they
    need where they would pass through it.
    """
    candidates = sorted(_depths_of_fields(model, start, directions, length), key=lambda candidate: candidate[0])
    for depth, index, direction in candidates[:MOST_ROOMS]:
        room = depth + ROOM_STEP / 2.0  # the distance falls by at most this much between two samples
        if not _free_retreat(model.with_room(index, room), start, direction, length, False).blocked_by:
            towards = np.array2string(direction, precision=2, suppress_small=True)
            solid = model.fields[index].solid
            takes = f"{1e3 * room:.1f} mm more" if solid == TABLE else f"at least {1e3 * depth:.1f} mm more"
            return f"; along {towards} only {solid} is in the way, and takes {takes} room"
    return ""


def _depths_of_fields(
    model: HandClearance, start: Values, directions: Sequence[FloatArray], length: float
) -> Iterator[tuple[float, int, FloatArray]]:
    """Yield penetration depth, field index and direction of each retreat that enters exactly one table or obstacle.

    Depths are in metres.
    """
    outline, radii = model.parts.outline(start)
    lengths = np.linspace(0.0, length, int(np.ceil(length / ROOM_STEP)) + 1)
    for direction in directions:
        points = (outline - lengths[:, None, None] * direction).reshape(-1, 3)
        reach = np.tile(radii, len(lengths))
        depths = [-float(np.min(field.distance(points) - reach, initial=0.0)) for field in model.fields[1:]]
        deep = [i for i, depth in enumerate(depths, 1) if depth > model.tolerance]
        if len(deep) == 1:
            yield depths[deep[0] - 1], deep[0], direction


def _blocking_reason(blocked: list[BlockedDirection], count: int, distance: float) -> str:
    """Return the reason why all directions are blocked, as text, with the longest free path."""
    best = max(blocked, key=lambda b: b.free)
    direction = np.array2string(best.direction, precision=2, suppress_small=True)
    longest = f"the longest, along {direction}, is free for {1e3 * best.free:.0f} mm: {best.reason}"
    subject = "the direction is not" if count == 1 else f"none of {count} directions is"
    return f"{subject} free for {1e3 * distance:.0f} mm; {longest}"


def _clearance_limits(model: HandClearance, depth: float, first: PathPosture) -> FloatArray:
    """Return the least admissible clearances, (n,), metres.

    From tables and obstacles zero; from the body and between links as negative as in the first posture, if not zero,
    and from the body as a depth.
    """
    of_body = model.body_mask()
    limits = np.where(of_body, -depth, 0.0)
    relaxed = of_body | (np.arange(len(limits)) >= model.from_fields())
    return np.where(relaxed, np.minimum(first.clearances, limits), limits)


def _straight_motion(
    model: HandClearance, start: Values, goal: Values, is_free: BoolArray
) -> Callable[[float], Values]:
    """Return a function from fraction to variables: the straight path of the free joints to their goal.

    The palm moves only while all joints are free. Joints of linkages leave the line as far as these stay closed.
    """
    targets = {"joints": np.where(is_free, goal["joints"], start["joints"])}
    targets["palm_position"] = goal["palm_position"] if is_free.all() else start["palm_position"]

    def posture(fraction: float) -> Values:
        moved = {name: start[name] + fraction * (end - start[name]) for name, end in targets.items()}
        return {**start, **moved, "joints": model.hand.tree.close(moved["joints"])}

    return posture


def _drop_penetrating(postures: list[PathPosture], depth: float) -> None:
    """Remove the last postures of a path while they penetrate deeper than the first."""
    least = [float(np.min(posture.clearances, initial=np.inf)) for posture in postures]
    while len(postures) > 1 and least[len(postures) - 1] < min(-depth, least[0]):
        postures.pop()
