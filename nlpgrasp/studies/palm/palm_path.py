"""A collision-free way of the palm to the final grasp (Section 1.2): straight, the fingers open, then closing."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from nlpgrasp.common.validation import FloatArray, array, integer, number
from nlpgrasp.errors import InputError
from nlpgrasp.hands import URDFHand
from nlpgrasp.hands.base import Values
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.solution.obstructions import warn_of_touching
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.solve.phases.approach import Approach, BlockedDirection, free_approach, ways_of_palm
from nlpgrasp.solve.phases.opened import Opened, opened, openings
from nlpgrasp.solve.space import Surroundings
from nlpgrasp.studies.palm.records import APPROACHING, CLOSING, PalmPath

DIRECTIONS = 100
LIMIT_ROUNDING = 1e-6  # radians or metres


def palm_path(
    solution: GraspSolution,
    problem: GraspProblem,
    direction: ArrayLike | None = None,
    distance: float = 0.1,
    *,
    directions: int = DIRECTIONS,
) -> PalmPath:
    """Return a straight way of the palm to a grasp, on which the hand touches nothing but the body it grasps.

    The palm moves straight with the fingers open; then they close. Each finger is as in the solution's pregrasp, or as
    far towards it as it has room. Without a direction the one in which the palm faces comes first, then others around
    it, the nearest first, until one is free; where none is, the fingers open wider, up to four times as far. Links (as
    balls that enclose them) stay off the body, off what the constraints keep links away from, such as tables and
    obstacles, and off each other; joints keep their limits. Waypoints are so near each other that nothing can be
    between them, however thin (docs/hands.md).

    Parameters
    ----------
    solution : GraspSolution
        With a grasp and a hand that has a pregrasp.
    problem : GraspProblem
        Whose solution it is: it has the body and the hand.
    direction : (3,) array, optional
        In which the palm is to move, body frame; of any length.
    distance : float
        How far it moves straight, metres.
    directions : int
        How many directions, spread over the sphere, are looked at where none is given: beside them the axes of palm and
        body, and where none is free others ever closer about the one that is free longest.

    Raises
    ------
    InputError
        Where the solution is not the problem's, has no grasp or no pregrasp, or the hand has no links.

    Warns
    -----
    UserWarning
        Of a link inside something in the grasp itself, and of contacts that are off their fingertips' links.
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
    """Return the direction that was asked for, of unit length."""
    vector = array("direction", direction, (3,))
    size = float(np.linalg.norm(vector))
    if size == 0.0:
        raise InputError("direction", vector.tolist(), "a direction that is not zero")
    return vector / size


def _beyond_limits(hand: URDFHand, *postures: Values) -> str:
    """Return which joint is beyond its limits in any of the postures; those between are within if these are."""
    lower, upper = hand.tree.joint_limits
    for values in postures:
        over = np.maximum(lower - values["joints"], values["joints"] - upper)
        if np.max(over) > LIMIT_ROUNDING:
            return f"joint {hand.robot.free_joints[int(np.argmax(over))].name} is beyond its limits"
    return ""


def _found(around: Surroundings, fingers: Opened, direction: FloatArray, found: Approach, touching: str) -> PalmPath:
    """Return the record of a way, from afar to the grasp."""
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
    """Return the record of no way."""
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
