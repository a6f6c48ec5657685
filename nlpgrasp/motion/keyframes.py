"""Keyframes of a grasp: approach, pregrasp, grasp, squeeze and lift."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from nlpgrasp.bodies import Body, Mesh
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.constraints import Table
from nlpgrasp.hands import URDFHand
from nlpgrasp.hands.base import PosedHand, Values
from nlpgrasp.motion.approach_path import approach_candidates, free_approach, open_hand_straight
from nlpgrasp.motion.distance_fields import Field, fields_of
from nlpgrasp.motion.link_clearance import CollisionModel
from nlpgrasp.motion.penetration import PenetrationModel
from nlpgrasp.motion.straight_path import certified_clearance
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.solution.phase_record import APPROACH, GRASP, LIFT, PREGRASP, SQUEEZE, Phase

LIFT_HEIGHT = 0.2  # metres
STEP = 2e-3  # metres, least step of the lift's collision check
SAMPLES = 4000  # of the body's surface, for this check
AWAY = 0.1  # metres between hand and body at the start of the approach
DIRECTIONS = 60  # of the approach, spread over the sphere
NO_PREGRASP = "the hand has no pregrasp"


def plan_keyframes(
    problem: GraspProblem, hand: URDFHand, grasp: Values, pregrasp: Values | None, links: PenetrationModel | None = None
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
    links : PenetrationModel, optional
        Of the same problem and hand, where they are known.

    Returns
    -------
    dict
        ``approach`` (``direction`` and ``distance``, or the ``reason`` why there is none), ``way_in`` (how deep the
        links themselves are in anything on that way and while the fingers close), ``phases`` and ``lift``.
    """
    around = CollisionModel(problem, hand)
    last = Phase.of(GRASP, hand.describe(grasp))
    rest: dict[str, Json | list[Json]] = {"phases": [last.to_dict()], "lift": lift_distance(around, problem, grasp)}
    if pregrasp is None:
        return {"approach": _without_phases(NO_PREGRASP), **rest}
    before = pregrasp  # by another name, for the closure
    rigid = around.of_palm()
    found = free_approach(
        rigid,
        lambda times: open_hand_straight(around, grasp, before, times),
        approach_candidates(hand, grasp, DIRECTIONS),
        lambda values, way: _retraction_length(around, problem.body.bounds, values, way),
        locate=False,
    )
    if found.fingers is None:
        return {"approach": _without_phases(found.reason), **rest}
    open_hand = hand.describe(found.fingers.values)
    turns = [found.fingers.values] if found.direction is None else [found.outside[-1].values, found.fingers.values]
    links = links or PenetrationModel(problem, hand)
    if links.has_shapes:
        rest["way_in"] = links.on_approach(turns, grasp).to_dict()
    if found.direction is None:
        phases = [Phase.of(PREGRASP, open_hand), last]
        return {"approach": _without_phases(found.reason), **rest, "phases": [phase.to_dict() for phase in phases]}
    afar = Phase.of(APPROACH, hand.describe(found.outside[-1].values))
    phases = [afar, Phase.of(PREGRASP, open_hand, certified_clearance(rigid, found.outside)), last]
    approach = {"direction": found.direction.tolist(), "distance": found.distance}
    return {"approach": approach, **rest, "phases": [phase.to_dict() for phase in phases]}


def add_squeeze_and_lift(hand: PosedHand, posture: Json, positions: Mapping[str, float]) -> Json:
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


def lift_distance(around: CollisionModel, problem: GraspProblem, values: Values) -> Json:
    """Return direction and distance of a lift: along the table's normal, the last axis, as far as that is free.

    The links' balls and samples of the body's surface are looked at, at steps as long as their distance from obstacles
    or of two millimetres; they may stay as near as they are in the grasp. From a table they all move away.

    Parameters
    ----------
    around : CollisionModel
    problem : GraspProblem
    values : dict
        Of the hand's variables in the grasp.

    Returns
    -------
    dict
        ``direction``, ``distance`` in metres, and, where it is less than 0.2 m, the ``reason``.
    """
    up, body = np.eye(3)[-1], problem.body
    above = [constraint for constraint in problem.constraints if not isinstance(constraint, Table)]
    others = fields_of(body, above, around.hand.count)[1:] if above else []
    height, reason = LIFT_HEIGHT, ""
    if others:
        samples = body_samples(body, np.random.default_rng(0))
        points = np.concatenate([around.balls.places(values), samples])
        radii = np.concatenate([around.balls.radii, np.zeros(len(samples))])
        height, blocked_by = _free_height(others, points, radii, around.tolerance)
        reason = f"{blocked_by} is in the way of a lift by {1e3 * LIFT_HEIGHT:.0f} mm" if blocked_by else ""
    return {"direction": up.tolist(), "distance": height, **({"reason": reason} if reason else {})}


def body_samples(body: Body, rng: np.random.Generator) -> FloatArray:
    """Return samples (m, 3) of the body's surface; of a mesh its vertices too."""
    if isinstance(body, Mesh):
        vertices = np.asarray(body.mesh.vertices, dtype=float)
        return np.concatenate([vertices, body.surface_samples(SAMPLES, rng)[0]])
    each = max(SAMPLES // len(body.face_names), 50)
    return np.concatenate([body.sample(name, each, rng) for name in body.face_names])


def _retraction_length(around: CollisionModel, bounds: FloatArray, values: Values, way: FloatArray) -> float:
    """Return how far the palm retracts along a direction until the hand is clear of the body's bounding box."""
    box = np.where(way > 0.0, bounds[0], bounds[1]) @ way  # the box's end that the hand comes to first
    reached = np.max(around.balls.places(values) @ way + around.balls.radii)
    return float(max(reached - box, 0.0) + AWAY)


def _free_height(fields: Sequence[Field], points: FloatArray, radii: FloatArray, tolerance: float) -> tuple[float, str]:
    """Return the collision-free height of spheres (m, 3), metres, and the obstacle where it is less than the lift."""
    first = [field.distance(points) - radii for field in fields]
    least, height, rooms, up = [np.minimum(room, 0.0) for room in first], 0.0, first, np.eye(3)[-1]
    while height < LIFT_HEIGHT:
        near = min(float(np.min(room - start)) for room, start in zip(rooms, least, strict=True))
        above = min(height + max(STEP, near), LIFT_HEIGHT)
        rooms = [field.distance(points + above * up) - radii for field in fields]
        for field, room, start in zip(fields, rooms, least, strict=True):
            if np.any(room < start - tolerance):
                return height, field.name
        height = above
    return LIFT_HEIGHT, ""


def _without_phases(reason: str) -> Json:
    return {"direction": None, "distance": None, "reason": reason}
