"""Solve a grasp problem."""

from __future__ import annotations

import json
import platform
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import scipy
import trimesh
from threadpoolctl import threadpool_limits

from nlpgrasp.budgets import ForceBudget
from nlpgrasp.errors import InputError, NlpgraspError, NoGraspError
from nlpgrasp.grasp import Grasp
from nlpgrasp.problem import GraspProblem
from nlpgrasp.quality import Bounds, Volume, delta, finger_forces, mu, nu
from nlpgrasp.solution import GraspSolution, StartRecord, Status
from nlpgrasp.solve.aftermath import Aftermath
from nlpgrasp.solve.interrupt import Interrupt
from nlpgrasp.solve.options import SolveOptions
from nlpgrasp.solve.parallel import NOT_BEGUN, Runner
from nlpgrasp.solve.start_result import StartResult
from nlpgrasp.solve.stop import Stop
from nlpgrasp.tasks import Task
from nlpgrasp.validation import FloatArray, integer
from nlpgrasp.version import __version__

Progress = Callable[[StartRecord, Bounds], None]
CLOSE = 0.03  # relative: lower bounds of starts this close are a tie
OTHER_RTOL = 0.02  # relative gap of delta, error bar of nu
FINAL_GRACE = 2.0  # seconds the answer's certificate may take past the time limit


def solve(
    problem: GraspProblem,
    starts: int = 8,
    seed: int = 0,
    options: SolveOptions | None = None,
    *,
    progress: Progress | None = None,
    throw: bool = False,
) -> GraspSolution:
    """Find the best grasp over several seeded starts and certify it.

    Each start draws random placements, screens them, solves the first program, refines the best contacts with
    the exchange, puts them on the body and certifies them. The answer is the start with the best certified
    bounds; it is a local optimum at most. The same seed gives the same answer with any number of workers
    (unless a time limit or Ctrl-C cuts the solve short).

    Parameters
    ----------
    problem : GraspProblem
    starts : int
        At least 1.
    seed : int
        At least 0.
    options : SolveOptions, optional
    progress : callable, optional
        Called with each finished start's record and the best certified bounds so far.
    throw : bool
        Raise :class:`NoGraspError` (which carries the result) when no grasp was found.

    Returns
    -------
    GraspSolution
        Also when no grasp was found: its status says what to do.
    """
    if not isinstance(problem, GraspProblem):
        raise InputError("problem", problem, "a GraspProblem")
    starts = integer("starts", starts, at_least=1, at_most=10**6)
    seed = integer("seed", seed, at_least=0, at_most=10**15)
    options = SolveOptions() if options is None else options
    if not isinstance(options, SolveOptions):
        raise InputError("options", options, "a SolveOptions")
    begun = time.monotonic()
    deadline = None if options.time_limit is None else begun + options.time_limit
    check_json(problem.to_dict())
    results: list[StartResult] = []
    with tempfile.TemporaryDirectory(prefix="nlpgrasp-") as folder:
        stop = Stop(deadline, Path(folder) / "stop")
        runner = Runner(problem, options, starts)
        with Interrupt(stop) as interrupt, threadpool_limits(1):
            for result in runner.starts(seed, stop):
                results.append(result)
                if progress is not None:
                    best = _best(results)
                    progress(result.record, Bounds(0.0, float("inf")) if best is None else best.record.mu)
            results.sort(key=lambda r: r.record.index)
            begun_all = len(results) == starts and all(r.record.message != NOT_BEGUN for r in results)
            cut_short = Status.INTERRUPTED if interrupt.caught else None if begun_all else Status.TIME_LIMIT
            after = Aftermath()
            if not stop.requested() and any(r.grasp is not None for r in results):
                after = runner.look_back(_best(results), results, seed, stop)
            solution = _solution(problem, options, seed, results, cut_short, deadline, after)
    solution = replace(solution, solver=_solver_record(options, seed, results, time.monotonic() - begun))
    if throw and not solution.success:
        raise NoGraspError(solution.status.value, solution)
    return solution


