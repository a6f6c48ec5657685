"""Answer of a solve: selection among the starts, certificate, measures, record of the search."""

from __future__ import annotations

import platform
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib.metadata import version

import casadi as ca
import numpy as np
import scipy

from nlpgrasp.analysis.squeeze import add_squeeze
from nlpgrasp.common.deadline import Deadline, Stopwatch
from nlpgrasp.common.user_warnings import warn
from nlpgrasp.hands.base import Hand, PosedHand
from nlpgrasp.optimize.candidate import Effort
from nlpgrasp.optimize.compiled_problem import CompiledProblem
from nlpgrasp.optimize.compiled_programs import budget_at
from nlpgrasp.optimize.exerted_forces import least_forces
from nlpgrasp.optimize.final_step import converge_to_optimum, keep_off_optimum
from nlpgrasp.optimize.options import SolveOptions
from nlpgrasp.optimize.processes import single_thread
from nlpgrasp.optimize.robustness import robustness
from nlpgrasp.optimize.start_result import StartGrasp, StartResult, attempt, best_of
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.quality.least_friction import can_press
from nlpgrasp.solution.analysis_records import WhyNot
from nlpgrasp.solution.quality_record import GlobalBound
from nlpgrasp.solution.records import StartRecord, Status
from nlpgrasp.solution.schema import SolverData
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.solution.start_summary import ipopt_lines
from nlpgrasp.version import __version__

FINAL_GRACE = 2.0  # seconds the answer's certificate may take past the time limit
MOST = 3  # grasps compared by robustness, the best one among them
HALF = 0.5  # share of the best mu below which no other grasp is chosen
WEAK, TIE = 0.5, 0.95  # remaining share of mu below which a grasp is weak; share of mu from which a stronger one wins
APART = 0.1  # over the body's size: Hausdorff distance of contacts above which grasps are distinct


@dataclass(frozen=True)
class SearchRecord:
    """Record of a search: its starts and how it ended.

    Parameters
    ----------
    problem : GraspProblem
    options : SolveOptions
    seed : int
    results : sequence of StartResult
    cut_short : Status or None
        Why it ended before all starts were done.
    deadline : Deadline
        The time limit.
    bound : GlobalBound or None
        On mu over all placements.
    clock : Stopwatch
        Of the solve.
    chosen : StartGrasp or None
        The start that is the answer; None where none found a grasp.
    """

    problem: GraspProblem
    options: SolveOptions
    seed: int
    results: Sequence[StartResult]
    cut_short: Status | None = None
    deadline: Deadline = field(default_factory=Deadline)
    bound: GlobalBound | None = None
    clock: Stopwatch = field(default_factory=Stopwatch)
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


def choose_start(
    compiled: CompiledProblem, best: StartGrasp, results: Sequence[StartResult], deadline: Deadline
) -> StartGrasp:
    """Return the start selected as the answer, with its robustness where it was computed.

    That is the best one, unless it is fragile: then the first in the order of mu that is not, that has at least half
    its mu and leaves more at its worst placement. One that is not fragile, but keeps less than half of its mu, loses so
    to one with 0.95 of it. Two others are tried, and the best start as it was before it converged to its local optimum.

    Parameters
    ----------
    compiled : CompiledProblem
    best : StartGrasp
        With the best mu, at its local optimum.
    results : sequence of StartResult
        Those that may be the answer, as they were before any converged.
    deadline : Deadline
    """
    with single_thread():
        best = _with_robustness(compiled, best)
        if best.robust is None or best.robust.share(best.record.mu) >= WEAK:
            return best
        share = HALF if best.robust.is_fragile(best.record.mu) else TIE
        for other in _next_best(compiled, best, results, share):
            if deadline.is_requested():
                break
            start = _with_robustness(compiled, other)
            if start.robust is None or start.robust.is_fragile(start.record.mu):
                continue
            if start.robust.mu.lower > best.robust.mu.upper:
                if other.record.index == best.record.index:
                    return keep_off_optimum(compiled, start, "the local optimum next to this grasp is fragile")
                return converge_to_optimum(compiled, start, deadline)
    return best


