"""Keyframes of a grasp: approach, pregrasp, grasp, squeeze and lift."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np

from nlpgrasp.bodies import Body, Mesh
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.constraints import Table
from nlpgrasp.hands import URDFHand
from nlpgrasp.hands.base import PosedHand, Values
from nlpgrasp.motion.approach_path import OpeningPath, approach_candidates, find_free_approach, open_hand_straight
from nlpgrasp.motion.distance_fields import DistanceField, build_distance_fields
from nlpgrasp.motion.link_clearance import CollisionModel
from nlpgrasp.motion.penetration import PathPenetration, PenetrationModel
from nlpgrasp.motion.straight_path import certified_clearance
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.solution.obstructions import LinkPenetration
from nlpgrasp.solution.phase_record import APPROACH, GRASP, LIFT, PREGRASP, SQUEEZE, Phase

LIFT_HEIGHT = 0.2  # metres
STEP = 2e-3  # metres, least step of the lift's collision check
SAMPLES = 4000  # samples of the body's surface for this check
START_DISTANCE = 0.1  # metres between hand and body at the start of the approach
DIRECTIONS = 60  # approach directions, spread over the sphere
OPENING_SHARES = (1.0, 0.5, 0.25)  # of the pregrasp's opening, tried until the fingers close freely
GENTLE = 1e-4  # metres: largest depth of a link on its way in that does not move the body
MOST_TOUCHING = 4  # free ways of the links' spheres that are tried for touching nothing, then for being free
NO_PREGRASP = "the hand has no pregrasp"
PENETRATES = "links penetrate something in the grasp itself"


def plan_keyframes(
    problem: GraspProblem,
    hand: URDFHand,
    grasp: Values,
    pregrasp: Values | None,
    links: PenetrationModel | None = None,
    spheres: CollisionModel | None = None,
) -> Json:
    """Return the keyframes from approach to grasp, with the lift, as JSON data.

    The palm keeps its orientation. It moves straight, in the first free one of many directions, of which its facing
    direction is the first, from where a plane across the direction separates hand and body, 0.1 m from the hand. Of
    the first few that are free for the links' spheres one is taken that is free for their own shapes, too, if any is.
    The fingers open less than in the pregrasp where their links would run into something.

    Parameters
    ----------
    problem : GraspProblem
    hand : URDFHand
    grasp, pregrasp : dict
        Values of the hand's variables; None where there is no pregrasp.
    links : PenetrationModel, optional
    spheres : CollisionModel, optional
        Both of the same problem and hand, where they exist already.

    Returns
    -------
    dict
        ``approach`` (``direction`` and ``distance``, or the ``reason`` why there is none, such as links that penetrate
        something in the grasp itself), ``way_in`` (penetration of the links' own shapes on that path and while the
        fingers close), ``phases`` and ``lift``.
    """
    model = spheres or CollisionModel(problem, hand)
    grasp_phase = Phase.of(GRASP, hand.describe(grasp))
    entries: dict[str, Json | list[Json]] = {
        "phases": [grasp_phase.to_dict()],
        "lift": lift_distance(model, problem, grasp),
    }
    if pregrasp is None:
        return {"approach": _missing_approach_record(NO_PREGRASP), **entries}
    links = links or PenetrationModel(problem, hand)
    if links.has_shapes and not links.in_posture(grasp).is_free:
        return {"approach": _missing_approach_record(PENETRATES), **entries}
    palm_model, shapes = model.for_palm_motion(), _ShapeCheck(links, grasp)
    open_straight = partial(open_hand_straight, model, grasp, pregrasp)
    opening = shapes.free_opening(open_straight)
    path = find_free_approach(
        palm_model,
        lambda factor: open_straight(opening * factor),
        approach_candidates(hand, grasp, DIRECTIONS),
        lambda values, direction: _retraction_length(model, problem.body.bounds, values, direction),
        locate=False,
        touching=shapes.touching,
    )
    if path.fingers is None:
        return {"approach": _missing_approach_record(path.reason), **entries}
    way_in = shapes.way_in(path.fingers.values, path.direction is not None)
    entries |= {} if way_in is None else {"way_in": way_in.to_dict()}
    open_hand = hand.describe(path.fingers.values)
    if path.direction is None:
        approach = _missing_approach_record(path.reason)
        phases = [Phase.of(PREGRASP, open_hand), grasp_phase]
    else:
        approach = {"direction": path.direction.tolist(), "distance": path.distance}
        pregrasp_phase = Phase.of(PREGRASP, open_hand, certified_clearance(palm_model, path.outside))
        phases = [Phase.of(APPROACH, hand.describe(path.outside[-1].values)), pregrasp_phase, grasp_phase]
    return {"approach": approach, **entries, "phases": [phase.to_dict() for phase in phases]}


class _ShapeCheck:
    """Check of openings and approaches by the links' collision shapes, after a check by their spheres.

    A link that touches the body on the way pushes it away, so ways are preferred on which links are at most ``GENTLE``
    inside the body and its surroundings. The first ``MOST_TOUCHING`` approaches that are free for the spheres have to
    be such, as far as the closing of the fingers is; the next as many have to be free within the tolerance. The last
    one is kept in any case, and its penetration is recorded as ``way_in``.

    Parameters
    ----------
    links : PenetrationModel
    grasp : dict
        Values of the hand's variables.
    """

    def __init__(self, links: PenetrationModel, grasp: Values) -> None:
        self._links, self._grasp = links, grasp
        self._on_approaches: list[LinkPenetration] = []
        self._closings: list[tuple[Values, PathPenetration]] = []  # open hands, and what closing from them shows

    def free_opening(self, open_hand: Callable[[float], OpeningPath]) -> float:
        """Return the fraction of the pregrasp's opening from which the fingers close without touching anything.

        Of ``OPENING_SHARES`` the first one; else the first one without penetration; 1 if there is none, or if the links
        have no shapes.
        """
        free = list[float]()
        for fraction in OPENING_SHARES if self._links.has_shapes else ():
            opened = open_hand(fraction)
            if not opened.postures:
                continue
            closing = self._while_closing(opened.values)
            if closing.deepest.is_free:
                free.append(fraction)
                if closing.surroundings_depth <= GENTLE:
                    return fraction
        return free[0] if free else 1.0

    def touching(self, corners: Sequence[Values]) -> str:
        """Return, as text, what the links run into on an approach; empty if the approach is kept.

        The approach goes through the postures ``corners``.
        """
        if not self._links.has_shapes:
            return ""
        *before, opened = corners
        approach, closing = self._links.on_approach(before, opened), self._while_closing(opened)
        whole = approach.followed_by(closing)
        self._on_approaches.append(whole.deepest)
        tried = len(self._on_approaches)
        is_gentle = approach.surroundings_depth <= max(GENTLE, closing.surroundings_depth)
        is_kept = whole.deepest.is_free and (is_gentle or tried > MOST_TOUCHING)
        return "" if is_kept or tried == 2 * MOST_TOUCHING else whole.deepest.words

    def way_in(self, opened: Values, has_approach: bool) -> LinkPenetration | None:
        """Return the penetration of the links' shapes on the way to the grasp; None if they have no shapes.

        The way is the last approach that was checked, or without an approach the closing of the fingers alone.
        """
        if not self._links.has_shapes:
            return None
        return self._on_approaches[-1] if has_approach else self._while_closing(opened).deepest

    def _while_closing(self, opened: Values) -> PathPenetration:
        """Return the penetrations while the fingers close from an open hand, with a cache."""
        for values, penetration in self._closings:
            if all(np.array_equal(values[name], opened[name]) for name in opened):
                return penetration
        self._closings.append((opened, self._links.on_approach([opened], self._grasp)))
        return self._closings[-1][1]


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


def lift_distance(model: CollisionModel, problem: GraspProblem, values: Values) -> Json:
    """Return direction and collision-free distance of a lift along the last axis, as JSON data.

    The links' spheres and samples of the body's surface are checked, at steps as long as their distance from obstacles
    or of two millimetres; they may stay as near as they are in the grasp. From a table they all move away.

    Parameters
    ----------
    model : CollisionModel
    problem : GraspProblem
    values : dict
        Of the hand's variables in the grasp.

    Returns
    -------
    dict
        ``direction``, ``distance`` in metres, and, where it is less than 0.2 m, the ``reason``.
    """
    direction, body = np.eye(3)[-1], problem.body
    constraints = [constraint for constraint in problem.constraints if not isinstance(constraint, Table)]
    fields = build_distance_fields(body, constraints, model.hand.count)[1:] if constraints else []
    height, reason = LIFT_HEIGHT, ""
    if fields:
        samples = body_samples(body, np.random.default_rng(0))
        points = np.concatenate([model.spheres.centres(values), samples])
        radii = np.concatenate([model.spheres.radii, np.zeros(len(samples))])
        height, blocked_by = _free_height(fields, points, radii, model.tolerance)
        reason = f"{blocked_by} is in the way of a lift by {1e3 * LIFT_HEIGHT:.0f} mm" if blocked_by else ""
    return {"direction": direction.tolist(), "distance": height, **({"reason": reason} if reason else {})}


def body_samples(body: Body, rng: np.random.Generator) -> FloatArray:
    """Return samples (m, 3) of the body's surface, including the vertices of a mesh."""
    if isinstance(body, Mesh):
        vertices = np.asarray(body.mesh.vertices, dtype=float)
        return np.concatenate([vertices, body.surface_samples(SAMPLES, rng)[0]])
    count = max(SAMPLES // len(body.face_names), 50)
    return np.concatenate([body.sample(name, count, rng) for name in body.face_names])


def _retraction_length(model: CollisionModel, bounds: FloatArray, values: Values, direction: FloatArray) -> float:
    """Return how far the palm retracts, metres, until the hand is clear of the body's bounding box."""
    box_end = np.where(direction > 0.0, bounds[0], bounds[1]) @ direction  # the end of the box on the hand's side
    hand_end = np.max(model.spheres.centres(values) @ direction + model.spheres.radii)
    return float(max(hand_end - box_end, 0.0) + START_DISTANCE)


def _free_height(
    fields: Sequence[DistanceField], points: FloatArray, radii: FloatArray, tolerance: float
) -> tuple[float, str]:
    """Return the height to which spheres (m, 3) rise freely, metres, and the obstacle that stops them, if any."""
    initial = [field.distance(points) - radii for field in fields]
    limits = [np.minimum(clearance, 0.0) for clearance in initial]  # no deeper than at the start
    height, clearances, up = 0.0, initial, np.eye(3)[-1]
    while height < LIFT_HEIGHT:
        # no clearance shrinks by more than the rise; at least ``STEP``, or spheres at their limit would never rise
        advance = min(float(np.min(clearance - limit)) for clearance, limit in zip(clearances, limits, strict=True))
        next_height = min(height + max(STEP, advance), LIFT_HEIGHT)
        clearances = [field.distance(points + next_height * up) - radii for field in fields]
        for field, clearance, limit in zip(fields, clearances, limits, strict=True):
            if np.any(clearance < limit - tolerance):
                return height, field.name
        height = next_height
    return LIFT_HEIGHT, ""


def _missing_approach_record(reason: str) -> Json:
    """Return the JSON data of a missing approach."""
    return {"direction": None, "distance": None, "reason": reason}
