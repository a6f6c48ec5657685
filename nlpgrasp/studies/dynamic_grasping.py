"""Dynamic grasping (Section 3.6): grasps for a task and constraints that change with a parameter.

The contacts for one task are a few refinement steps away from a local optimum for a slightly different task: the
program is the same except for its cuts. So the grasp of each step is a warm start of the next, certified unchanged and
refined. A short branch and bound, and starts of its own, show whether another local optimum is so much better that a
regrasp pays; for smaller gains the fingers stay where they are. Steps that are proved to be near the best need no
start, and leave theirs to those whose gap to the bound stays large.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import linear_sum_assignment

from nlpgrasp.common.formatting import error_line, format_headroom
from nlpgrasp.common.validation import FloatArray, array, number
from nlpgrasp.constraints.base import PlacementConstraint
from nlpgrasp.constraints.registry import constraint_from_dict
from nlpgrasp.errors import InputError
from nlpgrasp.motion.contact_path import PathStation, SurfaceGraph
from nlpgrasp.optimize.compiled_problem import CompiledProblem
from nlpgrasp.optimize.grasp_on_body import GraspOnBody
from nlpgrasp.optimize.options import SolveOptions, check_solve_arguments
from nlpgrasp.optimize.parallel_starts import StartRunner
from nlpgrasp.optimize.processes import single_thread
from nlpgrasp.optimize.start_result import StartGrasp
from nlpgrasp.optimize.warm_starts import WarmStart
from nlpgrasp.pipeline.multistart import Multistart
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.quality import Bounds, mu
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.solution.obstructions import link_obstructions
from nlpgrasp.solution.records import CandidateOrigin
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.studies.finger_moves import FingerMove, HoldingQuality, match_contacts, ordered_moves
from nlpgrasp.tasks import Task

RTOL = 0.005  # largest relative gap of certificates, as moves depend on some percent
ROUNDS = 8  # most rounds of a refinement, which begins near a local optimum
RECENT_GRASPS = 16  # latest grasps near whose contacts candidates are proposed
STARTS_SHARE = 0.125  # starts granted for a step over those of a cold solve
GROWTH = 1.02  # growth of bound over quality since the last start from which a step is solved anew at once
FALL = 1.1  # the same from which it is solved with all starts
LEAST_SAVED = 2  # starts that are saved before a step is solved anew without such growth
PATIENCE = 3  # successive starts without a gain after which a step ends
OWN_TASK = "task"  # the step's own task holds while fingers move to its grasp
REGRASP_GAIN = 0.01  # default least relative gain for which the fingers move


@dataclass(frozen=True)
class DynamicStep:
    """Grasp of a followed task for one value of its parameter.

    Parameters
    ----------
    parameter : float
        The value, in the caller's own unit.
    solution : GraspSolution
        Certified; can be saved and verified on its own.
    moved : (k,) array
        Displacement of each contact from the previous value, metres.
    regrasp : bool
        Whether this is another local optimum, not reached by sliding.
    stayed : float
        Upper bound on mu of the previous value's contacts for this task; 0 where they violate its constraints.
    cold : bool
        Whether no followed grasp held, so that this one comes from a cold solve.
    starts : int
        Number of starts run, beside the warm start.
    moves : tuple of FingerMove
        Moves from the previous grasp to this one, one finger at a time, in the order that holds the body best; empty
        where no finger moves, or none is planned.
    held : Bounds or None
        Least quality on the whole path of all moves, the lower end certified everywhere; without moves that of the
        grasp that stays. None where it was not requested, without a previous grasp, and where the force budget depends
        on the contacts' frames or the hand's posture.
    """

    parameter: float
    solution: GraspSolution
    moved: FloatArray
    regrasp: bool
    stayed: float
    cold: bool = False
    starts: int = 0
    moves: tuple[FingerMove, ...] = ()
    held: Bounds | None = None

    @property
    def held_text(self) -> str:
        """Text on the quality while fingers move; empty if none moves, or if the quality was not requested."""
        if self.held is None or not self.moves:
            return ""
        if self.held.upper <= 0.0:
            return "not held while the fingers move"
        certified = "everywhere on the way" if self.held.lower > 0.0 else "at stations of the way alone"
        return f"held with {self.held} {certified}"

    @property
    def gap(self) -> float:
        """Upper bound on the relative gap to the best quality of all placements; inf if unknown."""
        return self.solution.gap

    @property
    def how(self) -> str:
        """Text on the motion of the fingers."""
        largest = 1e3 * float(np.max(self.moved, initial=0.0))
        if self.solution.mu.lower <= 0.0:
            return "no grasp, also by a cold solve"
        if self.cold:
            return "found by a cold solve, as none that was followed held"
        if self.regrasp:
            return "regrasp"
        return f"slide by at most {largest:.1f} mm" if largest > 0.0 else "stay"


@dataclass(frozen=True)
class DynamicGrasp:
    """Grasps for a changing task, with the finger moves between them.

    Each grasp is certified for the parameter of its step.

    Tasks between two values of the parameter are not certified, and moves only where that was requested.

    Parameters
    ----------
    name : str
        The problem's.
    steps : tuple of DynamicStep
        One per task, in order.
    """

    name: str
    steps: tuple[DynamicStep, ...]

    @property
    def paths(self) -> FloatArray:
        """Contact points of all steps with a grasp, (steps, k, space), metres."""
        return np.array([step.solution.grasp.points for step in self.steps if step.solution.grasp is not None])

    def __str__(self) -> str:
        is_certified = any(step.held is not None for step in self.steps)
        between = "for tasks between them" if is_certified else 'between them (hold="task" certifies moves)'
        lines = [f"{self.name}: {len(self.steps)} steps, certified at each, not {between}"]
        for step in self.steps:
            bounds, kind = step.solution.mu, step.solution.kind
            text = f"{step.parameter:10.4g}: {kind} in {bounds}, {step.how}"
            warnings = "".join(f"; {warning}" for warning in link_obstructions(step.solution.hand))
            moving = f"; {step.held_text}" if step.held_text else ""
            headroom = format_headroom(step.gap)
            lines.append(f"{text}; staying would give at most {step.stayed:.4g}; {headroom}{moving}{warnings}")
        return "\n".join(lines)


def follow_task(
    problem_at: Callable[[float], GraspProblem] | Sequence[GraspProblem],
    parameters: ArrayLike | None = None,
    starts: int = 8,
    seed: int = 0,
    options: SolveOptions | None = None,
    regrasp_gain: float = REGRASP_GAIN,
    hold: Task | str | None = None,
) -> DynamicGrasp:
    """Compute grasps for a task that changes with a parameter, each with the previous one as a warm start.

    Each is certified for its own parameter value. With ``hold`` the moves to it are certified, too (``step.held``), one
    finger at a time: a finger is lifted where the others hold the body alone, and else slides without friction. The
    motion of a hand's links is not checked.

    Parameters
    ----------
    problem_at : callable or sequence of GraspProblem
        Function of the parameter that returns the problem, or one problem per step. Only the task, the constraints
        (surroundings such as a table or an obstacle among them) and the name may differ.
    parameters : (m,) array, optional
        At least 2, in the order in which the task changes; 0, 1, 2, ... by default for a sequence of problems.
    starts : int
        Most starts of a step: those of a cold solve at the first one, and where the previous grasp does not hold. An
        eighth of them is allowed for each other step, and what the steps before have left: a step that the bound does
        not prove to be within a percent of the best is solved anew by as many, at least one. While the gap to the bound
        does not grow, two are saved first; where bound over quality grows by a tenth, all are allowed. After the first
        step, three starts in a row that gain nothing are the last ones.
    seed : int
        Of the starts.
    options : SolveOptions, optional
        Of each step's solve; a time limit is that of a step. The fingers move by mu alone.
    regrasp_gain : float
        Least relative gain for which the fingers move, by sliding or by a regrasp to another local optimum; at least
        zero.
    hold : Task or "task", optional
        Task while a finger moves to the grasp of a step, ``"task"`` for the step's own. Moves are not certified if it
        is left out.

    Returns
    -------
    DynamicGrasp
        One step per parameter value, with a global bound where branch and bound covers the problem (``step.gap``). A
        step without a grasp, even of a cold solve, says so by its status.

    Raises
    ------
    InputError
        When more than task and constraints change, a task is empty, no grasp is found for any, or ``problem_at`` raises
        an error, which is the cause.
    """
    starts, seed, options = check_solve_arguments(starts, seed, options)
    problems, values = _check_steps(problem_at, parameters)
    gain = number("regrasp_gain", regrasp_gain, at_least=0.0)
    if not (hold in (None, OWN_TASK) or (isinstance(hold, Task) and hold.dimension == problems[0].dimension)):
        raise InputError("hold", hold, f'"task", or a task of dimension {problems[0].dimension}')
    options = options.narrow()
    with single_thread():
        compiled = _compile(problems, replace(options, rounds=min(options.rounds, ROUNDS)))
        steps = tuple(_follow(zip(compiled, values, strict=True), starts, seed, options, gain, hold))
    if not any(step.solution.mu.lower > 0.0 for step in steps):
        raise InputError("problem_at", "no grasp found for any of the parameters", "tasks with a grasp")
    return DynamicGrasp(problems[0].name, steps)


def _check_steps(
    problem_at: Callable[[float], GraspProblem] | Sequence[GraspProblem], parameters: ArrayLike | None
) -> tuple[list[GraspProblem], list[float]]:
    """Return the validated problems and the parameter values of the steps."""
    listed = list(problem_at) if isinstance(problem_at, Sequence) else None
    if listed is None and not callable(problem_at):
        raise InputError("problem_at", problem_at, "a function of the parameter, or a sequence of problems")
    if parameters is None and listed is None:
        raise InputError("parameters", None, "the values at which problem_at is a problem")
    values = array("parameters", range(len(listed or ())) if parameters is None else parameters, (None,)).tolist()
    if len(values) < 2:
        raise InputError("parameters", f"{len(values)} values", "at least 2")
    if listed is not None and len(listed) != len(values):
        raise InputError("parameters", f"{len(values)} values", f"{len(listed)}, one for each problem")
    results = [_call(problem_at, i, v) for i, v in enumerate(values)] if callable(problem_at) else listed or []
    problems = [_check_problem(problem, value) for problem, value in zip(results, values, strict=True)]
    for problem, value in zip(problems[1:], values[1:], strict=True):
        _check_same_grasp(problems[0], problem, value)
    return problems, values


def _call(problem_at: Callable[[float], GraspProblem], step: int, value: float) -> GraspProblem:
    """Return the problem of a step from the user's function."""
    try:
        return problem_at(value)
    except Exception as error:  # whatever the user's function raises
        field = f"problem_at({value:g}), step {step}"
        raise InputError(field, error_line(error), "a function that returns a GraspProblem") from error


