"""From a problem to its solution: starts, what is worth knowing after them, the answer."""

from __future__ import annotations

import json
import tempfile
import time
from collections.abc import Sequence
from dataclasses import replace
from itertools import chain
from pathlib import Path

from nlpgrasp.common.shown.said import warn
from nlpgrasp.common.stopping.interrupt import Interrupt
from nlpgrasp.common.stopping.stop import Stop
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import integer
from nlpgrasp.errors import InputError, NoGraspError
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.problem.smooth_surface import warn_of_smoothing
from nlpgrasp.quality import Bounds
from nlpgrasp.solution.records import Status
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.solve.after.look_back import Aftermath
from nlpgrasp.solve.analyse import check_hand
from nlpgrasp.solve.answer import Search, answer, solver_record
from nlpgrasp.solve.bounding import close_gap, why_not_bounded
from nlpgrasp.solve.many.collection import ONE, Collection, Keeping
from nlpgrasp.solve.options import SolveOptions
from nlpgrasp.solve.progress import Progress, told
from nlpgrasp.solve.squeeze import with_squeezes
from nlpgrasp.solve.start.result import StartGrasp, StartResult, best_of
from nlpgrasp.solve.start.warm_starts import WarmStart, check_warm_starts
from nlpgrasp.solve.workbench.clock import Clock
from nlpgrasp.solve.workbench.workbench import Workbench
from nlpgrasp.solve.workers.one_thread import one_thread
from nlpgrasp.solve.workers.pool import NOT_BEGUN, Runner

NO_PROBLEM = "a GraspProblem, such as ng.GraspProblem(body, contacts, task); nlpgrasp solve runs scripts"


def solve(
    problem: GraspProblem,
    starts: int = 8,
    seed: int = 0,
    options: SolveOptions | None = None,
    *,
    keep: int = 1,
    distinct: float = 0.1,
    warm_starts: Sequence[WarmStart] = (),
    progress: Progress | bool | None = None,
    throw: bool = False,
) -> GraspSolution:
    """Find the best grasp over several seeded starts and certify it.

    Starts exchange contacts of random tuples of surface samples one at a time; hands with a pose of their own
    compare random poses. Cutting planes in a trust region refine the best candidates: steps are quadratic programs of
    the program's linearisation with the Lagrangian's curvature, or IPOPT's where the program holds forces. Their ends
    are certified on the body itself, and the links of a hand are measured there. The answer
    is the start with the best certified bounds whose hand is free and comes to it freely, if any is. A branch and bound
    over all placements, where it covers the problem, bounds mu from above: ``solution.gap`` says how far the answer is
    from the best possible, at most, and with ``SolveOptions(gap=...)`` the search goes on until it is as close as that.
    The same seed gives the same answer with any number of workers (unless a time limit or Ctrl-C
    cuts the solve short).

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
    starts = integer("starts", starts, at_least=1, at_most=10**6)
    seed = integer("seed", seed, at_least=0, at_most=10**15)
    options = SolveOptions() if options is None else options
    if not isinstance(options, SolveOptions):
        raise InputError("options", options, "a SolveOptions, such as ng.SolveOptions(gap=0.02)")
    if options.edge_margin is not None:
        problem = replace(problem, edge_margin=options.edge_margin)
    check_json(problem.to_dict())
    check_hand("SolveOptions.analyses", options.analyses, problem.hand)
    warn_of_smoothing(problem.body, problem.hand)
    keeping = Keeping(keep, distinct)
    listener = told(progress, starts)
    known = check_warm_starts(problem, warm_starts)
    solution = _run(Runner(problem, options.narrow(), starts), seed, keeping, listener, known)
    if throw and not solution.success:
        raise NoGraspError(solution.status.value, solution)
    return solution


def solve_again(bench: Workbench, starts: int, seed: int, keeping: Keeping = ONE) -> GraspSolution:
    """Solve the problem of a workbench in this process: what ``solve`` does, without building programs anew."""
    return _run(Runner(bench.problem, bench.options, starts, bench), seed, keeping, None)


def _run(
    runner: Runner, seed: int, keeping: Keeping, progress: Progress | None, known: Sequence[WarmStart] = ()
) -> GraspSolution:
    """Run the starts, look back at them and put the answer together."""
    options = runner.options
    begun, clock = time.monotonic(), Clock()
    deadline = None if options.time_limit is None else begun + options.time_limit
    results: list[StartResult] = []
    with tempfile.TemporaryDirectory(prefix="nlpgrasp-") as folder:
        stop = Stop(deadline, Path(folder) / "stop")
        with Interrupt(stop) as interrupt, one_thread():
            if runner.tree is not None:
                runner.tree.grow(0)
            elif options.gap is not None:
                warn(f"gap: {why_not_bounded(runner.problem)}; the answer is the best of its starts")
            clock.mark("bound")
            for result in chain(runner.starts(seed, stop), runner.warm_starts(known, stop)):
                results.append(result)
                if progress is not None:
                    best = best_of(results)
                    progress(result.record, Bounds(0.0, float("inf")) if best is None else best.record.mu)
            results.sort(key=lambda r: r.record.index)
            begun_all = len(results) >= runner.count and all(r.record.message != NOT_BEGUN for r in results)
            clock.mark("starts")
            if options.gap is not None and runner.tree is not None:
                close_gap(runner.bench, runner.tree, results, seed, stop)
                clock.mark("closing the gap")
            cut_short = Status.INTERRUPTED if interrupt.caught else None if begun_all else Status.TIME_LIMIT
            best = best_of(results)
            choosing = runner.choose(best, results, stop)
            collection = Collection(runner, keeping, stop) if best is not None and keeping.count > 1 else None
            best = choosing()
            clock.mark("choice")
            best = _in_place(runner.at_local_optimum(best, stop), results)
            clock.mark("last step")
            best = runner.reachable(best, results, stop)
            clock.mark("way in")
            bound = runner.bound(best, stop)
            search = Search(runner.problem, options, seed, results, cut_short, deadline, bound, clock, best)
            clock.mark("bound")
            after = Aftermath()
            if not stop.requested() and any(isinstance(r, StartGrasp) for r in results):
                after = runner.look_back(best, results, seed, stop)
            clock.mark_with(after.seconds, "programs")
            if collection is not None and best is not None:
                collection.begin(best, results)
                clock.mark("other grasps")
            solution = answer(search, after)
            clock.mark("answer")
            solution, seconds = runner.analysed(solution, best, stop)
            clock.mark_with(seconds, "programs")
            if collection is not None:
                solution = replace(solution, others=collection.grasps())
                solution = with_squeezes(solution, runner.problem.hand)
                clock.mark("other grasps")
    record = solver_record(options, seed, search.effort, time.monotonic() - begun, clock.seconds)
    if keeping.count > 1:
        record |= {"keep": keeping.count, "distinct": keeping.distinct}
    return replace(solution, solver=record)


def _in_place(best: StartGrasp | None, results: list[StartResult]) -> StartGrasp | None:
    """Return the answer, put in the place of its start's result."""
    if best is not None:
        results[:] = [best if r.record.index == best.record.index else r for r in results]
    return best


def check_json(data: Json) -> None:
    """Refuse, before anything is solved, a problem whose result could not be written."""
    try:
        json.dumps(data, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise InputError("problem", str(error), "parts that can be written as JSON") from None