def pressing_starts(
    hand: Hand | None, best: StartGrasp, results: Sequence[StartResult]
) -> tuple[StartGrasp, Sequence[StartResult]]:
    """Return the best start whose contacts can press against each other, and all such; the arguments if none can.

    Other grasps of a hand with joints hold the task only while it pushes into the fingers. Only starts with at least
    half of the best one's mu count.
    """
    if not isinstance(hand, PosedHand) or not hand.loaded_joints or can_press(best.on_body.grasp):
        return best, results
    least = HALF * best.record.mu.upper
    good = [r for r in results if isinstance(r, StartGrasp) and r.solved and r.record.mu.lower >= least]
    pressing = [r for r in good if can_press(r.on_body.grasp)]
    first = best_of(pressing)
    return (best, results) if first is None else (first, pressing)


def _with_robustness(compiled: CompiledProblem, start: StartGrasp) -> StartGrasp:
    """Return a start with its robustness; where that fails numerically, with a remark."""
    if start.robust is not None:
        return start
    robust, message = attempt(lambda: robustness(compiled, start.on_body.candidate, start.on_body.grasp))
    return replace(start, robust=robust).with_message(message and f"no robustness: {message}")


def _next_best(
    compiled: CompiledProblem, best: StartGrasp, results: Sequence[StartResult], share: float
) -> Iterator[StartGrasp]:
    """Yield the best start before it converged, then the next best ones with distinct grasps and this share of mu."""
    least, taken = share * best.record.mu.lower, [best]
    solved = [r for r in results if isinstance(r, StartGrasp) and r.solved]
    if best.optimum is not None:
        yield from (r for r in solved if r.record.index == best.record.index)
    for start in sorted(solved, key=lambda r: (-r.record.mu.upper, r.record.index)):
        if start.record.mu.lower < least or len(taken) == MOST:
            break
        if all(_hausdorff_distance(start, other) > APART * compiled.scaling.length for other in taken):
            taken.append(start)
            yield start


def _hausdorff_distance(a: StartGrasp, b: StartGrasp) -> float:
    """Return the Hausdorff distance between the contacts of two grasps, metres."""
    p, q = a.on_body.grasp.points, b.on_body.grasp.points
    distances = np.linalg.norm(p[:, None] - q[None], axis=2)
    return float(max(np.max(np.min(distances, axis=1)), np.max(np.min(distances, axis=0))))


def make_answer(search: SearchRecord, why_not: WhyNot | None) -> GraspSolution:
    """Return the chosen start's grasp with its certificate, measures and forces, or what there is without one."""
    return _solution_without_grasp(search, why_not) if search.chosen is None else _measure_best(search, search.chosen)


def _solution_without_grasp(search: SearchRecord, why_not: WhyNot | None) -> GraspSolution:
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


def _measure_best(search: SearchRecord, best: StartGrasp) -> GraspSolution:
    """Return the best start's grasp; where time is short, with mu alone."""
    problem, found, grasp = search.problem, best.on_body, best.on_body.grasp
    budget = budget_at(problem, found.candidate)
    rtol, certified = search.options.final_rtol, best.record.mu
    if certified.gap > rtol:
        limit = search.deadline.certificate_deadline(FINAL_GRACE)
        certified = best.tighten_bounds(problem, rtol, search.seed, limit).record.mu
    search.clock.mark("certificate")
    exerted = least_forces(problem, grasp, budget, certified)
    search.clock.mark("forces")
    bound = search.bound_above(certified.lower)
    solution = GraspSolution(
        status=search.cut_short or _final_status(search.options, bound, certified.lower, best),
        name=problem.name,
        problem=problem.unchecked(force_budget=budget).to_dict(),
        grasp=grasp,
        faces=found.candidate.faces,
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
    squeezed = add_squeeze(solution, problem.hand)
    search.clock.mark("squeeze")
    return squeezed


def _final_status(options: SolveOptions, bound: GlobalBound | None, lower: float, best: StartGrasp) -> Status:
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
