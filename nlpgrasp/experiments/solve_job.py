"""Jobs of worker processes: protocol, outcome, and the job of one solve."""

from __future__ import annotations

import threading
import uuid
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Protocol

import numpy as np

from nlpgrasp.analysis.jaw_diagnosis import with_usable_pads
from nlpgrasp.common.formatting import error_line
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.common.value_digest import UNIQUE
from nlpgrasp.errors import InputError
from nlpgrasp.experiments.experiment import Case, Experiment, SolveId
from nlpgrasp.optimize.compiled_problem import CompiledProblem
from nlpgrasp.optimize.parallel_starts import LazyCompiledProblem, StartRunner
from nlpgrasp.optimize.processes import WorkerPayload, single_thread
from nlpgrasp.optimize.start_result import StartGrasp, best_of
from nlpgrasp.optimize.warm_starts import WarmStart, adapt_grasp, certify_as_is, refine_warm_start
from nlpgrasp.pipeline.multistart import Multistart
from nlpgrasp.pipeline.solve import check_json, solve_compiled
from nlpgrasp.problem.identity import DIGEST_ENTRY
from nlpgrasp.quality import Bounds, screen
from nlpgrasp.quality.grasp import GraspStack
from nlpgrasp.solution.file import solution_json
from nlpgrasp.solution.kept_grasps import FoundGrasp
from nlpgrasp.solution.records import Status
from nlpgrasp.solution.solution import GraspSolution

LEAST_GAIN = 1e-3  # least relative excess of a better grasp's certified upper bound
LEAST_RTOL = 2e-4  # relative gap of a certificate that has to distinguish two grasps


_solver_lock = threading.Lock()  # IPOPT's linear solver is not thread-safe


class RunnableJob(Protocol):
    """Protocol of a job for a worker process."""

    @property
    def key(self) -> str:
        """Unique name of the job in the run."""

    def run(self) -> Outcome:
        """Run the job and return its outcome."""


def run_job(job: RunnableJob) -> Outcome:
    """Run a job and return its outcome.

    An error becomes the outcome's failure message.
    """
    with _solver_lock:
        try:
            return job.run()
        except BaseException as error:  # even SystemExit ends this job alone
            return Outcome(failure=error_line(error))


@dataclass(frozen=True)
class Job:
    """Job of one solve of an experiment.

    Parameters
    ----------
    solve : SolveId
    payload : WorkerPayload
        Data of the variation: workers keep the programs of the last variation.
    offer : WarmStartOffer, optional
        Grasps to compare with, for a finished solve.
    """

    solve: SolveId
    payload: WorkerPayload[LazyCompiledProblem[Case]]
    offer: WarmStartOffer | None = None

    @property
    def key(self) -> str:
        """Unique name of the job in the run."""
        suffix = "" if self.offer is None else f"-handed{self.offer.turn}"
        return f"nlpgrasp-{self.payload.token}-{self.solve.seed}{suffix}"

    def run(self) -> Outcome:
        """Solve the problem, or improve a finished solution by warm starts, and return the outcome."""
        lazy, offer, seed = self.payload.unpack(), self.offer, self.solve.seed
        compiled, starts = lazy.compiled, lazy.problem_with_options.starts
        digest = lazy.problem_with_options.digest
        if offer is not None:
            improved = improve_solution(compiled, starts, offer.solution, seed, offer.offers, offer.improve)
            # an outcome without text: no offered grasp is better
            return Outcome() if improved is None else Outcome(_solution_text(improved, digest))
        solution = solve_compiled(compiled, starts, seed, lazy.problem_with_options.keeping)
        if solution.status is Status.INTERRUPTED:
            return Outcome(interrupted=True)
        return Outcome(_solution_text(solution, digest))


def _solution_text(solution: GraspSolution, digest: str) -> str:
    """Return the text of a solution file that states the digest of its problem."""
    return solution_json(replace(solution, solver={**solution.solver, DIGEST_ENTRY: digest}).to_dict())


