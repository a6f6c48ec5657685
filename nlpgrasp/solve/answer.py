"""The answer of a solve: its best start, certified and measured, with how it was found."""

from __future__ import annotations

import platform
import time
from collections.abc import Sequence

import casadi as ca
import numpy as np
import scipy
import trimesh

from nlpgrasp.budgets import ForceBudget
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import NlpgraspError
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.quality import Bounds, Volume, delta, finger_forces, mu, nu
from nlpgrasp.solution.records import Status
from nlpgrasp.solution.schema.types import SolverData
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.solve.after.look_back import Aftermath
from nlpgrasp.solve.options import SolveOptions
from nlpgrasp.solve.start.result import StartResult
from nlpgrasp.tasks import Task
from nlpgrasp.version import __version__

CLOSE = 0.03  # relative: lower bounds of starts this close are a tie
OTHER_RTOL = 0.02  # relative gap of delta, error bar of nu
FINAL_GRACE = 2.0  # seconds the answer's certificate may take past the time limit


def best_of(results: Sequence[StartResult]) -> StartResult | None:
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


def answer(
    problem: GraspProblem,
    options: SolveOptions,
    seed: int,
    results: list[StartResult],
    cut_short: Status | None,
    deadline: float | None,
    after: Aftermath,
) -> GraspSolution:
    """Return the best start's grasp with its certificate, measures and forces, or what there is without one."""
    records = tuple(r.record for r in results)
    kind = "mu" if problem.task.is_centred else "mu_tilde"
    best = best_of(results)
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
        drawing=after.drawing,
        starts=records,
        best_start=best.record.index,
    )


def _hand_data(problem: GraspProblem, best: StartResult, after: Aftermath) -> Json | None:
    """Return the hand in the grasp, and where it is just before."""
    hand = problem.hand
    if hand is None or best.hand is None:
        return None
    data = dict(hand.describe(best.hand))
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


def solver_record(options: SolveOptions, seed: int, results: Sequence[StartResult], seconds: float) -> SolverData:
    """Return how the solve went, for the file: seed, effort, options, versions."""
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
