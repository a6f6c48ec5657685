"""Fine manipulation (Section 3.5.1): pick-up under constraints, then finger moves to the best grasp within reach.

The goal is searched for from the pick-up: with a hand whose palm has a pose, among the grasps of the same palm. Each
goal, and each grasp in which only some of the fingers have moved to it, is a node of a best-first search by mu; a node
is reached where the hand can make the moves of its fingers in some order and the body is held during all of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from heapq import heappop, heappush
from itertools import count

import numpy as np

from nlpgrasp.common.scalar_constraints import ScalarConstraint, SymbolicCandidate
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import number
from nlpgrasp.constraints.base import PlacementConstraint
from nlpgrasp.errors import InputError
from nlpgrasp.hands import URDFHand
from nlpgrasp.hands.base import Values
from nlpgrasp.motion.contact_path import PathStation, SurfaceGraph
from nlpgrasp.motion.finger_motion import ContactMotions, LinkedMotions
from nlpgrasp.optimize.options import SolveOptions
from nlpgrasp.optimize.parallel_starts import StartRunner
from nlpgrasp.optimize.processes import single_thread
from nlpgrasp.optimize.warm_starts import WarmStart
from nlpgrasp.pipeline.multistart import Multistart
from nlpgrasp.pipeline.solve import solve
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.quality import mu
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.solution.kept_grasps import FoundGrasp
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.studies.finger_moves import HELD_RTOL, FingerMove, HoldingQuality, match_contacts, ordered_moves
from nlpgrasp.tasks import TaskEllipsoid

GOALS = 8  # largest number of distinct goals of a hand with a pose
MOST_PLANS = 24  # largest number of nodes whose moves are planned
LEAST_MOTION = 1e-3  # displacement of a contact, over the body's size, up to which its finger does not move
PALM_OFFSET, PALM_TURN = 1e-4, 1e-3  # metres and radians: tolerances of a palm that stays
LEAST_TRACE = 2.9  # least trace of the palm's rotation from its pose: excludes half turns
DISTURBANCE = 0.1  # disturbance in any direction while a finger moves, over the weight
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
    """Solve a pick-up problem, and plan the finger moves to the best reachable grasp of an in-hand problem.

    Fingers move one after another along shortest paths over the body, in the order that maximises the quality of the
    weakest intermediate grasp. A finger is lifted where the other fingers hold the body alone: their certificate is
    valid along the whole path. Otherwise, or where the hand cannot lift it, the finger slides without friction, and the
    least quality of all fingers is certified between the stations of its path as well. Fingers with equal contact
    models may swap contacts, unless the hand has a pose.

    Goals are tried best first: those of the in-hand problem (with a URDF hand, those of the pick-up's palm pose), and
    grasps in which only some of the fingers have moved to one of them. The first that is better than the pick-up's
    grasp and that all moves reach is ``goal``; ``unreached`` says what is in the way of better ones.

    The body counts as held with more than a tenth of the quality that the pick-up's own grasp has for the holding
    task: less takes forces that hands do not have.

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
    picked = solve(pick, starts, seed, options)
    if picked.grasp is None:
        return FineManipulation(picked, solve(goal, starts, seed, options))
    if isinstance(goal.hand, URDFHand):
        goal_with_held_palm = replace(goal, constraints=(*goal.constraints, HeldPalm(goal.hand, picked.hand or {})))
        in_hand = solve(goal_with_held_palm, starts, seed, options, keep=GOALS, warm_starts=[picked])
    else:
        in_hand = solve(goal, starts, seed, options)
    if in_hand.grasp is None:
        return FineManipulation(picked, in_hand)
    return _GoalSearch(pick, goal, picked, in_hand, hold, lift, options or SolveOptions()).run(seed)


@dataclass(frozen=True)
class FineManipulation:
    """Pick-up grasp, goal grasp, and the finger moves from the first to the second.

    Parameters
    ----------
    pick, goal : GraspSolution
        The goal's contacts are in the order of the fingers that take them.
    order : tuple of int
        Contact of ``goal.grasp`` that each finger takes.
    moves : tuple of FingerMove
        Moves in order; empty where either grasp is missing, or no finger has to move. If no better grasp is reached,
        those to the best goal, with the reasons.
    unreached : tuple of str
        Better grasps that are not reached, with the reasons.
    """

    pick: GraspSolution
    goal: GraspSolution
    order: tuple[int, ...] = ()
    moves: tuple[FingerMove, ...] = ()
    unreached: tuple[str, ...] = ()

    @property
    def success(self) -> bool:
        """Whether the fingers get to a better grasp, or the pick-up's is the best known, and hold the body meanwhile.

        Every move is feasible and certified to hold the body on its whole path. Without moves, false where a better
        grasp is known and not reached; after moves, still better grasps may be in ``unreached``.
        """
        stays_worse = bool(self.unreached) and not self.moves
        return self._has_grasps and not stays_worse and self.feasible and all(m.certified for m in self.moves)

    @property
    def _has_grasps(self) -> bool:
        return self.pick.grasp is not None and self.goal.grasp is not None

    @property
    def feasible(self) -> bool:
        """Whether no known limit of the hand prevents any of the moves."""
        return all(m.feasible for m in self.moves)

    @property
    def outcome(self) -> str:
        """Sentence that states the result."""
        if not self._has_grasps:
            return "no moves: one of the two grasps was not found"
        if not self.moves:
            return "no better grasp is reached: the fingers stay" if self.unreached else "no finger has to move"
        if not self.feasible:
            return "the hand cannot make all of these moves"
        if self.success:
            held = "the body is held during every move, certified along the whole path"
            return f"{held}; better grasps are not reached" if self.unreached else held
        dropped = [m.finger for m in self.moves if m.held.upper <= m.required]
        uncertain = dropped or [m.finger for m in self.moves if not m.certified]
        moving = f"{_format_fingers(uncertain)} move{'' if len(uncertain) > 1 else 's'}"
        if dropped:
            return f"the body is not held while {moving}"
        return f"it is not certified that the body is held while {moving}"

    def __str__(self) -> str:
        lines = [f"pick up: {self.pick.mu}", f"in the hand: {self.goal.mu}"]
        for move in self.moves:
            motion = "slides" if move.slides else "is lifted and goes"
            lines.append(f"finger {move.finger} {motion} {1e3 * move.length:.0f} mm; meanwhile {move.held_text}")
            if move.motion is not None:
                lines.append(f"  {move.motion}")
        return "\n".join([*lines, *(f"not reached: {text}" for text in self.unreached), self.outcome])


def _check_problems(pick: GraspProblem, goal: GraspProblem, hold: TaskEllipsoid | None) -> TaskEllipsoid:
    """Raise if the two problems differ in body, contacts, hand or torque origin; return the validated holding task."""
    for name, problem in (("pick", pick), ("goal", goal)):
        if not isinstance(problem, GraspProblem):
            raise InputError(name, problem, "a GraspProblem")
        if problem.objective == "nu":
            raise InputError(f"{name}.objective", "nu", "mu or delta, by which grasps are compared along the way")
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
        hold = TaskEllipsoid(np.where(np.arange(d) < space, DISTURBANCE, 0.0), center=carried)
    if not isinstance(hold, TaskEllipsoid) or hold.dimension != d:
        raise InputError("hold", hold, f"a TaskEllipsoid of dimension {d}")
    return hold


class HeldPalm(PlacementConstraint):
    """Constraint that keeps the palm at the pose of a given posture, within 0.1 mm and a milliradian.

    Parameters
    ----------
    hand : URDFHand
    posture : mapping
        ``hand`` of a solution.
    """

    kind = "held palm"

    def __init__(self, hand: URDFHand, posture: Json) -> None:
        frame = hand.tree.palm_frame(hand.values_of(posture))
        self.position, self.rotation = frame[:3, 3], frame[:3, :3]

    def rows(self, placement: SymbolicCandidate) -> list[ScalarConstraint]:
        """Return scalar constraints on displacement and rotation of the palm.

        The rotation is limited by its antisymmetric part and its trace.
        """
        palm = placement.palm
        if palm is None:
            raise InputError(self.kind, "no palm", "a hand with a palm")
        offset, R = palm.position - self.position, self.rotation.T @ palm.rotation
        antisymmetric = [R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]
        limit, trace = PALM_OFFSET, R[0, 0] + R[1, 1] + R[2, 2]
        return [
            *(ScalarConstraint(self.kind, offset[i], -limit, limit, scale=placement.size, unit="m") for i in range(3)),
            *(ScalarConstraint(self.kind, s, -2.0 * PALM_TURN, 2.0 * PALM_TURN) for s in antisymmetric),
            ScalarConstraint(self.kind, trace, LEAST_TRACE),
        ]

    def to_dict(self) -> Json:
        """Return the constraint's kind and the palm's position as JSON data."""
        return {"type": self.kind, "position": self.position.tolist()}


@dataclass(frozen=True)
class _Goal:
    """Goal grasp with the new contact of each finger and the fingers that have to move.

    ``holding`` evaluates intermediate grasps.
    """

    target: FoundGrasp
    order: tuple[int, ...]
    moving: frozenset[int]
    holding: HoldingQuality

    def grasp(self, moved: frozenset[int]) -> Grasp:
        """Return the grasp in which some fingers have moved to the goal and the others have not."""
        pick, goal = self.holding.pick, self.holding.goal
        points, normals = pick.points.copy(), pick.normals.copy()
        for i in moved:
            points[i], normals[i] = goal.points[self.order[i]], goal.normals[self.order[i]]
        return Grasp(points, normals, pick.contacts, pick.torque_origin)


@dataclass(frozen=True)
class _Node:
    """Search node: a goal, the fingers that have moved to it, and the quality of the resulting grasp."""

    goal: _Goal
    moved: frozenset[int]
    quality: float


class _GoalSearch:
    """Best-first search for a goal grasp that the hand reaches when all or some fingers move.

    Parameters
    ----------
    pick, goal : GraspProblem
    picked, in_hand : GraspSolution
        The pick-up's grasp, and grasps of the goal's problem.
    hold : TaskEllipsoid
    lift : float
        Metres.
    options : SolveOptions
        For the certificate of the grasp that is reached.
    """

    def __init__(
        self,
        pick: GraspProblem,
        goal: GraspProblem,
        picked: GraspSolution,
        in_hand: GraspSolution,
        hold: TaskEllipsoid,
        lift: float,
        options: SolveOptions,
    ) -> None:
        self.pick, self.goal, self.picked, self.in_hand = pick, goal, picked, in_hand
        self.hold, self.lift, self.options = hold, lift, options
        self.graph, self.grasp = SurfaceGraph(pick.body), picked.require_grasp()
        self._queue, self._counter = list[tuple[float, int, _Node]](), count()  # counts order nodes of equal quality
        self._seen = set[tuple[int, frozenset[int]]]()

    def run(self, seed: int) -> FineManipulation:
        """Return the moves to the best reachable grasp, or else the obstructed moves to the best goal."""
        for target in self.in_hand.grasps:
            goal = self._make_goal(target)
            self._push(_Node(goal, goal.moving, target.mu.lower))
        unreached, plans, least_quality = list[str](), list[FineManipulation](), 0.0
        while self._queue and len(plans) < MOST_PLANS and (not plans or -self._queue[0][0] > least_quality):
            node = heappop(self._queue)[2]
            plan = self._plan_moves(node)
            if plan.success and (reached := self._with_reached_grasp(plan, node, seed)) is not None:
                return replace(reached, unreached=tuple(unreached))
            if not plans and self._certify(self.picked.grasps[0], seed) is not None:
                least_quality = max(self._quality(self.grasp, node.goal), 0.0)  # of the fingers that stay
            plans.append(plan)
            if node.moved:
                fingers = _format_fingers(sorted(node.moved))
                unreached.append(f"mu {node.quality:.4g} by {fingers}: {_describe_obstruction(plan)}")
            self._push_children(node, plan)
        answer = self._certify(self.in_hand.grasps[0], seed) if isinstance(self.goal.hand, URDFHand) else None
        return replace(plans[0], goal=self.in_hand if answer is None else answer, unreached=tuple(unreached))

    def _push(self, node: _Node) -> None:
        heappush(self._queue, (-node.quality, next(self._counter), node))

    def _push_children(self, node: _Node, plan: FineManipulation) -> None:
        """Push the nodes in which one finger fewer moves.

        This is the finger that the hand cannot move, or else each in turn.
        """
        blocked = next((move.finger for move in plan.moves if not move.feasible), None)
        for finger in node.moved if blocked is None else [blocked]:
            fewer = node.moved - {finger}
            if fewer and (id(node.goal), fewer) not in self._seen:
                self._seen.add((id(node.goal), fewer))
                self._push(_Node(node.goal, fewer, self._quality(node.goal.grasp(fewer), node.goal)))

    @cached_property
    def _runner(self) -> StartRunner:
        return StartRunner(self.goal, self.options.narrow(), 1)

    def _make_goal(self, target: FoundGrasp) -> _Goal:
        """Return the goal of a grasp, with the new contact and the path of each finger."""
        order = match_contacts(self.pick, self.graph, self.grasp, target.grasp)
        initial, final = _contact_stations(self.grasp, self.picked.faces), _contact_stations(target.grasp, target.faces)
        paths = [self.graph.stations(initial[i], final[j]) for i, j in enumerate(order)]
        distances = np.linalg.norm(target.grasp.points[list(order)] - self.grasp.points, axis=1)
        moving = frozenset(np.flatnonzero(distances > LEAST_MOTION * self.pick.body.size).tolist())
        return _Goal(
            target, order, moving, HoldingQuality(self.pick, self.grasp, target.grasp, order, paths, self.hold)
        )

    def _quality(self, grasp: Grasp, goal: _Goal) -> float:
        """Return the certified lower bound on a grasp's quality for the goal's task."""
        return mu(grasp, self.goal.task, HELD_RTOL, force_budget=goal.holding.budget).lower

    def _plan_moves(self, node: _Node) -> FineManipulation:
        """Return the plan of moves that lead to a node, in the best order that the hand allows."""
        hand, holding, paths = self.goal.hand, node.goal.holding, node.goal.holding.paths
        if isinstance(hand, URDFHand):
            values, model = hand.values_of(self.picked.hand or {}), self._runner.compiled.collision_model
            linked = LinkedMotions(self.goal, hand, values, paths, self.lift, model)
            moves = ordered_moves(holding, linked, node.moved)
        elif hand is not None and hand.follows_contacts:
            contacts = self.grasp.points, self.grasp.normals
            moves = ordered_moves(holding, ContactMotions(self.goal, hand, contacts, paths, self.lift), node.moved)
        else:
            moves = ordered_moves(holding, None, node.moved)
        return FineManipulation(self.picked, self.in_hand, node.goal.order, moves)

    def _with_reached_grasp(self, plan: FineManipulation, node: _Node, seed: int) -> FineManipulation | None:
        """Return a plan with the certified final grasp of its moves, or ``None`` if this grasp is infeasible."""
        goal, moved, hand, posture = node.goal, node.moved, self.goal.hand, None
        if isinstance(hand, URDFHand):
            posture = _posture_after(hand, hand.values_of(self.picked.hand or {}), plan.moves)
        elif goal.target is self.in_hand.grasps[0] and moved == goal.moving:
            return plan
        faces = [goal.target.faces[j] if i in moved else self.picked.faces[i] for i, j in enumerate(goal.order)]
        reached = self._certify(FoundGrasp(goal.grasp(moved), tuple(faces), goal.target.mu, hand=posture), seed)
        return None if reached is None else replace(plan, goal=reached, order=tuple(range(len(faces))))

    def _certify(self, grasp: FoundGrasp, seed: int) -> GraspSolution | None:
        """Certify an unchanged grasp for the goal's problem; return ``None`` if the grasp is infeasible."""
        with single_thread():
            search = Multistart(self._runner, seed)
            search.add_warm_start(WarmStart.of(search.runner.compiled, grasp, grasp.grasp.normals), improve=False)
            if search.best is None:
                return None
            search.accept_unchanged(search.best)
            return search.answer()


def _contact_stations(grasp: Grasp, faces: Sequence[str]) -> list[PathStation]:
    """Return the contacts of a grasp as end points of paths."""
    return [PathStation(p, n, face) for p, n, face in zip(grasp.points, grasp.normals, faces, strict=True)]


def _posture_after(hand: URDFHand, values: Values, moves: Sequence[FingerMove]) -> Json:
    """Return the hand's posture after moves, as JSON data.

    ``values`` of the hand's variables are updated in place.
    """
    names = [joint.name for joint in hand.robot.free_joints]
    for motion in (move.motion for move in moves):
        if motion is not None and motion.joints is not None:
            values["joints"][[names.index(name) for name in motion.joint_names]] = motion.joints[-1]
    return hand.describe(values)


def _describe_obstruction(plan: FineManipulation) -> str:
    """Return a text that says what obstructs a plan."""
    for move in plan.moves:
        if move.motion is not None and not move.feasible:
            return f"finger {move.finger}, {move.motion.reason}"
    return "the grasp is not feasible for the hand" if plan.success else plan.outcome


def _format_fingers(fingers: Sequence[int]) -> str:
    """Return indices of fingers as text."""
    *leading, final = map(str, fingers)
    return f"fingers {', '.join(leading)} and {final}" if leading else f"finger {final}"