def _check_problem(problem: object, value: float) -> GraspProblem:
    """Return the validated problem at a value of the parameter."""
    if not isinstance(problem, GraspProblem):
        raise InputError("problem_at", problem, f"a GraspProblem at {value:g}")
    if problem.objective == "nu":
        raise InputError("GraspProblem.objective", "nu", "mu or delta, which are followed")
    if not np.any(problem.task.second_moment()):
        raise InputError("problem_at", f"a task that asks for nothing at {value:g}", "tasks with some wrench")
    return problem


def _check_same_grasp(first: GraspProblem, second: GraspProblem, value: float) -> None:
    """Raise if two problems differ in more than task and constraints."""
    a, b = first.to_dict(), second.to_dict()
    differ = [name for name in a if name not in ("task", "constraints") and a[name] != b[name]]
    if not np.array_equal(first.origin, second.origin):
        differ.append("torque_origin")
    if differ:
        raise InputError(
            "problem_at", f"another {', '.join(differ)} at {value:g}", "problems that differ in task and constraints"
        )


def _compile(problems: Sequence[GraspProblem], options: SolveOptions) -> Iterator[CompiledProblem]:
    """Yield the compiled problems.

    Problems with equal constraints share programs and samples.
    """
    distinct = list[CompiledProblem]()
    for problem in problems:
        similar = next((c for c in distinct if _has_same_constraints(c.problem, problem)), None)
        if similar is None:
            distinct.append(CompiledProblem(problem, options))
        yield distinct[-1] if similar is None else similar.with_task(problem)