def check_json(data: dict[str, Any]) -> None:
    """Refuse, before anything is solved, a problem whose result could not be written."""
    try:
        json.dumps(data, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise InputError("problem", str(error), "parts that can be written as JSON") from None


def _best(results: Sequence[StartResult]) -> StartResult | None:
    """Return the best solved start; the earliest of equals.

    The lower bounds of two starts differ by chance within their certificates' gap, while the upper bounds are nearly
    always the values themselves: among the starts whose lower bounds are that close, the largest upper bound wins.
    """
    solved = [r for r in results if r.record.status is Status.SOLVED]
    if not solved:
        return None
    lower = max(r.rank.lower for r in solved)
    close = [r for r in solved if r.rank.upper >= lower and r.rank.lower >= (1.0 - CLOSE) * lower]
    return max(close, key=lambda r: (r.rank.upper, -r.record.index))


def _solution(
    problem: GraspProblem,
    options: SolveOptions,
    seed: int,
    results: list[StartResult],
    cut_short: Status | None,
    deadline: float | None,
    after: Aftermath,
) -> GraspSolution:
    records = tuple(r.record for r in results)
    kind = "mu" if problem.task.is_centred else "mu_tilde"
    best = _best(results)
    data = problem.to_dict()
    if best is None or best.grasp is None:
        failed = bool(records) and all(r.status is Status.FAILED for r in records)
        found = Status.FAILED if failed else Status.NO_GRASP
        if after.why_not is not None and after.why_not.locally_infeasible:
            found = Status.LOCALLY_INFEASIBLE
        status = cut_short or found
        return GraspSolution(status, problem.name, data, kind=kind, why_not=after.why_not, starts=records)
    limit = None if deadline is None and cut_short is None else max(deadline or 0.0, time.monotonic() + FINAL_GRACE)
    budget = problem.budget.posed(problem.hand, best.hand or {}, best.grasp.points)
    data = problem.unchecked(force_budget=budget).to_dict()
    bounds = mu(best.grasp, problem.task, options.final_rtol, force_budget=budget, seed=seed, deadline=limit)
    bounds = Bounds(
        max(bounds.lower, best.record.mu.lower),
        min(bounds.upper, best.record.mu.upper),
        bounds.worst_direction,
    )
    forces, moments = _forces(problem.task, best.grasp, budget, bounds.lower)
    scale = best.grasp.mean_arm
    measured = limit is None  # where time is short, mu alone
    return GraspSolution(
        status=cut_short or Status.SOLVED,
        name=problem.name,
        problem=data,
        grasp=best.grasp,
        faces=best.record.faces,
        mu=bounds,
        kind=kind,
        delta=delta(best.grasp, scale, OTHER_RTOL, force_budget=budget) if measured else None,
        nu=_volume(best.grasp, scale, budget) if measured else None,
        forces=forces,
        moments=moments,
        constraints=best.constraints,
        prices=after.prices,
        robust=after.robust,
        hand=_hand_data(problem, best, after),
        surface=best.surface,
        starts=records,
    )


def _hand_data(problem: GraspProblem, best: StartResult, after: Aftermath) -> dict[str, Any] | None:
    """Return the hand in the grasp, and where it is just before."""
    hand = problem.hand
    if hand is None or best.hand is None:
        return None
    data = hand.describe(best.hand)
    if after.pregrasp is not None:
        data["pregrasp"] = {"clearance": after.pregrasp.clearance, **hand.describe(after.pregrasp.hand)}
    if after.link_depth is not None:
        data["link_depth"] = after.link_depth.to_dict()
    return data


def _volume(grasp: Grasp, scale: float, budget: ForceBudget) -> Volume | None:
    """Return nu; None rather than lose a solution, or minutes, over it."""
    if budget.at(grasp.frames, grasp.contacts).costly:
        return None
    try:
        return nu(grasp, scale, OTHER_RTOL, force_budget=budget)
    except NlpgraspError:
        return None


def _forces(
    task: Task, grasp: Grasp, budget: ForceBudget, share: float
) -> tuple[tuple[tuple[FloatArray, FloatArray], ...], tuple[FloatArray, ...]]:
    """Return least finger forces, and moments if any, for some of the task's extreme wrenches times the quality."""
    wrenches = share * task.ends()
    found = finger_forces(grasp, wrenches, force_budget=budget)
    each = [grasp.contact_wrenches(x) for x in found.forces[found.feasible]]
    space = grasp.space
    forces = tuple((w, c[:, :space]) for w, c in zip(wrenches[found.feasible], each, strict=True))
    turning = any(axis >= space for m in grasp.contacts for axis in m.axes(space))
    return forces, tuple(c[:, space:] for c in each) if turning else ()


def _solver_record(options: SolveOptions, seed: int, results: Sequence[StartResult], seconds: float) -> dict[str, Any]:
    return {
        "seed": seed,
        "iterations": sum(r.record.iterations for r in results),
        "seconds": {
            "total": seconds,
            "ipopt": sum(r.solver_seconds for r in results),
            "functions": sum(r.function_seconds for r in results),
        },
        "options": options.to_dict(),
        "versions": {
            "nlpgrasp": __version__,
            "python": platform.python_version(),
            "casadi": ca.CasadiMeta.version(),
            "numpy": np.__version__,
            "scipy": scipy.__version__,
            "trimesh": trimesh.__version__,
        },
    }
