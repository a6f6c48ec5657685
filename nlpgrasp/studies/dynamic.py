"""Dynamic grasping (Section 3.6): the grasp follows a task that changes.

Contacts found for one task are a few steps of the exchange away from the best ones near them for a task a little
different: the program is the same, only its cuts are others. Several local optima are followed side by side, so that
it is seen where sliding along no longer helps and a regrasp pays.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import linear_sum_assignment

from nlpgrasp.common.validation import FloatArray, array, integer, number
from nlpgrasp.errors import InputError
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.quality import Bounds, mu
from nlpgrasp.solution.records import Status
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.solve.answer import solver_record
from nlpgrasp.solve.ascent.cuts import with_known
from nlpgrasp.solve.ascent.exchange import exchange, exchange_rules
from nlpgrasp.solve.ascent.state import AscentState, Effort
from nlpgrasp.solve.ascent.weakest import weakest_at
from nlpgrasp.solve.options import SolveOptions
from nlpgrasp.solve.start.result import StartGrasp
from nlpgrasp.solve.start.run import run_start
from nlpgrasp.solve.surface.on_body import OnBody
from nlpgrasp.solve.surface.put import put_on_body
from nlpgrasp.solve.surface.reports import constraint_reports
from nlpgrasp.solve.workbench.placed import Placed
from nlpgrasp.solve.workbench.workbench import Workbench
from nlpgrasp.solve.workers.one_thread import one_thread
from nlpgrasp.solve.workers.stop import Stop
from nlpgrasp.studies.dynamic_grasp import DynamicGrasp, DynamicStep

SAME = 0.02  # of the body's size: contacts this close, in whatever order, are the same grasp
FOLLOWED = 6  # local optima that are followed
HOPEFUL = 0.95  # of the best one's quality: others are improved for the new task only from there
TURNS = 4  # and each of them every so many steps
NEAR_RADIUS, NEAR_GAIN = 0.03, 2e-3  # of the exchange: the task changes a little, and so do the contacts
STAYED_RTOL = 0.02


def follow_task(
    problem_at: Callable[[float], GraspProblem],
    parameters: ArrayLike,
    starts: int = 8,
    seed: int = 0,
    options: SolveOptions | None = None,
    regrasp_gain: float = 0.05,
) -> DynamicGrasp:
    """Return the grasps for a task that changes with a parameter, each found from the one before.

    Parameters
    ----------
    problem_at : callable
        The problem for a value of the parameter. Only its task and its name may differ.
    parameters : (m,) array
        At least 2 values, in the caller's own unit and in the order in which the task changes.
    starts : int
        Cold starts for the first and for the last value; what they find is followed from both ends.
    seed : int
    options : SolveOptions, optional
    regrasp_gain : float
        How much better, relatively, another local optimum has to be before it is taken.

    Raises
    ------
    InputError
        When more than the task changes, or no grasp is found at either end.
    """
    if not callable(problem_at):
        raise InputError("problem_at", problem_at, "a function of the parameter")
    if options is not None and not isinstance(options, SolveOptions):
        raise InputError("options", options, "a SolveOptions")
    values = array("parameters", parameters, (None,))
    if len(values) < 2:
        raise InputError("parameters", f"{len(values)} values", "at least 2")
    starts, seed = integer("starts", starts, at_least=1), integer("seed", seed, at_least=0)
    gain = number("regrasp_gain", regrasp_gain, at_least=0.0)
    options = SolveOptions() if options is None else options
    problems = [_problem(problem_at, value) for value in values.tolist()]
    for problem, value in zip(problems[1:], values[1:], strict=True):
        _check_same(problems[0], problem, float(value))
    bench = Workbench(problems[0], options)
    with one_thread():
        branches = _branches([bench.with_task(problems[i]) for i in (0, -1)], starts, seed)
        if not branches:
            raise InputError("problem_at", "no grasp found at either end of the parameters", "tasks with a grasp")
        return DynamicGrasp(problems[0].name, tuple(_steps(bench, problems, values, branches, seed, gain)))


def _steps(
    bench: Workbench,
    problems: Sequence[GraspProblem],
    values: FloatArray,
    branches: list[AscentState],
    seed: int,
    gain: float,
) -> list[DynamicStep]:
    """Follow the branches through all tasks; take another branch where it is better by the gain."""
    result: list[DynamicStep] = []
    current: AscentState | None = None
    before: OnBody | None = None
    rules = exchange_rules(bench)
    near = replace(rules, radius=min(rules.radius, NEAR_RADIUS), least_gain=max(rules.least_gain, NEAR_GAIN))
    for value, problem in zip(values.tolist(), problems, strict=True):
        here, rng, begun = bench.with_task(problem), np.random.default_rng(0), time.monotonic()
        for branch in branches:
            branch.value, branch.effort = _value(here, branch), Effort()
        stayed = np.inf if before is None else _at_most(here, before)
        best = max(branch.value for branch in branches)
        for i, branch in enumerate(branches):
            its_turn = current is None or (len(result) + i) % TURNS == 0
            if branch is current or (its_turn and branch.value >= HOPEFUL * best):
                exchange(here, branch, rng, Stop(), rules if current is None else near)
                branch.rounds = 0
        order = sorted(branches, key=lambda b: -b.value)
        taken = order[0] if current is None else current
        found, solution = _placed(here, taken, rng)
        for other in order if current is not None else ():
            if other is taken or other.value <= (1.0 + gain) * solution.mu.upper:
                continue
            there = _placed(here, other, rng)  # the search for weak directions may flatter: the certificate decides
            if there[1].mu.lower > (1.0 + gain) * solution.mu.upper:
                taken, (found, solution) = other, there
        regrasp = current is not None and taken is not current
        moved = np.zeros(len(found.grasp)) if before is None else _moved(before.grasp, found.grasp, regrasp)
        record = solver_record(bench.options, seed, taken.effort, time.monotonic() - begun)
        solution = replace(solution, solver=record)
        result.append(DynamicStep(value, solution, moved, regrasp, stayed if result else solution.mu.upper))
        current, before = taken, found
    return result


def _branches(benches: Sequence[Workbench], starts: int, seed: int) -> list[AscentState]:
    """Return different local optima that cold starts find, the best of each bench's first."""
    result: list[AscentState] = []
    for bench in benches:
        results = [run_start(bench, i, seed, Stop()) for i in range(starts)]
        solved = [r for r in results if isinstance(r, StartGrasp) and r.solved]
        own: list[AscentState] = []
        for start in sorted(solved, key=lambda r: -r.record.mu.upper):
            if len(own) == FOLLOWED // len(benches):
                continue
            placed, size = start.found.placed, SAME * bench.scaling.length
            if all(np.max(_distances(placed.points, b.placed.points)) > size for b in result + own):
                own.append(_branch(bench, placed, np.random.default_rng(0)))
        result += own
    return result