def _has_same_constraints(first: GraspProblem, second: GraspProblem) -> bool:
    """Return whether the constraints of two problems are known to be equal, by identity or by complete data."""
    if len(first.constraints) != len(second.constraints):
        return False
    pairs = zip(first.constraints, second.constraints, strict=True)
    return all(a is b or (_is_data(a) and a.to_dict() == b.to_dict()) for a, b in pairs)


def _is_data(constraint: PlacementConstraint) -> bool:
    """Return whether a constraint can be rebuilt from its JSON data, unlike one with a user's expression."""
    try:
        constraint_from_dict(constraint.to_dict())
    except InputError:
        return False
    return True


def _follow(
    tasks: Iterable[tuple[CompiledProblem, float]],
    starts: int,
    seed: int,
    options: SolveOptions,
    gain: float,
    hold: Task | str | None,
) -> Iterator[DynamicStep]:
    """Yield the step of each problem, given with its parameter value; see ``follow_task``."""
    current: StartGrasp | None = None
    graph: SurfaceGraph | None = None
    budget, rtol = _StartBudget(starts), min(options.final_rtol, RTOL)
    for compiled, parameter in tasks:
        search = Multistart(StartRunner(compiled.problem, options, 1, compiled), seed)
        search.begin_bound()
        if current is not None:
            search.add_warm_start(WarmStart(current.on_body.candidate, current.on_body.grasp.normals))
        is_lost = search.best is None
        count = budget.run_starts(search, rtol, is_first=current is None)
        search.close_gap()
        answer = _select_answer(search, rtol, gain)
        if answer is not None:
            search.accept_unchanged(answer)
        step = _make_step(compiled, search, current, parameter, cold=is_lost and current is not None)
        if hold is not None and current is not None and search.chosen is not None:
            graph = graph or SurfaceGraph(compiled.problem.body)
            task = hold if isinstance(hold, Task) else compiled.problem.task
            step = _with_moves(step, compiled.problem, graph, (current, search.chosen), task)
        yield replace(step, starts=count)
        current = search.chosen or current
        budget.add_contacts(search)


