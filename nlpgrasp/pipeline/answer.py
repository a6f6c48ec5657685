"""Answer of a solve: selection among the starts, certificate, finger forces and record of the search."""

from __future__ import annotations

import platform
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib.metadata import version

import casadi as ca
import numpy as np
import scipy

from nlpgrasp.analysis.grip_force import add_grip
from nlpgrasp.analysis.squeeze import add_squeeze
from nlpgrasp.common.deadline import Deadline, Stopwatch
from nlpgrasp.common.types import Json
from nlpgrasp.common.user_warnings import warn
from nlpgrasp.hands.base import Hand, PosedHand
from nlpgrasp.optimize.candidate import SolverEffort
from nlpgrasp.optimize.compiled_problem import CompiledProblem
from nlpgrasp.optimize.compiled_programs import budget_at
from nlpgrasp.optimize.exerted_forces import compute_exerted_forces
from nlpgrasp.optimize.local_convergence import FRAGILE_OPTIMUM, converge_to_optimum, keep_unconverged
from nlpgrasp.optimize.options import SolveOptions
from nlpgrasp.optimize.processes import single_thread
from nlpgrasp.optimize.robustness import robustness
from nlpgrasp.optimize.start_result import StartGrasp, StartResult, attempt, best_of
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.quality import Bounds, nu
from nlpgrasp.quality.least_friction import can_press
from nlpgrasp.solution.analysis_records import WhyNot
from nlpgrasp.solution.obstructions import TOLERANCE
from nlpgrasp.solution.quality_record import GlobalBound
from nlpgrasp.solution.records import StartRecord, Status
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.solution.start_summary import ipopt_lines
from nlpgrasp.version import __version__

VOLUME_ERROR = 0.02  # relative error bar of nu, for the objective nu
FINAL_GRACE = 2.0  # seconds, time for the answer's certificate after the time limit
MOST_COMPARED = 3  # grasps compared by robustness, including the best
HALF = 0.5  # share of the best mu below which no other grasp is chosen
NEARLY = 0.8  # share of the best mu below which no other grasp is chosen because its links' hulls are outside
WEAK = 0.5  # share of mu under the worst displacement below which more robust grasps are considered
TIE = 0.95  # least share of the best mu of a grasp that replaces one that is weak but not fragile, or deeper
SHALLOW = 3e-4  # metres: depth of a link's hull in the body up to which a fingertip is on the body
DISTINCT = 0.1  # over the body's size: Hausdorff distance of contacts above which grasps are distinct