@dataclass(frozen=True)
class Outcome:
    """Outcome of one solve, or of one unit of a data set.

    Parameters
    ----------
    text : str
        The solution file; empty if the solve failed, or warm starts did not change it.
    failure : str
        Why it failed, in one line.
    interrupted : bool
        Whether the user interrupted it, so that it counts as not done.
    content : bytes
        The rows of a unit, as the content of a file.
    """

    text: str = ""
    failure: str = ""
    interrupted: bool = False
    content: bytes = b""


class JobFactory:
    """Factory of an experiment's jobs, which pickles each variation once for successive jobs.

    Parameters
    ----------
    experiment : Experiment
    digests : mapping of str to str
        Of the identity of each variation; one that is a function has none before it is called.
    compared : bool
        Whether variations, and then their starts, are compared by mu.
    """

    def __init__(self, experiment: Experiment, digests: Mapping[str, str], compared: bool = True) -> None:
        self.experiment, self.digests, self._compared = experiment, digests, compared
        self._run = uuid.uuid4().hex
        self._last: tuple[str, WorkerPayload[LazyCompiledProblem[Case]]] | None = None

    def __call__(self, solve: SolveId) -> Job:
        """Return the job of a solve.

        Raises
        ------
        InputError
            When the variation has parts that cannot be sent to another process.
        """
        name = solve.variation
        if self._last is None or self._last[0] != name:
            try:
                digest, once = self.digests.get(name, ""), f"{UNIQUE}{self._run}"
                make = partial(_worker_case, self.experiment.maker(name), self._compared, digest, once)
                payload = WorkerPayload.of(LazyCompiledProblem(make), f"{self._run} {name}")
            except Exception as error:  # any error of the parts' own pickling
                reason = error_line(error)
                raise InputError(f"variation {name!r}", reason, "parts that can be sent to other processes") from None
            self._last = (name, payload)
        return Job(solve, self._last[1])


@dataclass(frozen=True)
class WarmStartOffer:
    """Finished solution, and grasps of other variations offered as warm starts for it.

    Parameters
    ----------
    solution : GraspSolution
        Solution of the solve.
    offers : mapping of str to FoundGrasp
        Grasps of other variations, by their origin as text.
    improve : bool
        Whether to refine the best of them.
    turn : int
        Number of earlier exchanges.
    """

    solution: GraspSolution
    offers: Mapping[str, FoundGrasp]
    improve: bool
    turn: int


def _worker_case(maker: Callable[[], Case], compared: bool, digest: str, once: str) -> Case:
    """Create the case of a job in a worker, with options for a single process.

    Raises if the case is not JSON data.

    Parameters
    ----------
    maker : callable
    compared : bool
        As in ``JobFactory``.
    digest : str
        Of its identity; empty where the case is not known before.
    once : str
        Digest for this run of a case that cannot be compared.
    """
    case = maker()
    check_json(case.problem.to_dict())
    if not digest:
        identity = case.identity()
        digest = once if identity.obstacle else identity.digest
    options = case.options.narrow()
    options = replace(options, rank="mu") if compared else options
    return replace(case, problem=with_usable_pads(case.problem), options=options, digest=digest)


def improve_solution(
    compiled: CompiledProblem,
    starts: int,
    solution: GraspSolution,
    seed: int,
    offers: Mapping[str, FoundGrasp],
    improve: bool,
) -> GraspSolution | None:
    """Return a solution improved by the best of the offered grasps; ``None`` if no offered grasp is better.

    The grasp is also refined where ``improve`` is set. Each is certified under the compiled problem's own contacts,
    task, constraints and budget. One is taken if its certified upper bound exceeds the solution's by more than
    rounding, or by anything if the other problem's lower bound does: then no offered grasp contradicts that a more
    demanding problem is no better. The new certified bounds are never below the old. With starts compared by their
    worst case (``maximise_robust``) nothing is taken.

    Parameters
    ----------
    compiled : CompiledProblem
    starts : int
        Number of starts of the solution's solve.
    solution : GraspSolution
        Solution of the compiled problem.
    seed : int
        Seed of the solution.
    offers : mapping of str to FoundGrasp
        Grasps of problems with the same body, certified there, by their origin as text.
    improve : bool
        Whether to refine the taken grasp.
    """
    if compiled.options.maximise_robust:
        return None
    search = Multistart.resume(StartRunner(compiled.problem, compiled.options, starts, compiled), solution, seed)
    incumbent = solution.mu if solution.success else Bounds(0.0, 0.0)
    with single_thread():
        chosen = _choose_offer(compiled, search.next_index, incumbent, offers)
        if chosen is None:
            return None
        warm_start, certified = chosen
        grasps, refined = [certified], None
        if improve:
            refined = refine_warm_start(compiled, warm_start, search.next_index + 1, search.deadline)
        if refined is not None:
            grasps.append(_certify_above(compiled, refined, incumbent.lower))
        search.results += grasps
        best = best_of([grasp for grasp in grasps if _is_no_worse(grasp.record.mu, incumbent)])
        if best is None:
            return None
        search.accept_unchanged(best)
        answer = search.answer()
    return answer if _is_no_worse(answer.mu, incumbent) else None