class _StartBudget:
    """Budget of starts for a followed task.

    Each step adds to the budget; starts are saved while the gap to the bound does not grow.

    Parameters
    ----------
    starts : int
        Most starts of a step: those of a cold solve.
    """

    def __init__(self, starts: int) -> None:
        self._starts, self._available, self._gap = starts, 1.0, 0.0  # gap after the last step with a start or a proof
        self._contacts = deque[FloatArray](maxlen=RECENT_GRASPS)

    def run_starts(self, search: Multistart, rtol: float, is_first: bool) -> int:
        """Run as many starts of a step as its bound needs and the budget allows, and return their number.

        A step without a grasp has all starts of a cold solve.
        """
        is_lost, count = search.best is None, 0
        self._available += STARTS_SHARE * self._starts
        is_proved = search.prove(rtol)
        if is_lost and not is_proved:
            count = search.run_until_proved(self._starts, rtol, None, None if is_first else PATIENCE)
        elif not is_proved and (self._available >= LEAST_SAVED or 1.0 + search.gap > GROWTH * (1.0 + self._gap)):
            has_fallen = 1.0 + search.gap > FALL * (1.0 + self._gap)
            most = self._starts if has_fallen else min(max(int(self._available), 1), self._starts)
            count = search.run_until_proved(most, rtol, self._contacts, PATIENCE)
            self._available = max(self._available - count, 0.0)
        if count or is_proved:
            self._gap = search.gap
        return count

    def add_contacts(self, search: Multistart) -> None:
        """Store the contacts of a step's solved starts, near which later candidates are proposed."""
        solved = (r for r in search.results if isinstance(r, StartGrasp) and r.solved)
        self._contacts.extend(start.on_body.grasp.points for start in solved)


