"""Answer of a solve: its best start, certified and measured, with a record of the search."""

from __future__ import annotations

import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib.metadata import version

import casadi as ca
import numpy as np
import scipy

from nlpgrasp.analysis.squeeze import with_squeeze
from nlpgrasp.common.shown.said import warn
from nlpgrasp.common.stopping.stop import Stop
from nlpgrasp.optimize.after.least_forces import least_forces
from nlpgrasp.optimize.ascent.state import Effort
from nlpgrasp.optimize.options import SolveOptions
from nlpgrasp.optimize.start.result import StartGrasp, StartResult
from nlpgrasp.optimize.workbench.clock import Clock
from nlpgrasp.optimize.workbench.programs import budget_at
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.solution.findings import WhyNot
from nlpgrasp.solution.measures.global_bound import GlobalBound
from nlpgrasp.solution.records import StartRecord, Status
from nlpgrasp.solution.schema.types import SolverData
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.solution.starts import ipopt_lines
from nlpgrasp.version import __version__

FINAL_GRACE = 2.0  # seconds the answer's certificate may take past the time limit


@dataclass(frozen=True)
class Search:
    """Record of a search: its starts and how it ended.

    Parameters
    ----------
    problem : GraspProblem
    options : SolveOptions
    seed : int
    results : sequence of StartResult
    cut_short : Status or None
        Why it ended before all starts were done.
    stop : Stop
        The time limit.
    bound : GlobalBound or None
        On mu over all placements.
    clock : Clock
        Of the solve.
    chosen : StartGrasp or None
        The start that is the answer; None where none found a grasp.
    """

    problem: GraspProblem
    options: SolveOptions
    seed: int
    results: Sequence[StartResult]
    cut_short: Status | None = None
    stop: Stop = field(default_factory=Stop)
    bound: GlobalBound | None = None
    clock: Clock = field(default_factory=Clock)
    chosen: StartGrasp | None = None

    @property
    def effort(self) -> Effort:
        """What all starts cost together."""
        return sum((r.effort for r in self.results), Effort())

    @property
    def records(self) -> tuple[StartRecord, ...]:
        """Records of the starts, in their order."""
        return tuple(r.record for r in self.results)

    def bound_above(self, lower: float) -> GlobalBound | None:
        """Return the bound beside a grasp of this certified quality, which it may be below by rounding alone."""
        return None if self.bound is None else replace(self.bound, upper=max(self.bound.upper, lower))


def answer(search: Search, why_not: WhyNot | None) -> GraspSolution:
    """Return the chosen start's grasp with its certificate, measures and forces, or what there is without one."""
    return _without_grasp(search, why_not) if search.chosen is None else _of_best(search, search.chosen)


def _without_grasp(search: Search, why_not: WhyNot | None) -> GraspSolution:
    """Return the solution of a search that found no grasp."""
    records = search.records
    failed = bool(records) and all(r.status is Status.FAILED for r in records)
    found = Status.FAILED if failed else Status.NO_GRASP
    if why_not is not None and why_not.locally_infeasible:
        found = Status.LOCALLY_INFEASIBLE
    problem, status = search.problem, search.cut_short or found
    told = problem.to_dict()
    return GraspSolution(
        status, problem.name, told, kind=problem.task.measure, bound=search.bound, why_not=why_not, starts=records
    )


def _of_best(search: Search, best: StartGrasp) -> GraspSolution:
    """Return the best start's grasp; where time is short, with mu alone."""
    problem, found, grasp = search.problem, best.found, best.found.grasp
    budget = budget_at(problem, found.placed)
    rtol, certified = search.options.final_rtol, best.record.mu
    if certified.gap > rtol:
        limit = search.stop.certificate_deadline(FINAL_GRACE)
        certified = best.certified(problem, rtol, search.seed, limit).record.mu
    search.clock.mark("certificate")
    exerted = least_forces(problem, grasp, budget, certified)
    search.clock.mark("forces")
    bound = search.bound_above(certified.lower)
    solution = GraspSolution(
        status=search.cut_short or _status(search.options, bound, certified.lower, best),
        name=problem.name,
        problem=problem.unchecked(force_budget=budget).to_dict(),
        grasp=grasp,
        faces=found.placed.faces,
        mu=certified,
        kind=problem.task.measure,
        forces=exerted.forces,
        moments=exerted.moments,
        needed=exerted.needed,
        constraints=best.constraints,
        robust=None if best.robust is None else best.robust.beside(certified),
        bound=bound,
        kkt=best.kkt,
        hand=best.hand,
        surface=found.surface,
        starts=search.records,
        best_start=best.record.index,
        source=problem,
    )
    squeezed = with_squeeze(solution, problem.hand)
    search.clock.mark("squeeze")
    return squeezed


def _status(options: SolveOptions, bound: GlobalBound | None, lower: float, best: StartGrasp) -> Status:
    """Return how a search ended that found a grasp: free or not, and whether as close to the best as was asked for."""
    if best.record.status is Status.TOUCHES:
        return Status.TOUCHES
    closed = options.gap is not None and bound is not None and bound.gap(lower) <= options.gap
    return Status.OPTIMAL if closed else Status.SOLVED


def solver_record(
    options: SolveOptions, seed: int, effort: Effort, seconds: float, stages: Mapping[str, float] | None = None
) -> SolverData:
    """Return how the solve went, for the file: seed, effort, wall time and its stages, options, versions.

    Warns
    -----
    UserWarning
        Where IPOPT did not run in some of its calls.
    """
    record: SolverData = {
        "seed": seed,
        "iterations": effort.iterations,
        "ipopt_calls": effort.calls,
        "seconds": {
            "total": seconds,
            **(stages or {}),
            "ipopt": effort.solver_seconds,
            "functions": effort.function_seconds,
        },
        "options": options.to_dict(),
        "versions": {
            "nlpgrasp": __version__,
            "python": platform.python_version(),
            "casadi": ca.CasadiMeta.version(),
            "numpy": np.__version__,
            "scipy": scipy.__version__,
            "trimesh": version("trimesh"),
            "manifold3d": version("manifold3d"),
        },
    }
    if effort.failures:
        record["ipopt_failures"] = dict(effort.failures)
        warn(*ipopt_lines(record))
    return record
