"""``ng.solve``: search for the best grasp of a problem in stages.

- compile, ``optimize/compiled_problem.py``: programs, constraint functions, surface samples, shared by all starts
- root bound, ``global_bound/branch_and_bound.py``: upper bound on mu over all placements, without branching
- propose, ``optimize/propose.py``: candidates, by coordinate exchange of contacts over surface samples
- refine, ``optimize/refine_on_body.py``: local search by cutting planes, with a certificate for each start; with a hand
  that has a pose ``optimize/polish.py``
- close gap: branch and bound in turn with further starts, where a gap is requested
- choose, ``pipeline/answer.py``: the answer among the starts, at its KKT point (``optimize/local_convergence.py``)
- bound, ``global_bound/branch_and_bound.py``: a short branch and bound, where no gap is requested
- certify, ``quality/sandwich.py``: narrow bounds on the answer's mu, and its least finger forces
- analyse, ``analysis/analyse.py``: shadow prices, robustness and other analyses, on request

``_run`` calls them; ``pipeline/multistart.py`` has one method for each, and their state.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from nlpgrasp.analysis.analyse import check_possible
from nlpgrasp.analysis.jaw_diagnosis import with_usable_pads
from nlpgrasp.common.deadline import InterruptHandler
from nlpgrasp.common.types import Json
from nlpgrasp.errors import InputError, NoGraspError
from nlpgrasp.hands import PosedHand
from nlpgrasp.optimize.compiled_problem import CompiledProblem
from nlpgrasp.optimize.distinct_grasps import ONE, KeepOptions
from nlpgrasp.optimize.options import SolveOptions, check_solve_arguments
from nlpgrasp.optimize.parallel_starts import StartRunner
from nlpgrasp.optimize.processes import single_thread
from nlpgrasp.optimize.warm_starts import KnownGrasp, check_warm_starts
from nlpgrasp.pipeline.multistart import Multistart, Progress, progress_callback
from nlpgrasp.problem.checks import warn_of_smoothing
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.solution.solution import GraspSolution

NO_PROBLEM = "a GraspProblem, such as ng.GraspProblem(body, contacts, task); nlpgrasp solve runs scripts"


def solve(
    problem: GraspProblem,
    starts: int = 8,
    seed: int = 0,
    options: SolveOptions | None = None,
    *,
    keep: int = 1,
    distinct: float = 0.1,
    warm_starts: Sequence[KnownGrasp] = (),
    progress: Progress | bool | None = None,
    throw: bool = False,
) -> GraspSolution:
    """Find the best grasp over several seeded starts and certify it.

    Candidates come from coordinate exchange over surface samples; for a hand with a pose of its own, from a race of its
    postures. Each start refines its candidates by cutting planes in a trust region and certifies the result on the body
    itself; of eight starts of such a hand the four most promising are refined, unless several grasps are kept, and the
    others where they become the answer. That is the start with the best certified bounds whose hand and its approach
    are free of collision, if there is one. A branch and bound, where it covers the problem, bounds mu over all
    placements: ``solution.gap`` is the relative distance of the answer from the best possible, at most, and with
    ``SolveOptions(gap=...)`` the search continues until it is that small.
    The same seed gives the same answer with any number of workers (unless a time limit or Ctrl-C cuts the solve short).

    Parameters
    ----------
    problem : GraspProblem
        Body, contacts, task, and optional parts.
    starts, seed : int
        At least 1; at least 0.
    options : SolveOptions, optional
        Further options; the package's defaults when left out.
    keep : int
        Number of grasps in ``solution.grasps``, at most, best first; the first is the answer. The others are distinct
        results of the starts; where these are too few, unrefined candidates of at least half the best mu.
    distinct : float
        Least distance between kept grasps over the body's size (half the diagonal of its bounding box), above 0, at
        most 1: the largest distance of matched contacts under any matching and symmetry; or another pose of the hand.
    warm_starts : sequence of Grasp, FoundGrasp or GraspSolution
        Known grasps of the same body and kinds of contacts: each is certified for this problem as it is, and refined,
        in two further starts. The answer is no worse than any of them that is feasible.
    progress : callable or bool, optional
        True writes a line to standard error after each start: its status, the best bounds so far, the time. A function
        is called instead with the start's record and these bounds. Silent by default.
    throw : bool
        Raise ``NoGraspError`` (which carries the solution) when there is no grasp.

    Returns
    -------
    GraspSolution
        Also when there is no grasp: its status says why.

    Raises
    ------
    InputError
        Before any start, for arguments out of range.
    NoGraspError
        With ``throw``, when there is no grasp.

    Warns
    -----
    UserWarning
        Once, for a mesh whose smoothed surface is far from it compared with its walls or the hand's fingertips; once,
        where IPOPT did not run in some of its calls, with its status.
    """
    if not isinstance(problem, GraspProblem):
        raise InputError("problem", problem, NO_PROBLEM)
    starts, seed, options = check_solve_arguments(starts, seed, options)
    if options.edge_margin is not None:
        problem = replace(problem, edge_margin=options.edge_margin)
    check_json(problem.to_dict())
    check_possible("SolveOptions.analyses", options.analyses, problem.models, problem.hand)
    warn_of_smoothing(problem.body, problem.hand)
    keeping = KeepOptions(keep, distinct)
    callback = progress_callback(progress, starts)
    problem = with_usable_pads(problem)
    known_grasps = check_warm_starts(problem, warm_starts)
    check_objective(problem, options, keep, len(known_grasps))
    check_method(problem, options)
    if problem.objective == "nu" and problem.least_mu is None:
        problem = _with_floor_of_mu(problem, starts, seed, options)
    runner = StartRunner.with_kept_programs(problem, options.narrow(), starts)
    solution = _run(runner, seed, keeping, callback, known_grasps)
    runner.keep_programs()
    if throw and not solution.success:
        raise NoGraspError(solution.status.value, solution)
    return solution


def solve_compiled(compiled: CompiledProblem, starts: int, seed: int, keeping: KeepOptions = ONE) -> GraspSolution:
    """Return the solution of a compiled problem, as ``solve`` finds it, in this process."""
    return _run(StartRunner(compiled.problem, compiled.options, starts, compiled), seed, keeping)


def _run(
    runner: StartRunner,
    seed: int,
    keeping: KeepOptions,
    progress: Progress | None = None,
    warm_starts: Sequence[KnownGrasp] = (),
) -> GraspSolution:
    """Run all stages of a search and return the solution; Ctrl-C ends it with the best grasp so far."""
    with tempfile.TemporaryDirectory(prefix="nlpgrasp-") as folder:
        search = Multistart(runner, seed, keeping, progress, Path(folder) / "stop")
        with InterruptHandler(search.deadline), single_thread():
            search.compile()
            search.begin_bound()
            search.run_candidates(search.propose(), warm_starts)
            search.close_gap()
            search.choose()
            solution = search.certify(search.bound())
            return search.analyse(solution)


def _with_floor_of_mu(
    problem: GraspProblem, starts: int, seed: int, options: SolveOptions, share: float = 0.1
) -> GraspProblem:
    """Return a problem of the objective nu with a share of the largest mu that a search finds as its floor of mu."""
    by_mu = replace(problem, task=problem.stated_task, objective="mu", torque_scale=None)
    largest = solve(by_mu, starts, seed, replace(options, rank="mu", global_bound=False)).mu.lower
    return replace(problem, least_mu=share * largest) if largest > 0.0 else problem


def check_objective(problem: GraspProblem, options: SolveOptions, keep: int, warm_starts: int) -> None:
    """Raise an ``InputError`` for options that the objective nu does not have."""
    requested = {
        "gap": options.gap is not None,
        "maximise_robust": options.maximise_robust,
        "keep": keep > 1,
        "warm_starts": warm_starts > 0,
        'the method "program"': options.method == "program",
        'the analysis "prices"': options.extras or "prices" in options.analyses,
    }
    if problem.objective == "nu" and any(requested.values()):
        name = next(name for name, is_requested in requested.items() if is_requested)
        raise InputError("GraspProblem.objective", f"nu with {name}", "mu or delta for it")


def check_method(problem: GraspProblem, options: SolveOptions) -> None:
    """Raise an ``InputError`` where the method "program" would not know a hand's links."""
    if options.method == "program" and isinstance(problem.hand, PosedHand):
        allowed = "'steps', which ends with a hand's links at a KKT point of the program as well"
        raise InputError("SolveOptions.method", "'program' for a hand that has a pose", allowed)


def check_json(data: Json) -> None:
    """Raise an ``InputError`` for a problem that cannot be written as JSON."""
    try:
        json.dumps(data, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise InputError("problem", str(error), "parts that can be written as JSON") from None