@dataclass(frozen=True)
class SearchRecord:
    """Record of a search: its starts, bound and chosen start.

    Parameters
    ----------
    problem : GraspProblem
    options : SolveOptions
    seed : int
    results : sequence of StartResult
    cut_short : Status or None
        Status where the search ended before all starts were run.
    deadline : Deadline
    bound : GlobalBound or None
        Upper bound on mu over all placements.
    clock : Stopwatch
    chosen : StartGrasp or None
        The answer; None without a grasp.
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
    def records(self) -> tuple[StartRecord, ...]:
        """Records of all starts, in the order of ``results``."""
        return tuple(r.record for r in self.results)

    def raised_bound(self, lower: float) -> GlobalBound | None:
        """Return the global bound, raised to the certified lower bound of a grasp that exceeds it by rounding."""
        return None if self.bound is None else replace(self.bound, upper=max(self.bound.upper, lower))


def total_effort(results: Sequence[StartResult]) -> SolverEffort:
    """Return the solver effort of all starts together."""
    return sum((r.effort for r in results), SolverEffort())


def prefer_robust_start(
    compiled: CompiledProblem, best: StartGrasp, results: Sequence[StartResult], deadline: Deadline
) -> StartGrasp:
    """Return the best start, or a more robust start if displaced contacts cost the best one too much mu.

    A fragile best start is replaced by the first start, by decreasing mu, that is not fragile, has at least half its mu
    and more mu under the worst displacement. A start that is not fragile but keeps less than half of its mu is replaced
    in the same way by one with 0.95 of its mu. Two other starts are compared, and the best start as it was before it
    converged to its local optimum. The start returned has its robustness where that was computed.

    Parameters
    ----------
    compiled : CompiledProblem
    best : StartGrasp
        The start with the best mu, at its local optimum.
    results : sequence of StartResult
        Eligible starts, as they were before any converged.
    deadline : Deadline
    """
    with single_thread():
        best = with_robustness(compiled, best)
        if best.robust is None or best.robust.share(best.record.mu) >= WEAK:
            return best
        share = HALF if best.robust.is_fragile(best.record.mu) else TIE
        for other in _next_best(compiled, best, results, share):
            if deadline.should_stop():
                break
            start = with_robustness(compiled, other)
            if start.robust is None or start.robust.is_fragile(start.record.mu):
                continue
            if start.robust.mu.lower > best.robust.mu.upper:
                if other.record.index == best.record.index:
                    return keep_unconverged(compiled, start, FRAGILE_OPTIMUM)
                return converge_to_optimum(compiled, start, deadline)
    return best


def restrict_to_squeezable(
    hand: Hand | None, best: StartGrasp, results: Sequence[StartResult]
) -> tuple[StartGrasp, Sequence[StartResult]]:
    """Return the best start that can be squeezed, and all such starts.

    Its contacts can all press in balance; other grasps of a hand with joints exert the task only while it pushes into
    the fingers. Among these, starts are preferred in which no link's convex hull is inside the body: beside a fingertip
    it would take part of the fingers' forces in a simulation, and a fingertip's is off its contact. Both arguments are
    returned unchanged for hands without joints, if the best start has both properties, or if no start has them.

    Parameters
    ----------
    hand : Hand or None
    best : StartGrasp
        The start with the best mu.
    results : sequence of StartResult
        All starts; eligible are those with at least half of the best mu, where hulls are less than 1 mm inside with at
        least 0.8 of it, less than 0.3 mm with 0.95 of it.
    """
    if not isinstance(hand, PosedHand) or not hand.loaded_joints:
        return best, results

    if not can_press(best.on_body.grasp):
        best, results = _restrict(best, results, HALF)
    for depth, share in ((TOLERANCE, NEARLY), (SHALLOW, TIE)):
        if best.hull_depth > depth:
            best, results = _restrict(best, results, share, depth)
    return best, results


def _restrict(
    best: StartGrasp, results: Sequence[StartResult], share: float, depth: float = np.inf
) -> tuple[StartGrasp, Sequence[StartResult]]:
    """Return the best start that can be squeezed and has at least a share of the best mu, and all of them.

    The links' hulls are at most ``depth`` inside the body, metres. Both arguments are returned unchanged without any.
    """
    least_mu = share * best.record.mu.upper
    solved = [r for r in results if isinstance(r, StartGrasp) and r.solved and r.record.mu.lower >= least_mu]
    restricted = [r for r in solved if r.hull_depth <= depth and can_press(r.on_body.grasp)]
    best_restricted = best_of(restricted)
    return (best, results) if best_restricted is None else (best_restricted, restricted)


def with_robustness(compiled: CompiledProblem, start: StartGrasp) -> StartGrasp:
    """Return a start with its robustness, or with the error in its message if the robustness fails."""
    if start.robust is not None:
        return start
    robust, message = attempt(lambda: robustness(compiled, start.on_body.candidate, start.on_body.grasp))
    return replace(start, robust=robust).with_message(message and f"no robustness: {message}")


def _next_best(
    compiled: CompiledProblem, best: StartGrasp, results: Sequence[StartResult], share: float
) -> Iterator[StartGrasp]:
    """Yield the best start as it was before converging, then distinct starts in the order of decreasing mu.

    Starts with less than a fraction ``share`` of the best mu are left out.
    """
    least, chosen = share * best.record.mu.lower, [best]
    solved = [r for r in results if isinstance(r, StartGrasp) and r.solved]
    if best.optimum is not None:
        yield from (r for r in solved if r.record.index == best.record.index and r.optimum is None)
    for start in sorted(solved, key=lambda r: (-r.record.mu.upper, r.record.index)):
        if start.record.mu.lower < least or len(chosen) == MOST_COMPARED:
            break
        if all(_hausdorff_distance(start, other) > DISTINCT * compiled.scaling.length for other in chosen):
            chosen.append(start)
            yield start


def _hausdorff_distance(a: StartGrasp, b: StartGrasp) -> float:
    """Return the Hausdorff distance between the contacts of two grasps, metres."""
    p, q = a.on_body.grasp.points, b.on_body.grasp.points
    distances = np.linalg.norm(p[:, None] - q[None], axis=2)
    return float(max(np.max(np.min(distances, axis=1)), np.max(np.min(distances, axis=0))))


def make_answer(search: SearchRecord, why_not: WhyNot | None) -> GraspSolution:
    """Return the solution of a search, with or without a grasp."""
    return _solution_without_grasp(search, why_not) if search.chosen is None else _solution_of(search, search.chosen)


def _solution_without_grasp(search: SearchRecord, why_not: WhyNot | None) -> GraspSolution:
    """Return the solution of a search that found no grasp."""
    records = search.records
    failed = bool(records) and all(r.status is Status.FAILED for r in records)
    status = Status.FAILED if failed else Status.NO_GRASP
    if why_not is not None and why_not.locally_infeasible:
        status = Status.LOCALLY_INFEASIBLE
    problem = search.problem
    return GraspSolution(
        status=search.cut_short or status,
        name=problem.name,
        problem=problem.to_dict(),
        kind=problem.task.measure,
        bound=search.bound,
        why_not=why_not,
        starts=records,
    )


def _solution_of(search: SearchRecord, best: StartGrasp) -> GraspSolution:
    """Return the solution with a start's grasp: its narrowed certificate, finger forces and squeeze."""
    problem, on_body, grasp = search.problem, best.on_body, best.on_body.grasp
    budget = budget_at(problem, on_body.candidate)
    rtol, certified = search.options.final_rtol, best.record.mu
    if certified.gap > rtol:
        limit = search.deadline.certificate_deadline(FINAL_GRACE)
        certified = best.tighten_bounds(problem, rtol, search.seed, limit).record.mu
    search.clock.mark("certificate")
    exerted = compute_exerted_forces(problem, grasp, budget, certified)
    search.clock.mark("forces")
    bound = search.raised_bound(certified.lower)
    solution = GraspSolution(
        status=search.cut_short or _final_status(search.options, bound, certified.lower, best),
        name=problem.name,
        problem=problem.unchecked(force_budget=budget).to_dict(),
        grasp=grasp,
        faces=on_body.candidate.faces,
        mu=certified,
        kind=problem.task.measure,
        delta=delta_of(problem, certified),
        nu=None if problem.objective != "nu" else nu(grasp, problem.torque_scale or 1.0, VOLUME_ERROR),
        forces=exerted.forces,
        moments=exerted.moments,
        needed=exerted.needed,
        constraints=best.constraints,
        robust=None if best.robust is None else best.robust.beside(certified),
        bound=bound,
        kkt=best.kkt,
        hand=best.hand,
        surface=on_body.surface,
        starts=search.records,
        best_start=best.record.index,
        source=problem,
    )
    squeezed = add_grip(add_squeeze(solution, problem.hand), problem.hand)
    search.clock.mark("squeeze")
    return squeezed