def _select_answer(search: Multistart, rtol: float, gain: float) -> StartGrasp | None:
    """Select the answer of a step: the warm start, unless the best start gains enough over it.

    The warm start may be unchanged or refined. The answer is ``None`` if no start has a grasp.
    """
    best = search.certify_best(rtol)
    if best is None:
        return None
    required = best.record.mu.lower / (1.0 + gain)
    solved = [r for r in search.results if isinstance(r, StartGrasp) and r.solved and r.record.mu.upper >= required]
    warm = [start for start in solved if start.record.origin is CandidateOrigin.WARM_START]
    certified = (start.tighten_bounds(search.runner.problem, rtol, search.seed) for start in warm)
    return next((start for start in certified if start.record.mu.lower >= required), best)


def _make_step(
    compiled: CompiledProblem, search: Multistart, previous: StartGrasp | None, parameter: float, cold: bool
) -> DynamicStep:
    """Return the record of a step, with the displacements from the previous grasp.

    Its solution does not list the starts: fingers may stay where another start is better.
    """
    solution, chosen = replace(search.answer(branch=False), starts=(), best_start=None), search.chosen
    moved, regrasp, stayed = np.zeros(len(compiled.problem.models)), False, solution.mu.upper
    if previous is not None:
        earlier = previous.on_body
        budget = compiled.budget(earlier.candidate)
        stayed = 0.0
        if GraspOnBody.of(compiled, earlier.candidate, earlier.grasp, earlier.surface).is_feasible:
            stayed = mu(earlier.grasp, compiled.problem.task, compiled.options.rtol, force_budget=budget).upper
        if chosen is not None:
            regrasp = chosen.record.origin is not CandidateOrigin.WARM_START
            moved = _displacements(earlier.grasp, chosen.on_body.grasp, is_any_order=regrasp)
    return DynamicStep(parameter, solution, moved, regrasp, stayed, cold)


def _with_moves(
    step: DynamicStep,
    problem: GraspProblem,
    graph: SurfaceGraph,
    starts: tuple[StartGrasp, StartGrasp],
    task: Task,
) -> DynamicStep:
    """Return a step with the finger moves that lead from the previous grasp to the new one.

    The moves are certified for the task to hold during them. A force budget that depends on contact frames has none.
    """
    if problem.budget.depends_on_frames:
        return step
    source, target = (start.on_body for start in starts)
    order = tuple(range(len(source.grasp)))
    if step.regrasp:
        order = match_contacts(problem, graph, source.grasp, target.grasp)
    ends = [
        [PathStation(p, n, face) for p, n, face in zip(b.grasp.points, b.grasp.normals, b.candidate.faces, strict=True)]
        for b in (source, target)
    ]
    paths = [graph.stations(ends[0][i], ends[1][j]) for i, j in enumerate(order)]
    moving = [i for i, j in enumerate(order) if np.any(ends[0][i].point != ends[1][j].point)]
    if not moving:
        return replace(step, held=mu(target.grasp, task, RTOL, force_budget=problem.budget))
    holding = HoldingQuality(problem, source.grasp, target.grasp, order, paths, task)
    moves = ordered_moves(holding, None, moving)
    lower, upper = (min(getattr(move.held, end) for move in moves) for end in ("lower", "upper"))
    return replace(step, moves=moves, held=Bounds(lower, upper))


def _displacements(before: Grasp, after: Grasp, is_any_order: bool) -> FloatArray:
    """Return the displacement of each contact between two grasps, (k,), metres.

    In any order they are those of the matching with the least sum.
    """
    distances = np.linalg.norm(before.points[:, None] - after.points, axis=2)
    return distances[linear_sum_assignment(distances)] if is_any_order else np.diagonal(distances)
