"""Keyframes of a grasp: approach, pregrasp, grasp, squeeze and lift."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.hands import URDFHand
from nlpgrasp.hands.base import Values
from nlpgrasp.hands.posed_hand import PosedHand
from nlpgrasp.motion.phases.approach import free_approach, ways_of_palm
from nlpgrasp.motion.phases.lifted import lifted
from nlpgrasp.motion.phases.opened import opened_straight
from nlpgrasp.motion.space.link_depth import LinkDepths
from nlpgrasp.motion.space.room import least_room
from nlpgrasp.motion.space.surroundings import Surroundings
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.solution.phases.phase import APPROACH, GRASP, LIFT, PREGRASP, SQUEEZE, Phase

AWAY = 0.1  # metres between hand and body at the start of the approach
DIRECTIONS = 60
NO_PREGRASP = "the hand has no pregrasp"


def keyframes(
    problem: GraspProblem, hand: URDFHand, grasp: Values, pregrasp: Values | None, links: LinkDepths | None = None
) -> Json:
    """Return the phases up to the grasp, as JSON data beside the pregrasp.

    The palm keeps its orientation. It comes straight, in the first free one of many directions, that in which it faces
    before all others, from where a plane across the direction is between hand and body with 0.1 m on the hand's side.

    Parameters
    ----------
    problem : GraspProblem
    hand : URDFHand
    grasp, pregrasp : dict
        Values of the hand's variables; None where there is no pregrasp.
    links : LinkDepths, optional
        Of the same problem and hand, where they are known.

    Returns
    -------
    dict
        ``approach`` (``direction`` and ``distance``, or the ``reason`` why there is none), ``way_in`` (how deep the
        links themselves are in anything on that way and while the fingers close), ``phases`` and ``lift``.
    """
    around = Surroundings(problem, hand)
    last = Phase.of(GRASP, hand.describe(grasp))
    rest: dict[str, Json | list[Json]] = {"phases": [last.to_dict()], "lift": lifted(around, problem, grasp)}
    if pregrasp is None:
        return {"approach": _none(NO_PREGRASP), **rest}
    before = pregrasp  # by another name, for the closure
    rigid = around.of_palm()
    found = free_approach(
        rigid,
        lambda times: opened_straight(around, grasp, before, times),
        ways_of_palm(hand, grasp, DIRECTIONS),
        lambda values, way: _until_apart(around, problem.body.bounds, values, way),
        locate=False,
    )
    if found.fingers is None:
        return {"approach": _none(found.reason), **rest}
    open_hand = hand.describe(found.fingers.values)
    turns = [found.fingers.values] if found.direction is None else [found.outside[-1].values, found.fingers.values]
    links = links or LinkDepths(problem, hand)
    if links.has_shapes:
        rest["way_in"] = links.on_the_way(turns, grasp).to_dict()
    if found.direction is None:
        phases = [Phase.of(PREGRASP, open_hand), last]
        return {"approach": _none(found.reason), **rest, "phases": [phase.to_dict() for phase in phases]}
    afar = Phase.of(APPROACH, hand.describe(found.outside[-1].values))
    phases = [afar, Phase.of(PREGRASP, open_hand, least_room(rigid, found.outside)), last]
    approach = {"direction": found.direction.tolist(), "distance": found.distance}
    return {"approach": approach, **rest, "phases": [phase.to_dict() for phase in phases]}


def _none(reason: str) -> Json:
    return {"direction": None, "distance": None, "reason": reason}


def _until_apart(around: Surroundings, bounds: FloatArray, values: Values, way: FloatArray) -> float:
    """Return how far the palm retracts along a direction until the hand is clear of the body's bounding box."""
    box = np.where(way > 0.0, bounds[0], bounds[1]) @ way  # the box's end that the hand comes to first
    reached = np.max(around.balls.places(values) @ way + around.balls.radii)
    return float(max(reached - box, 0.0) + AWAY)


def with_commands(hand: PosedHand, posture: Json, positions: Mapping[str, float]) -> Json:
    """Return a hand's entry with the phases after the grasp: squeeze and lift.

    Parameters
    ----------
    hand : PosedHand
    posture : mapping
        ``hand`` of a file; without ``phases`` it is returned as it is.
    positions : mapping of str to float
        That joints are commanded to.
    """
    if not posture.get("phases"):
        return posture
    grasp = posture["phases"][-1]
    told = {**posture, "joint_positions": {**posture["joint_positions"], **positions}}
    joints = hand.describe(hand.values_of(told))["joint_positions"]  # those that follow others too
    squeezed = Phase.of(SQUEEZE, {**grasp, "joint_positions": joints})
    up = posture["lift"]
    raised = squeezed.palm_position + up["distance"] * np.asarray(up["direction"])
    lift = Phase(LIFT, raised, squeezed.palm_quaternion, squeezed.joints)
    return {**posture, "phases": [*posture["phases"], squeezed.to_dict(), lift.to_dict()]}
