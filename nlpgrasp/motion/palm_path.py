"""Collision-free palm path to a grasp (Section 1.2): straight approach with open fingers, then closure."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array, integer, number
from nlpgrasp.errors import InputError
from nlpgrasp.hands import URDFHand
from nlpgrasp.hands.base import Values
from nlpgrasp.motion.approach_path import (
    ApproachPath,
    BlockedDirection,
    OpeningPath,
    approach_candidates,
    find_free_approach,
    open_fingers,
    opening_distances,
)
from nlpgrasp.motion.clearance import HandClearance
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.solution.obstructions import warn_of_touching
from nlpgrasp.solution.solution import GraspSolution

APPROACHING, CLOSING = "approaching", "closing"  # phases
DIRECTIONS = 100  # of the approach, spread over the sphere, where none is given
LIMIT_ROUNDING = 1e-6  # radians or metres: tolerance of joint limits


@dataclass(frozen=True)
class PalmPath:
    """Palm path to a grasp: waypoints of the hand, or the reason why there is none.

    Parameters
    ----------
    reason : str
        Why there is no path; empty where there is one.
    direction : (3,) array or None
        Unit direction of the palm's motion, body frame; None where no direction is free.
    distance : float
        Length of the straight approach, metres.
    openings : (k,) array
        Distance of each fingertip on the approach from its position in the grasp, palm frame, metres; empty without a
        path.
    phases : tuple of m str
        ``"approaching"`` or ``"closing"``.
    poses : (m, 4, 4) array
        The palm's frame in the body's at each waypoint, from afar to the grasp.
    joint_names : tuple of n str
        All moving joints, mimic joints included.
    joints : (m, n) array
        Their positions, radians or metres. Between waypoints palm and joints move on straight lines.
    clearances : (m,) array
        Least distance of the hand to anything it must not touch, at each waypoint, metres; while the fingers close,
        fingertips and body are not counted.
    blocked : tuple of BlockedDirection
        The blocked directions that were tried.
    tolerance : float
        Allowed penetration of links between waypoints, metres.
    touching : str
        Links that penetrate something in the grasp or on the solution's own way in, and contacts off their links, as
        text; empty without any.
    """

    reason: str
    direction: FloatArray | None
    distance: float
    openings: FloatArray
    phases: tuple[str, ...]
    poses: FloatArray
    joint_names: tuple[str, ...]
    joints: FloatArray
    clearances: FloatArray
    blocked: tuple[BlockedDirection, ...]
    tolerance: float
    touching: str = ""

    @property
    def success(self) -> bool:
        """Whether there is a path."""
        return not self.reason

    @property
    def clearance(self) -> float:
        """Least clearance over all waypoints, metres; inf without waypoints."""
        return float(np.min(self.clearances, initial=np.inf))

    def to_dict(self) -> Json:
        """Return the path as JSON data; an infinite clearance is None."""
        return {
            "reason": self.reason,
            "direction": None if self.direction is None else self.direction.tolist(),
            "distance": self.distance,
            "openings": self.openings.tolist(),
            "phases": list(self.phases),
            "poses": self.poses.tolist(),
            "joint_names": list(self.joint_names),
            "joints": self.joints.tolist(),
            "clearances": [float(c) if np.isfinite(c) else None for c in self.clearances],
            "blocked": [b.to_dict() for b in self.blocked],
            "tolerance": self.tolerance,
            "touching": self.touching,
        }

    def __str__(self) -> str:
        prefix = f"{self.touching}\n" if self.touching else ""
        if not self.success or self.direction is None:
            return f"{prefix}no way of the palm: {self.reason}"
        direction = np.array2string(self.direction, precision=3, suppress_small=True)
        summary = f"{prefix}{1e3 * self.distance:.0f} mm along {direction}, then closing"
        return f"{summary}: {len(self.phases)} waypoints, least clearance at them {1e3 * self.clearance:.1f} mm"


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
    increasing angle, until one is free; if none is, the fingers open wider, up to four times as far. Links (by
    their collision shapes) stay clear of tables and obstacles in the constraints, of the body and of each other, or are
    no deeper in these than in the grasp; joints keep their limits. Waypoints are so close that nothing can be between
    them, however thin (docs/hands.md).

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
    hand = _check_hand(solution, problem)
    distance = number("distance", distance, above=0.0)
    directions = integer("directions", directions, at_least=1, at_most=10_000)
    grasp, pregrasp = hand.values_of(solution.hand or {}), hand.values_of((solution.hand or {})["pregrasp"])
    model, touching = HandClearance(problem, hand), warn_of_touching(solution.name, solution.hand)
    reason = _exceeded_joint(hand, grasp, pregrasp)
    if reason:
        return _failure_record(model, distance, reason, (), touching)
    if direction is None:
        candidates = approach_candidates(hand, grasp, directions)
    else:
        candidates = [_check_approach_direction(direction)]
    approach = find_free_approach(
        model, lambda times: open_fingers(model, grasp, pregrasp, times), candidates, lambda *_: distance
    )
    if approach.fingers is None or approach.direction is None:
        return _failure_record(model, distance, approach.reason, approach.blocked, touching)
    return _path_record(model, approach.fingers, approach.direction, approach, touching)


def _check_hand(solution: GraspSolution, problem: GraspProblem) -> URDFHand:
    """Return the hand; raise for a solution of another problem, or without a pregrasp."""
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


def _check_approach_direction(direction: ArrayLike) -> FloatArray:
    """Return the given approach direction as a unit vector."""
    vector = array("direction", direction, (3,))
    length = float(np.linalg.norm(vector))
    if length == 0.0:
        raise InputError("direction", vector.tolist(), "a direction that is not zero")
    return vector / length


def _exceeded_joint(hand: URDFHand, *postures: Values) -> str:
    """Return the joint that exceeds its limits in some posture, as text; empty if none does."""
    lower, upper = hand.tree.joint_limits
    for values in postures:
        excess = np.maximum(lower - values["joints"], values["joints"] - upper)
        if np.max(excess) > LIMIT_ROUNDING:
            return f"joint {hand.robot.free_joints[int(np.argmax(excess))].name} is beyond its limits"
    return ""


def _path_record(
    model: HandClearance, fingers: OpeningPath, direction: FloatArray, approach: ApproachPath, touching: str
) -> PalmPath:
    """Return the palm path that an approach search found, from start to grasp."""
    tree, is_no_tip = model.hand.tree, ~model.tip_mask()
    approaching, closing = list(reversed(approach.outside)), list(reversed(fingers.postures))[1:]
    values = [posture.values for posture in (*approaching, *closing)]
    positions = [tree.joint_positions(v["joints"]) for v in values]
    clearances = [float(np.min(p.clearances, initial=np.inf)) for p in approaching]
    clearances += [float(np.min(p.clearances[is_no_tip], initial=np.inf)) for p in closing]
    return PalmPath(
        reason="",
        direction=direction,
        distance=approach.distance,
        openings=opening_distances(model, fingers.values, fingers.postures[0].values),
        phases=(APPROACHING,) * len(approaching) + (CLOSING,) * len(closing),
        poses=np.array([tree.palm_frame(v) for v in values]),
        joint_names=tuple(positions[0]),
        joints=np.array([list(p.values()) for p in positions]),
        clearances=np.array(clearances),
        blocked=approach.blocked,
        tolerance=model.tolerance,
        touching=touching,
    )


def _failure_record(
    model: HandClearance, distance: float, reason: str, blocked: tuple[BlockedDirection, ...], touching: str
) -> PalmPath:
    """Return the palm path of a failed search, with the reason."""
    names = tuple(model.hand.tree.joint_positions(np.zeros(len(model.hand.robot.free_joints))))
    no_joints = np.zeros((0, len(names)))
    return PalmPath(
        reason,
        None,
        distance,
        np.zeros(0),
        (),
        np.zeros((0, 4, 4)),
        names,
        no_joints,
        np.zeros(0),
        blocked,
        model.tolerance,
        touching,
    )
