"""Collision-free palm path to a grasp (Section 1.2): straight approach with open fingers, then closing."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from nlpgrasp.common.validation import FloatArray, array, integer, number
from nlpgrasp.errors import InputError
from nlpgrasp.hands import URDFHand
from nlpgrasp.hands.base import Values
from nlpgrasp.motion.palm.records import APPROACHING, CLOSING, PalmPath
from nlpgrasp.motion.phases.approach import Approach, BlockedDirection, free_approach, ways_of_palm
from nlpgrasp.motion.phases.opened import Opened, opened, openings
from nlpgrasp.motion.space import Surroundings
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.solution.obstructions import warn_of_touching
from nlpgrasp.solution.solution import GraspSolution

DIRECTIONS = 100
LIMIT_ROUNDING = 1e-6  # radians or metres: tolerance of joint limits


def palm_path(
    solution: GraspSolution,
    problem: GraspProblem,
    direction: ArrayLike | None = None,
    distance: float = 0.1,
    *,
    directions: int = DIRECTIONS,
) -> PalmPath:
    """Return a straight, collision-free palm path to a grasp.

    The palm moves straight with the fingers open; then they close. Each finger is as in the solution's pregrasp, or as
    near to it as clearances allow. Without a direction, the palm's facing direction is tried first, then others by
    increasing angle, until one is free; if none is, the fingers open wider, up to four times as far. Links (as
    enclosing spheres) stay clear of the body, of tables and obstacles in the constraints, and of each other; joints
    keep their limits. Waypoints are so close that nothing can be between them, however thin (docs/hands.md).

    Parameters
    ----------
    solution : GraspSolution
        A solution with a grasp and a hand with a pregrasp.
    problem : GraspProblem
        The solution's problem, with body and hand.
    direction : (3,) array, optional
        Direction of the palm's motion, body frame; of any length.
    distance : float
        Length of the straight approach, metres.
    directions : int
        Number of directions, spread over the sphere, to try if none is given; the axes of palm and body are tried too,
        and, if none is free, others ever closer to the one that is free longest.

    Raises
    ------
    InputError
        Where the solution is not the problem's, has no grasp or no pregrasp, or the hand has no links.

    Warns
    -----
    UserWarning
        On a link inside something in the grasp itself, and on contacts that are off their fingertips' links.
    """
    hand = _hand(solution, problem)
    distance = number("distance", distance, above=0.0)
    directions = integer("directions", directions, at_least=1, at_most=10_000)
    grasp, pregrasp = hand.values_of(solution.hand or {}), hand.values_of((solution.hand or {})["pregrasp"])
    around, touching = Surroundings(problem, hand), warn_of_touching(solution.name, solution.hand)
    reason = _beyond_limits(hand, grasp, pregrasp)
    if reason:
        return _none(around, distance, reason, (), touching)
    ways = [_given(direction)] if direction is not None else ways_of_palm(hand, grasp, directions)
    found = free_approach(around, lambda times: opened(around, grasp, pregrasp, times), ways, lambda *_: distance)
    if found.fingers is None or found.direction is None:
        return _none(around, distance, found.reason, found.blocked, touching)
    return _found(around, found.fingers, found.direction, found, touching)


def _hand(solution: GraspSolution, problem: GraspProblem) -> URDFHand:
    """Return the hand; refuse a solution that is not the problem's or has no pregrasp."""
    if not isinstance(solution, GraspSolution):
        raise InputError("solution", solution, "a GraspSolution")
    if not isinstance(problem, GraspProblem):
        raise InputError("problem", problem, "the GraspProblem of the solution")
    if not isinstance(problem.hand, URDFHand):
        raise InputError("problem.hand", problem.hand, "a URDFHand: other hands have no palm that moves")
    solution.require_grasp()
    if problem.to_dict() != dict(solution.problem):
        raise InputError("problem", "another problem", "the problem of the solution")
    if not solution.hand or "pregrasp" not in solution.hand:
        raise InputError("solution.hand", "no pregrasp", "a solution whose hand has a pregrasp")
    return problem.hand


def _given(direction: ArrayLike) -> FloatArray:
    """Return the given direction as a unit vector."""
    vector = array("direction", direction, (3,))
    size = float(np.linalg.norm(vector))
    if size == 0.0:
        raise InputError("direction", vector.tolist(), "a direction that is not zero")
    return vector / size


def _beyond_limits(hand: URDFHand, *postures: Values) -> str:
    """Return the joint that exceeds its limits in any of the postures; those between are within if these are."""
    lower, upper = hand.tree.joint_limits
    for values in postures:
        over = np.maximum(lower - values["joints"], values["joints"] - upper)
        if np.max(over) > LIMIT_ROUNDING:
            return f"joint {hand.robot.free_joints[int(np.argmax(over))].name} is beyond its limits"
    return ""


def _found(around: Surroundings, fingers: Opened, direction: FloatArray, found: Approach, touching: str) -> PalmPath:
    """Return the record of a path, from its start to the grasp."""
    tree, others = around.hand.tree, ~around.of_tips()
    outside, inside = list(reversed(found.outside)), list(reversed(fingers.places))[1:]
    values = [place.values for place in (*outside, *inside)]
    positions = [tree.joint_positions(v["joints"]) for v in values]
    clear = [float(np.min(p.clearances, initial=np.inf)) for p in outside]
    clear += [float(np.min(p.clearances[others], initial=np.inf)) for p in inside]
    return PalmPath(
        reason="",
        direction=direction,
        distance=found.distance,
        openings=openings(around, fingers.values, fingers.places[0].values),
        phases=(APPROACHING,) * len(outside) + (CLOSING,) * len(inside),
        poses=np.array([tree.palm_frame(v) for v in values]),
        joint_names=tuple(positions[0]),
        joints=np.array([list(p.values()) for p in positions]),
        clearances=np.array(clear),
        blocked=found.blocked,
        tolerance=around.tolerance,
        touching=touching,
    )


def _none(
    around: Surroundings, distance: float, reason: str, blocked: tuple[BlockedDirection, ...], touching: str
) -> PalmPath:
    """Return the record of a failed search."""
    names = tuple(around.hand.tree.joint_positions(np.zeros(len(around.hand.robot.free_joints))))
    nothing = np.zeros((0, len(names)))
    return PalmPath(
        reason,
        None,
        distance,
        np.zeros(0),
        (),
        np.zeros((0, 4, 4)),
        names,
        nothing,
        np.zeros(0),
        blocked,
        around.tolerance,
        touching,
    )