def delta_of(problem: GraspProblem, certified: Bounds) -> Bounds | None:
    """Return the bounds on delta of a grasp for the objective delta; None for other objectives.

    For this objective mu is delta.
    """
    if problem.objective != "delta":
        return None
    return replace(certified, torque_scale=problem.torque_scale, kind="delta", task_beta=None)


def _final_status(options: SolveOptions, bound: GlobalBound | None, lower: float, best: StartGrasp) -> Status:
    """Return the status of a search with a grasp: ``TOUCHES``, ``OPTIMAL`` or ``SOLVED``.

    It is optimal if the grasp is within the requested gap of the global bound.
    """
    if best.record.status is Status.TOUCHES:
        return Status.TOUCHES
    is_closed = options.gap is not None and bound is not None and bound.gap(lower) <= options.gap
    return Status.OPTIMAL if is_closed else Status.SOLVED


def solver_record(
    options: SolveOptions,
    seed: int,
    effort: SolverEffort,
    seconds: float,
    certified: Bounds,
    stages: Mapping[str, float] | None = None,
) -> Json:
    """Return the solver's record as JSON data: seed, effort, wall time by stage, options and versions.

    Among the options ``final_rtol`` is the gap that the answer's certificate reached, where that is less.

    Warns
    -----
    UserWarning
        Where IPOPT did not run in some of its calls.
    """
    if certified.lower > 0.0:  # what ``verify`` takes for a recomputed certificate
        least = max(certified.gap, 0.05 * options.final_rtol)
        options = replace(options, final_rtol=min(options.final_rtol, least))
    record: Json = {
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
        record = {**record, "ipopt_failures": dict(effort.failures)}
        warn(*ipopt_lines(record))
    return record
