"""Fine manipulation (Section 3.5.1): pick-up under constraints, then finger moves to a better grasp."""

from __future__ import annotations

import numpy as np
from scipy.optimize import linear_sum_assignment

from nlpgrasp.common.validation import number
from nlpgrasp.errors import InputError
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.hands import URDFHand
from nlpgrasp.motion.fingers.contact_motions import ContactMotions
from nlpgrasp.motion.fingers.linked_motions import LinkedMotions
from nlpgrasp.motion.paths.footpath import Station
from nlpgrasp.motion.paths.surface_paths import SurfaceGraph
from nlpgrasp.optimize.options import SolveOptions
from nlpgrasp.pipeline.solve import solve
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.studies.fine_motion.holding import Holding
from nlpgrasp.studies.fine_motion.order import ordered_moves
from nlpgrasp.studies.fine_motion.records import FineManipulation, FingerMove
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
    valid along the whole path. Otherwise, or where the hand cannot lift it, the finger slides. A slide is certified at
    stations along the path; between them only the quality of the other fingers alone is certified. Fingers with equal
    contact models may swap contacts, unless the hand has a pose.

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
    hold = _checked(pick, goal, hold)
    lift = number("lift", lift, above=0.0)
    first, second = (solve(problem, starts, seed, options) for problem in (pick, goal))
    if first.grasp is None or second.grasp is None:
        return FineManipulation(first, second)
    graph = SurfaceGraph(pick.body)
    order = _matched(pick, graph, first.grasp, second.grasp)
    paths = [
        graph.stations(
            Station(first.grasp.points[i], first.grasp.normals[i], first.faces[i]),
            Station(second.grasp.points[j], second.grasp.normals[j], second.faces[j]),
        )
        for i, j in enumerate(order)
    ]
    holding = Holding(pick, first.grasp, second.grasp, order, paths, hold)
    return FineManipulation(first, second, order, _moves(goal, first, holding, lift))


def _checked(pick: GraspProblem, goal: GraspProblem, hold: TaskEllipsoid | None) -> TaskEllipsoid:
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


def _moves(problem: GraspProblem, first: GraspSolution, holding: Holding, lift: float) -> tuple[FingerMove, ...]:
    """Return the moves in the best order that the hand allows, if its limits are known."""
    here, hand, paths = first.require_grasp(), problem.hand, holding.paths
    if isinstance(hand, URDFHand):
        values = hand.values_of(first.hand or {})
        return ordered_moves(holding, LinkedMotions(problem, hand, values, paths, lift))
    if hand is not None and hand.follows_contacts:
        return ordered_moves(holding, ContactMotions(problem, hand, (here.points, here.normals), paths, lift))
    return ordered_moves(holding)


def _matched(problem: GraspProblem, graph: SurfaceGraph, here: Grasp, there: Grasp) -> tuple[int, ...]:
    """Return the new contact of each finger, in the matching of least total path length."""
    k = len(here)
    fixed = problem.hand is not None and not problem.hand.follows_contacts
    cost = np.full((k, k), np.inf)
    for i in range(k):
        lengths = graph.distances(here.points[i], there.points)
        for j in range(k):
            if i == j or (not fixed and problem.models[i] == problem.models[j]):
                cost[i, j] = lengths[j]
    largest = np.max(cost[np.isfinite(cost)])
    return tuple(int(j) for j in linear_sum_assignment(np.where(np.isfinite(cost), cost, 1e3 * largest + 1.0))[1])