def _branch(bench: Workbench, placed: Placed, rng: np.random.Generator) -> AscentState:
    """Return where contacts and hand are as a branch, with the directions in which they are weakest."""
    snapped = bench.snapped(placed)
    unknown = np.zeros(len(bench.rows.named))  # multipliers, until a step is accepted
    return AscentState(snapped, cuts=weakest_at(bench, snapped, rng).directions, multipliers=unknown)


def _value(bench: Workbench, branch: AscentState) -> float:
    """Return an upper bound on the quality of contacts that stay, from the directions known of them."""
    task = bench.problem.task
    directions = with_known(branch.cuts, np.zeros((0, task.dimension)), task)
    reached = bench.wrench_set(branch.placed).support(directions)[0]
    return float(np.min(reached, initial=np.inf))


def _at_most(bench: Workbench, before: OnBody) -> float:
    """Return the certified upper bound of contacts, and hand, that stay where they were."""
    return mu(before.grasp, bench.problem.task, STAYED_RTOL, force_budget=bench.budget(before.placed)).upper


def _placed(bench: Workbench, branch: AscentState, rng: np.random.Generator) -> tuple[OnBody, GraspSolution]:
    """Return the branch's grasp on the body, certified."""
    found = put_on_body(bench, branch, rng, Stop())
    problem, hand, budget = bench.problem, found.placed.hand, bench.budget(found.placed)
    bounds = mu(found.grasp, problem.task, bench.options.final_rtol, force_budget=budget)
    solution = GraspSolution(
        Status.SOLVED if found.allowed and bounds.lower > 0.0 else Status.NO_GRASP,
        problem.name,
        problem.unchecked(force_budget=budget).to_dict(),
        grasp=found.grasp,
        faces=found.placed.faces,
        mu=Bounds(bounds.lower, bounds.upper, bounds.worst_direction),
        kind=problem.task.measure,
        constraints=constraint_reports(bench, found, branch.multipliers),
        hand=None if problem.hand is None or not hand else problem.hand.describe(hand),
        surface=found.surface,
    )
    return found, solution


def _moved(before: Grasp, after: Grasp, any_order: bool) -> FloatArray:
    """Return how far the contacts went; after a regrasp each finger takes the nearest of like contacts."""
    if not any_order:
        return np.asarray(np.linalg.norm(after.points - before.points, axis=1))
    return _distances(after.points, before.points)


def _distances(one: FloatArray, other: FloatArray) -> FloatArray:
    """Return the distances between two sets of contacts, paired for the least sum."""
    apart = np.linalg.norm(one[:, None] - other[None], axis=2)
    rows, columns = linear_sum_assignment(apart)
    return np.asarray(apart[rows, columns])


def _problem(problem_at: Callable[[float], GraspProblem], value: float) -> GraspProblem:
    problem = problem_at(value)
    if not isinstance(problem, GraspProblem):
        raise InputError("problem_at", problem, f"a GraspProblem at {value:g}")
    return problem


def _check_same(one: GraspProblem, other: GraspProblem, value: float) -> None:
    """Refuse problems that differ in more than their task."""
    a, b = one.to_dict(), other.to_dict()
    differ = [name for name in a if name != "task" and a[name] != b[name]]
    if not np.array_equal(one.origin, other.origin):
        differ.append("torque_origin")
    if differ:
        raise InputError(
            "problem_at", f"another {', '.join(differ)} at {value:g}", "problems that differ in their task"
        )
