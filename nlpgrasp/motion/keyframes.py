"""Keyframes of a grasp: approach, pregrasp, grasp, squeeze and lift."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np

from nlpgrasp.bodies import Body, Mesh
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.constraints import Table
from nlpgrasp.hands import URDFHand
from nlpgrasp.hands.base import PosedHand, Values
from nlpgrasp.motion.approach_path import ApproachPath, approach_candidates, find_free_approach, open_hand_straight
from nlpgrasp.motion.clearance import HandClearance
from nlpgrasp.motion.distance_fields import build_distance_fields
from nlpgrasp.motion.penetration import PenetrationModel
from nlpgrasp.motion.straight_path import certified_clearance
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.solution.phase_record import APPROACH, GRASP, LIFT, PREGRASP, SQUEEZE, Phase

LIFT_HEIGHT = 0.2  # metres
STEP = 2e-3  # metres, least step of the lift's collision check
SAMPLES = 4000  # samples of the body's surface for this check
START_DISTANCE = 0.1  # metres between hand and body at the start of the approach
DIRECTIONS = 60  # approach directions, spread over the sphere
NO_PREGRASP = "the hand has no pregrasp"
PENETRATES = "links penetrate something in the grasp itself"


def plan_keyframes(
    problem: GraspProblem,
    hand: URDFHand,
    grasp: Values,
    pregrasp: Values | None,
    links: PenetrationModel | None = None,
    model: HandClearance | None = None,
) -> Json:
    """Return the keyframes from approach to grasp, with the lift, as JSON data.

    The palm keeps its orientation. It moves straight, in the first free one of many directions, of which its facing
    direction is the first, from where a plane across the direction separates hand and body, 0.1 m from the hand. A
    link that touches the body on the way pushes it away, so on the first free way sought no link is deeper in anything
    than in the grasp; only where there is none may links penetrate the body within the tolerance.

    Parameters
    ----------
    problem : GraspProblem
    hand : URDFHand
    grasp, pregrasp : dict
        Values of the hand's variables; None where there is no pregrasp.
    links : PenetrationModel, optional
    model : HandClearance, optional
        Both of the same problem and hand, where they exist already.

    Returns
    -------
    dict
        ``approach`` (``direction`` and ``distance``, or the ``reason`` why there is none, such as links that penetrate
        something in the grasp itself), ``way_in`` (penetration of the links on that path and while the fingers close),
        ``phases`` and ``lift``.
    """
    model = model or HandClearance(problem, hand)
    links = links or PenetrationModel(problem, hand, parts=model.parts)
    grasp_phase = Phase.of(GRASP, hand.describe(grasp))
    entries: dict[str, Json | list[Json]] = {
        "phases": [grasp_phase.to_dict()],
        "lift": lift_distance(model, problem, grasp),
    }
    if pregrasp is None:
        return {"approach": _missing_approach_record(NO_PREGRASP), **entries}
    if not links.in_posture(grasp).is_free:
        return {"approach": _missing_approach_record(PENETRATES), **entries}
    palm_model, path = model.for_palm_motion(), ApproachPath(NO_PREGRASP)
    for depth in (0.0, links.tolerance - model.tolerance):
        if path.direction is None:
            path = find_free_approach(
                palm_model,
                partial(open_hand_straight, model, grasp, pregrasp, depth=depth),
                approach_candidates(hand, grasp, DIRECTIONS),
                lambda values, direction: _retraction_length(model, problem.body.bounds, values, direction),
                locate=False,
                depth=depth,
            )
    if path.fingers is None or not path.fingers.postures:
        return {"approach": _missing_approach_record(path.reason), **entries}
    if links.has_shapes:
        entries["way_in"] = links.on_way([*path.fingers.postures[1:], *path.outside[1:]]).to_dict()
    open_hand = hand.describe(path.fingers.values)
    if path.direction is None:
        approach = _missing_approach_record(path.reason)
        phases = [Phase.of(PREGRASP, open_hand), grasp_phase]
    else:
        approach = {"direction": path.direction.tolist(), "distance": path.distance}
        pregrasp_phase = Phase.of(PREGRASP, open_hand, certified_clearance(palm_model, path.outside))
        phases = [Phase.of(APPROACH, hand.describe(path.outside[-1].values)), pregrasp_phase, grasp_phase]
    return {"approach": approach, **entries, "phases": [phase.to_dict() for phase in phases]}


def add_squeeze_and_lift(hand: PosedHand, posture: Json, positions: Mapping[str, float]) -> Json:
    """Return a hand's JSON data with the keyframes after the grasp: squeeze and lift.

    Parameters
    ----------
    hand : PosedHand
    posture : mapping
        ``hand`` of a file; without ``phases`` it is returned as it is.
    positions : mapping of str to float
        Commanded positions, by joint.
    """
    if not posture.get("phases"):
        return posture
    grasp = posture["phases"][-1]
    commanded = {**posture, "joint_positions": {**posture["joint_positions"], **positions}}
    joints = hand.describe(hand.values_of(commanded))["joint_positions"]  # mimic joints included
    squeezed = Phase.of(SQUEEZE, {**grasp, "joint_positions": joints})
    lift_entry = posture["lift"]
    raised = squeezed.palm_position + lift_entry["distance"] * np.asarray(lift_entry["direction"])
    lift = Phase(LIFT, raised, squeezed.palm_quaternion, squeezed.joints)
    return {**posture, "phases": [*posture["phases"], squeezed.to_dict(), lift.to_dict()]}


def lift_distance(model: HandClearance, problem: GraspProblem, values: Values) -> Json:
    """Return direction and collision-free distance of a lift along the last axis, as JSON data.

    The links and samples of the body's surface are checked, at steps as long as their distance from obstacles
    or of two millimetres; they may stay as near as they are in the grasp. From a table they all move away.

    Parameters
    ----------
    model : HandClearance
    problem : GraspProblem
    values : dict
        Of the hand's variables in the grasp.

    Returns
    -------
    dict
        ``direction``, ``distance`` in metres, and, where it is less than 0.2 m, the ``reason``.
    """
    direction, body = np.eye(3)[-1], problem.body
    constraints = tuple(constraint for constraint in problem.constraints if not isinstance(constraint, Table))
    around = build_distance_fields(body, constraints, model.hand.count)[1:] if constraints else []
    height, reason = LIFT_HEIGHT, ""
    if around:
        height, blocked_by = _free_height(model, [field.name for field in around], values)
        reason = f"{blocked_by} is in the way of a lift by {1e3 * LIFT_HEIGHT:.0f} mm" if blocked_by else ""
    return {"direction": direction.tolist(), "distance": height, **({"reason": reason} if reason else {})}


def body_samples(body: Body, rng: np.random.Generator) -> FloatArray:
    """Return samples (m, 3) of the body's surface, including the vertices of a mesh."""
    if isinstance(body, Mesh):
        vertices = np.asarray(body.mesh.vertices, dtype=float)
        return np.concatenate([vertices, body.surface_samples(SAMPLES, rng)[0]])
    count = max(SAMPLES // len(body.face_names), 50)
    return np.concatenate([body.sample(name, count, rng) for name in body.face_names])


def _retraction_length(model: HandClearance, bounds: FloatArray, values: Values, direction: FloatArray) -> float:
    """Return how far the palm retracts, metres, until the hand is clear of the body's bounding box."""
    box_end = np.where(direction > 0.0, bounds[0], bounds[1]) @ direction  # the end of the box on the hand's side
    hand_end = model.parts.extent(values, direction)
    return float(max(hand_end - box_end, 0.0) + START_DISTANCE)


def _free_height(model: HandClearance, around: Sequence[str], values: Values) -> tuple[float, str]:
    """Return the height to which hand and body rise freely, metres, and the obstacle that stops them, if any.

    ``around`` are names of the fields that they may run into.
    """
    samples, up = body_samples(model.body, np.random.default_rng(0)), np.eye(3)[-1]
    numbers = [number for number, field in enumerate(model.fields) if field.name in around]
    frames = model.parts.frames_of([values])

    def at(height: float) -> list[FloatArray]:
        raised = frames.copy()
        raised[..., :3, 3] += height * up
        of_body = [model.fields[number].distance(samples + height * up) for number in numbers]
        return [np.append(model.field_clearances(i, raised)[0], d) for i, d in zip(numbers, of_body, strict=True)]

    clearances = at(0.0)
    limits = [np.minimum(clearance, 0.0) for clearance in clearances]  # no deeper than at the start
    height = 0.0
    while height < LIFT_HEIGHT:
        # no clearance shrinks by more than the rise; at least ``STEP``, or links at their limit would never rise
        advance = min(float(np.min(clearance - limit)) for clearance, limit in zip(clearances, limits, strict=True))
        next_height = min(height + max(STEP, advance), LIFT_HEIGHT)
        clearances = at(next_height)
        for number, clearance, limit in zip(numbers, clearances, limits, strict=True):
            if np.any(clearance < limit - model.tolerance):
                return height, model.fields[number].name
        height = next_height
    return LIFT_HEIGHT, ""


def _missing_approach_record(reason: str) -> Json:
    """Return the JSON data of a missing approach."""
    return {"direction": None, "distance": None, "reason": reason}
