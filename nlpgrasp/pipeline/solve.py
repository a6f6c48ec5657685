"""Solve of a problem, stage after stage."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from nlpgrasp.analysis.analyse import check_hand
from nlpgrasp.common.deadline import InterruptHandler
from nlpgrasp.common.types import Json
from nlpgrasp.errors import InputError, NoGraspError
from nlpgrasp.optimize.compiled_problem import CompiledProblem
from nlpgrasp.optimize.distinct_grasps import ONE, KeepOptions
from nlpgrasp.optimize.options import SolveOptions, check_search
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

    Candidates come from random tuples of surface samples, whose contacts are exchanged one at a time; hands with a pose
    of their own do so over what their fingers reach from many palms. Each start refines its own candidates by cutting
    planes in a trust region, whose steps are quadratic programs of the program's linearisation with the Lagrangian's
    curvature, or IPOPT's where the program holds forces. Their ends are certified on the body itself, and the links of
    a hand are measured there. The answer is the start with the best certified bounds whose hand is free and comes to it
    freely, if any is. A branch and bound over all placements, where it covers the problem, bounds mu from above:
    ``solution.gap`` says how far the answer is from the best possible, at most, and with ``SolveOptions(gap=...)`` the
    search goes on until it is as close as that.
    The same seed gives the same answer with any number of workers (unless a time limit or Ctrl-C cuts the solve short).

    Parameters
    ----------
    problem : GraspProblem
        What is asked.
    starts : int
        At least 1.
    seed : int
        At least 0.
    options : SolveOptions, optional
        Everything else, with the package's defaults when left out.
    keep : int
        Most grasps that are kept, best first, in ``solution.grasps``; the first is the answer. Others are the distinct
        ones that starts ended with; where these are too few, grasps that the solve met besides, of at least half the
        mu of the best, which are no local optima.
    distinct : float
        How far apart grasps are that count as two: more than this share (above 0, at most 1) of the body's size, half
        the diagonal of its bounding box, from contact to contact however they are matched, turned and mirrored as the
        problem can be; or another pose of the hand.
    warm_starts : sequence of Grasp, FoundGrasp or GraspSolution
        Grasps known already, of the same body and kinds of contacts: each is certified for this problem as it is, and
        refined, in two more starts. The answer is no worse than any of them that keeps the constraints.
    progress : callable or bool, optional
        True writes a line to standard error when a start is done: how it ended, the best certified bounds so far, the
        time. A function is called instead with each finished start's record and these bounds. Silent by default.
    throw : bool
        Raise ``NoGraspError`` (which carries the result) when no grasp was found.

    Returns
    -------
    GraspSolution
        Also when no grasp was found: its status says what to do.

    Raises
    ------
    InputError
        Before any start, for arguments out of range.
    NoGraspError
        With ``throw``, when no grasp was found.

    Warns
    -----
    UserWarning
        Once, of a mesh whose smooth surface is far from it beside its walls or the hand's fingertips; once, where IPOPT
        did not run in some of its calls, with its own status.
    """
    if not isinstance(problem, GraspProblem):
        raise InputError("problem", problem, NO_PROBLEM)
    starts, seed, options = check_search(starts, seed, options)
    if options.edge_margin is not None:
        problem = replace(problem, edge_margin=options.edge_margin)
    check_json(problem.to_dict())
    check_hand("SolveOptions.analyses", options.analyses, problem.hand)
    warn_of_smoothing(problem.body, problem.hand)
    keeping = KeepOptions(keep, distinct)
    listener = progress_callback(progress, starts)
    known = check_warm_starts(problem, warm_starts)
    runner = StartRunner.with_kept_programs(problem, options.narrow(), starts)
    solution = _run(runner, seed, keeping, listener, known)
    runner.keep_programs()
    if throw and not solution.success:
        raise NoGraspError(solution.status.value, solution)
    return solution


def solve_again(compiled: CompiledProblem, starts: int, seed: int, keeping: KeepOptions = ONE) -> GraspSolution:
    """Solve the problem of a workbench in this process: what ``solve`` does, without building programs anew."""
    return _run(StartRunner(compiled.problem, compiled.options, starts, compiled), seed, keeping)


def _run(
    runner: StartRunner,
    seed: int,
    keeping: KeepOptions,
    progress: Progress | None = None,
    warm_starts: Sequence[KnownGrasp] = (),
) -> GraspSolution:
    """Run all stages of a search; Ctrl-C keeps what was found."""
    with tempfile.TemporaryDirectory(prefix="nlpgrasp-") as folder:
        search = Multistart(runner, seed, keeping, progress, Path(folder) / "stop")
        with InterruptHandler(search.deadline), single_thread():
            search.run_starts(warm_starts)
            search.close_gap()
            search.choose()
            return search.answer()


def check_json(data: Json) -> None:
    """Refuse, before anything is solved, a problem whose result could not be written."""
    try:
        json.dumps(data, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise InputError("problem", str(error), "parts that can be written as JSON") from None