def _is_no_worse(bounds: Bounds, incumbent: Bounds) -> bool:
    """Return whether neither bound is below that of the incumbent."""
    return bounds.lower >= incumbent.lower and bounds.upper >= incumbent.upper


def _choose_offer(
    compiled: CompiledProblem, index: int, incumbent: Bounds, offers: Mapping[str, FoundGrasp]
) -> tuple[WarmStart, StartGrasp] | None:
    """Return the best offered grasp above the incumbent, as a warm start and as a certified result, or ``None``."""
    best = None
    for warm_start, bounds_elsewhere in _screen_offers(compiled, offers, incumbent.upper):
        certified = certify_as_is(compiled, warm_start, index)
        margin = 0.0 if bounds_elsewhere.lower > incumbent.upper else LEAST_GAIN
        if certified is not None and certified.record.mu.upper > (1.0 + margin) * incumbent.upper:
            certified = _certify_above(compiled, certified, incumbent.lower)
            if certified.record.mu.lower >= incumbent.lower:
                best, incumbent = (warm_start, certified), certified.record.mu
    return best


def _certify_above(compiled: CompiledProblem, grasp: StartGrasp, lower: float) -> StartGrasp:
    """Certify a grasp tightly enough that its lower bound exceeds ``lower``, if its quality does."""
    rtol = compiled.options.final_rtol
    if lower > 0.0:
        rtol = min(rtol, max(0.5 * (grasp.record.mu.upper / lower - 1.0), LEAST_RTOL))
    return grasp.tighten_bounds(compiled.problem, rtol)


def _screen_offers(
    compiled: CompiledProblem, offers: Mapping[str, FoundGrasp], threshold: float
) -> Iterator[tuple[WarmStart, Bounds]]:
    """Yield offered grasps whose mu may exceed ``threshold``, each with its bounds in the variation that found it.

    Grasps that do not fit the problem are left out. Upper bounds by screening decide; the largest comes first.
    """
    adapted = []
    for origin, grasp in offers.items():
        warm_start = adapt_grasp(compiled, grasp, origin)
        if warm_start:
            adapted.append((warm_start, grasp.mu))
    if not adapted:
        return
    upper_bounds = np.full(len(adapted), np.inf)
    if not compiled.problem.budget.depends_on_frames:
        points = np.stack([warm_start.candidate.points for warm_start, _ in adapted])
        normals = np.stack([_warm_start_normals(compiled, warm_start) for warm_start, _ in adapted])
        stack = GraspStack(points, normals, compiled.problem.models, compiled.problem.origin)
        upper_bounds = screen(stack, compiled.problem.task, force_budget=compiled.problem.budget)
    for i in np.argsort(-upper_bounds, kind="stable"):
        if upper_bounds[i] > threshold:
            yield adapted[int(i)]


def _warm_start_normals(compiled: CompiledProblem, warm_start: WarmStart) -> FloatArray:
    """Return the inward normals of a warm start, from the surface for contacts that state none."""
    return np.where(np.isnan(warm_start.normals), compiled.inward_normals(warm_start.candidate), warm_start.normals)
