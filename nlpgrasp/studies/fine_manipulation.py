"""Fine manipulation (Section 3.5.1): pick up under constraints, then move to the grasp that these excluded."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.optimize import linear_sum_assignment

from nlpgrasp.budgets import L2Budget
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts import ContactModel, PointContact
from nlpgrasp.errors import InputError
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.quality import Bounds, mu
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.solve.ascent.weakest import QUICK, weakest_directions
from nlpgrasp.solve.options import SolveOptions
from nlpgrasp.solve.solve import solve
from nlpgrasp.studies.surface_paths import SurfaceGraph
from nlpgrasp.tasks import TaskEllipsoid

WAYPOINTS = 6  # of a path, at which a sliding finger is looked at
HELD_RTOL = 0.05
UNEVEN = 0.1  # of the weight: forces in any direction while a finger moves


@dataclass(frozen=True)
class FingerMove:
    """One finger goes to its new place while the others hold the body.

    Parameters
    ----------
    finger : int
    path : (m, space) array
        Points of the body's surface from the old contact to the new one, metres, body frame.
    slides : bool
        Whether the finger keeps pressing on its way (without friction, as a sliding finger does), or is lifted.
    held : Bounds
        Certified quality against the holding task meanwhile, the least along the path: of the other fingers, and
        of the sliding one.
    """

    finger: int
    path: FloatArray
    slides: bool
    held: Bounds

    @property
    def length(self) -> float:
        """Length of the path, metres."""
        return float(np.sum(np.linalg.norm(np.diff(self.path, axis=0), axis=1)))


@dataclass(frozen=True)
class FineManipulation:
    """A grasp to pick up with, a better one, and how the fingers get from one to the other.

    Parameters
    ----------
    pick, goal : GraspSolution
        The goal's contacts are in the order of the fingers that take them.
    order : tuple of int
        Contact of ``goal.grasp`` that each finger takes.
    moves : tuple of FingerMove
        One after another; empty where either grasp is missing.
    """

    pick: GraspSolution
    goal: GraspSolution
    order: tuple[int, ...] = ()
    moves: tuple[FingerMove, ...] = ()

    @property
    def success(self) -> bool:
        """Whether both grasps exist and every move is held by a force-closed grasp."""
        return bool(self.moves) and all(m.held.lower > 0.0 for m in self.moves)

    def __str__(self) -> str:
        lines = [f"pick up: {self.pick.mu}", f"in the hand: {self.goal.mu}"]
        for move in self.moves:
            way = "slides" if move.slides else "is lifted and goes"
            lines.append(f"finger {move.finger} {way} {1e3 * move.length:.0f} mm; meanwhile held with {move.held}")
        return "\n".join(lines)


def fine_manipulation(
    pick: GraspProblem,
    goal: GraspProblem,
    hold: TaskEllipsoid | None = None,
    starts: int = 8,
    seed: int = 0,
    options: SolveOptions | None = None,
) -> FineManipulation:
    """Solve a pick-up problem and the problem in the hand, and plan the fingers' moves between their grasps.

    Fingers move one after another along shortest paths over the body, in the order that keeps the weakest of the
    intermediate grasps as strong as possible. Fingers with equal contact models may take each other's places,
    unless a hand with a pose says which finger is which.

    Parameters
    ----------
    pick : GraspProblem
        With the constraints of the place where the body is, for example a table.
    goal : GraspProblem
        The same body and contacts, without them.
    hold : TaskEllipsoid, optional
        What the other fingers exert on the body while one moves, body frame, N and N m. When left out they carry a
        unit weight: 1 N up along the body frame's last axis, with a tenth of it in any direction.
    starts, seed, options
        As in ``solve``.

    Raises
    ------
    InputError
        When the two problems are about different bodies or contacts.
    """
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
        carried = np.where(np.arange(d) == space - 1, 1.0, 0.0)  # up: what the fingers exert against a weight
        hold = TaskEllipsoid(np.where(np.arange(d) < space, UNEVEN, 0.0), center=carried)
    if not isinstance(hold, TaskEllipsoid) or hold.dimension != d:
        raise InputError("hold", hold, f"a TaskEllipsoid of dimension {d}")
    first, second = (solve(problem, starts, seed, options) for problem in (pick, goal))
    if first.grasp is None or second.grasp is None:
        return FineManipulation(first, second)
    graph = SurfaceGraph(pick.body)
    order = _matched(pick, graph, first.grasp, second.grasp)
    return FineManipulation(first, second, order, _moves(pick, graph, first.grasp, second.grasp, order, hold))


def _matched(problem: GraspProblem, graph: SurfaceGraph, here: Grasp, there: Grasp) -> tuple[int, ...]:
    """Return which new contact each finger takes, the paths together as short as possible."""
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


def _moves(
    problem: GraspProblem,
    graph: SurfaceGraph,
    here: Grasp,
    there: Grasp,
    order: Sequence[int],
    hold: TaskEllipsoid,
) -> tuple[FingerMove, ...]:
    """Return the moves in the order whose weakest intermediate grasp is strongest (over all orders)."""
    k = len(here)
    holding = _Holding(problem, graph, here, there, order, hold)
    best: dict[frozenset[int], tuple[float, tuple[int, ...]]] = {frozenset(): (np.inf, ())}
    for count in range(k):
        for moved in map(frozenset, combinations(range(k), count)):
            reached, sequence = best[moved]
            for finger in sorted(set(range(k)) - moved):
                value = min(reached, max(holding.strengths(moved, finger)))
                after = moved | {finger}
                if after not in best or value > best[after][0]:
                    best[after] = (value, (*sequence, finger))
    result = []
    moved = frozenset[int]()
    for finger in best[frozenset(range(k))][1]:
        result.append(holding.move(moved, finger))
        moved = moved | {finger}
    return tuple(result)


class _Holding:
    """How well a body is held while one finger moves and some have moved already."""

    def __init__(
        self,
        problem: GraspProblem,
        graph: SurfaceGraph,
        here: Grasp,
        there: Grasp,
        order: Sequence[int],
        hold: TaskEllipsoid,
    ) -> None:
        self.problem, self.hold = problem, hold
        self.here, self.there, self.order = here, there, order
        self.budget = L2Budget() if problem.budget.depends_on_frames else problem.budget
        self.paths = [graph.path(here.points[i], there.points[order[i]]) for i in range(len(here))]
        self._known: dict[tuple[frozenset[int], int], tuple[float, float]] = {}

    def strengths(self, moved: frozenset[int], finger: int) -> tuple[float, float]:
        """Return estimates of the quality with the finger lifted, and with it sliding without friction."""
        key = (moved, finger)
        if key not in self._known:
            rng = np.random.default_rng(0)
            values = [
                [
                    weakest_directions(grasp, self.hold, self.budget, rng, descents=QUICK).value
                    for grasp in self._grasps(moved, finger, slides)
                ]
                for slides in (False, True)
            ]
            self._known[key] = (min(values[0]), min(values[1]))
        return self._known[key]

    def move(self, moved: frozenset[int], finger: int) -> FingerMove:
        """Return the better way to move a finger, certified."""
        lifted, sliding = self.strengths(moved, finger)
        slides = sliding > lifted
        bounds = [
            mu(grasp, self.hold, HELD_RTOL, force_budget=self.budget) for grasp in self._grasps(moved, finger, slides)
        ]
        held = Bounds(min(b.lower for b in bounds), min(b.upper for b in bounds))
        return FingerMove(finger, self.paths[finger][0], slides, held)

    def _grasps(self, moved: frozenset[int], finger: int, slides: bool) -> list[Grasp]:
        """Return the grasp of the other fingers; sliding, with the finger at points along its path."""
        places = [
            (self.there.points[self.order[i]], self.there.normals[self.order[i]], model)
            if i in moved
            else (self.here.points[i], self.here.normals[i], model)
            for i, model in enumerate(self.problem.models)
            if i != finger
        ]
        if not slides:
            return [self._grasp(places)]
        points, normals = self.paths[finger]
        stops = np.unique(np.linspace(0, len(points) - 1, WAYPOINTS).round().astype(int))
        return [self._grasp([*places, (points[j], normals[j], PointContact())]) for j in stops]

    def _grasp(self, places: Sequence[tuple[FloatArray, FloatArray, ContactModel]]) -> Grasp:
        points, normals, models = zip(*places, strict=True)
        return Grasp(points, normals, models, self.problem.origin)
