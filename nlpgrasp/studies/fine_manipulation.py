"""Fine manipulation (Section 3.5.1): pick-up under constraints, then finger moves to a better grasp."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nlpgrasp.common.validation import number
from nlpgrasp.errors import InputError
from nlpgrasp.hands import URDFHand
from nlpgrasp.motion.contact_path import PathStation, SurfaceGraph
from nlpgrasp.motion.finger_motion import ContactMotions, LinkedMotions
from nlpgrasp.optimize.options import SolveOptions
from nlpgrasp.pipeline.solve import solve
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.studies.finger_moves import FingerMove, HoldingQuality, match_contacts, ordered_moves
from nlpgrasp.tasks import TaskEllipsoid

UNEVEN = 0.1  # share of the weight: disturbance in any direction while a finger moves
LIFT = 5e-3  # metres: default height of a lifted finger


def fine_manipulation(
    pick: GraspProblem,
    goal: GraspProblem,
    hold: TaskEllipsoid | None = None,
    starts: int = 8,
    seed: int = 0,
    options: SolveOptions | None = None,
    *,
    lift: float = LIFT,
) -> FineManipulation:
    """Solve a pick-up problem and an in-hand problem, and plan the finger moves between their grasps.

    Fingers move one after another along shortest paths over the body, in the order that maximises the quality of the
    weakest intermediate grasp. A finger is lifted where the other fingers hold the body alone: their certificate is
    valid along the whole path. Otherwise, or where the hand cannot lift it, the finger slides without friction, and the
    least quality of all fingers is certified between the stations of its path as well. Fingers with equal contact
    models may swap contacts, unless the hand has a pose.

    Parameters
    ----------
    pick : GraspProblem
        Problem with the constraints of the pick-up place, for example a table.
    goal : GraspProblem
        The same body and contacts, without these constraints.
    hold : TaskEllipsoid, optional
        Task of the other fingers while one moves, body frame, N and N m. When left out they carry a unit weight: 1 N
        along the body frame's last axis, with a tenth of it in any direction.
    starts, seed, options
        As in ``solve``.
    lift : float
        Height of a lifted finger above the body, metres.

    Raises
    ------
    InputError
        When the two problems are about different bodies or contacts, or the lift is not above zero.

    Notes
    -----
    With a hand, each move is checked along its path, and orders with impossible moves are excluded (docs/hands.md says
    how, and what is certain). A URDF hand's palm stays fixed after the pick-up; joint limits and collisions of links
    with the body, the surroundings of the goal and each other are checked. Free fingertips and parallel jaws keep their
    own limits. That a move is impossible is a local statement, for postures near the last waypoint.
    """
    hold = _check_problems(pick, goal, hold)
    lift = number("lift", lift, above=0.0)
    pick_solution, goal_solution = (solve(problem, starts, seed, options) for problem in (pick, goal))
    if pick_solution.grasp is None or goal_solution.grasp is None:
        return FineManipulation(pick_solution, goal_solution)
    graph = SurfaceGraph(pick.body)
    order = match_contacts(pick, graph, pick_solution.grasp, goal_solution.grasp)
    paths = [
        graph.stations(
            PathStation(pick_solution.grasp.points[i], pick_solution.grasp.normals[i], pick_solution.faces[i]),
            PathStation(goal_solution.grasp.points[j], goal_solution.grasp.normals[j], goal_solution.faces[j]),
        )
        for i, j in enumerate(order)
    ]
    holding = HoldingQuality(pick, pick_solution.grasp, goal_solution.grasp, order, paths, hold)
    return FineManipulation(pick_solution, goal_solution, order, _plan_moves(goal, pick_solution, holding, lift))


@dataclass(frozen=True)
class FineManipulation:
    """Pick-up grasp, goal grasp, and the finger moves from one to the other.

    Parameters
    ----------
    pick, goal : GraspSolution
        The goal's contacts are in the order of the fingers that take them.
    order : tuple of int
        Contact of ``goal.grasp`` that each finger takes.
    moves : tuple of FingerMove
        Moves in order; empty where either grasp is missing. If the hand's limits allow no order, those with the best
        holding quality, with the reasons.
    """

    pick: GraspSolution
    goal: GraspSolution
    order: tuple[int, ...] = ()
    moves: tuple[FingerMove, ...] = ()

    @property
    def success(self) -> bool:
        """Whether both grasps exist, every move is feasible, and the body is held on the whole path of each."""
        return bool(self.moves) and self.feasible and all(m.certified for m in self.moves)

    @property
    def feasible(self) -> bool:
        """Whether no known limit of the hand prevents any of the moves."""
        return all(m.feasible for m in self.moves)

    @property
    def outcome(self) -> str:
        """The result in a sentence."""
        if not self.moves:
            return "no moves: one of the two grasps was not found"
        if not self.feasible:
            return "the hand cannot make all of these moves"
        if self.success:
            return "the body is held during every move, certified along the whole path"
        dropped = [str(m.finger) for m in self.moves if m.held.upper <= 0.0]
        if dropped:
            return f"the body is not held while {_format_fingers(dropped)}"
        uncertain = [str(m.finger) for m in self.moves if not m.certified]
        return f"it is not certified that the body is held while {_format_fingers(uncertain)}"

    def __str__(self) -> str:
        lines = [f"pick up: {self.pick.mu}", f"in the hand: {self.goal.mu}"]
        for move in self.moves:
            motion = "slides" if move.slides else "is lifted and goes"
            lines.append(f"finger {move.finger} {motion} {1e3 * move.length:.0f} mm; meanwhile {move.held_text}")
            if move.motion is not None:
                lines.append(f"  {move.motion}")
        return "\n".join([*lines, self.outcome])


def _check_problems(pick: GraspProblem, goal: GraspProblem, hold: TaskEllipsoid | None) -> TaskEllipsoid:
    """Refuse problems with different bodies or contacts; return the holding task."""
    for name, problem in (("pick", pick), ("goal", goal)):
        if not isinstance(problem, GraspProblem):
            raise InputError(name, problem, "a GraspProblem")
    if pick.body.to_dict() != goal.body.to_dict():
        raise InputError("goal.body", "another body", "the body of the pick-up problem")
    if pick.models != goal.models or len(pick.models) < 2:
        raise InputError("goal.contacts", "other contacts, or one", "the contacts of the pick-up problem, two at least")
    if (pick.hand and pick.hand.to_dict()) != (goal.hand and goal.hand.to_dict()):
        raise InputError("goal.hand", "another hand", "the hand of the pick-up problem")
    if np.any(pick.origin != goal.origin):
        raise InputError(
            "goal.torque_origin", goal.origin.tolist(), f"{pick.origin.tolist()}, as in the pick-up problem"
        )
    space, d = pick.body.space, pick.dimension
    if hold is None:
        carried = np.where(np.arange(d) == space - 1, 1.0, 0.0)  # upwards, against the weight
        hold = TaskEllipsoid(np.where(np.arange(d) < space, UNEVEN, 0.0), center=carried)
    if not isinstance(hold, TaskEllipsoid) or hold.dimension != d:
        raise InputError("hold", hold, f"a TaskEllipsoid of dimension {d}")
    return hold


def _plan_moves(
    problem: GraspProblem, solution: GraspSolution, holding: HoldingQuality, lift: float
) -> tuple[FingerMove, ...]:
    """Return the moves in the best order that the hand allows, if its limits are known."""
    grasp, hand, paths = solution.require_grasp(), problem.hand, holding.paths
    if isinstance(hand, URDFHand):
        values = hand.values_of(solution.hand or {})
        return ordered_moves(holding, LinkedMotions(problem, hand, values, paths, lift))
    if hand is not None and hand.follows_contacts:
        return ordered_moves(holding, ContactMotions(problem, hand, (grasp.points, grasp.normals), paths, lift))
    return ordered_moves(holding)


def _format_fingers(fingers: Sequence[str]) -> str:
    """Return fingers that move, as text."""
    *others, last = fingers
    return f"fingers {', '.join(others)} and {last} move" if others else f"finger {last} moves"
