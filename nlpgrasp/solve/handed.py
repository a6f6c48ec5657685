"""A solution and grasps that other problems' solutions hold: the better one of them, improved from there."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from nlpgrasp.common.stopping.stop import Stop
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import InputError
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.grasp.stack import GraspStack
from nlpgrasp.hands import PosedHand
from nlpgrasp.quality import Bounds, mu, screen
from nlpgrasp.solution.records import Status
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.solve.after.look_back import look_back
from nlpgrasp.solve.analyse import analyses_of, asked, with_analyses
from nlpgrasp.solve.answer import Search, answer, solver_record
from nlpgrasp.solve.ascent.state import Effort
from nlpgrasp.solve.start.added import with_more
from nlpgrasp.solve.start.given import Given, run_given
from nlpgrasp.solve.start.result import StartGrasp, StartResult, best_of
from nlpgrasp.solve.workbench.placed import Placed
from nlpgrasp.solve.workbench.workbench import Workbench
from nlpgrasp.solve.workers.one_thread import one_thread

TOLD = 1e-3  # relative: from there on a certified upper bound is that of a better grasp rather than of another rounding
FINEST = 2e-4  # relative gap of a certificate that has to tell two grasps apart


@dataclass(frozen=True)
class Offer:
    """A grasp that another problem's solution holds, of the same body.

    Parameters
    ----------
    origin : str
        Where it is from, for messages.
    grasp : Grasp
    faces : tuple of k str
        The face each contact is on.
    hand : mapping or None
        The hand there, as the solution states it.
    mu : Bounds
        Certified, for the other problem.
    """

    origin: str
    grasp: Grasp
    faces: tuple[str, ...]
    hand: Json | None
    mu: Bounds


def improved_by(
    bench: Workbench, own: GraspSolution, seed: int, offers: Sequence[Offer], improve: bool
) -> GraspSolution | None:
    """Return the solution with the best of some grasps offered, and improved from there; None where none is better.

    Each is certified under the workbench's own contacts, task, constraints and budget. One is taken where its certified
    upper bound is above the solution's by more than rounding, or at all where the other problem's lower bound is:
    afterwards no grasp that was offered refutes that the other problem, where it asks for more, is no better. The new
    certified bounds are never below the old. Where starts are compared by their worst placement (``maximise_robust``)
    nothing is taken.

    Parameters
    ----------
    bench : Workbench
    own : GraspSolution
        Of the workbench's problem.
    seed : int
        Of the solution.
    offers : sequence of Offer
        Of the same body.
    improve : bool
        Whether to go on with the exchange from what is taken; else it stays where it is.
    """
    if bench.options.maximise_robust:
        return None
    begun, limit = time.monotonic(), bench.options.time_limit
    stop = Stop(None if limit is None else begun + limit)
    with one_thread():
        taken = _best(bench, own, offers, stop)
        if taken is None:
            return None
        given, found = taken
        results: list[StartResult] = [found]
        if improve:
            results += run_given(bench, given, found.record.index, stop)[1:]
        for tried in (results, [found]):
            solution = _answer(bench, own, seed, tried, stop, begun)
            if solution.mu.lower >= _known(own).lower and solution.mu.upper >= _known(own).upper:
                return _analysed(bench, solution, best_of(tried), stop)
    return None


def _analysed(bench: Workbench, solution: GraspSolution, best: StartGrasp | None, stop: Stop) -> GraspSolution:
    """Return a solution with the analyses that the options ask for."""
    if best is None:
        return solution
    found, _ = analyses_of(bench, best, asked(bench.options, solution, bench.problem.hand), stop)
    return with_analyses(solution, found, bench.problem.hand)


def _known(own: GraspSolution) -> Bounds:
    return own.mu if own.success else Bounds(0.0, 0.0)


def _best(bench: Workbench, own: GraspSolution, offers: Sequence[Offer], stop: Stop) -> tuple[Given, StartGrasp] | None:
    """Return what is offered that is better than the solution, and the best."""
    index, best, least = max((s.index for s in own.starts), default=-1) + 1, None, _known(own)
    for offer, given in _promising(bench, offers, least.upper):
        found = next(iter(run_given(bench, given, index, stop, improve=False)), None)
        if isinstance(found, StartGrasp) and found.solved and _better(found.record.mu, least, offer.mu):
            found = _told_apart(bench, found, least.lower)
            if found.record.mu.lower >= least.lower:
                best, least = (given, found), found.record.mu
    return best


def _better(found: Bounds, known: Bounds, elsewhere: Bounds) -> bool:
    margin = 0.0 if elsewhere.lower > known.upper else TOLD
    return found.upper > (1.0 + margin) * known.upper


def _told_apart(bench: Workbench, found: StartGrasp, least: float) -> StartGrasp:
    """Return a grasp certified so finely that its lower bound is above that of a worse one."""
    known, placed = found.record.mu, found.found.placed
    rtol = bench.options.final_rtol
    if least > 0.0:
        rtol = min(rtol, max(0.5 * (known.upper / least - 1.0), FINEST))
    fine = mu(found.found.grasp, bench.problem.task, rtol, force_budget=bench.budget(placed))
    bounds = Bounds(max(known.lower, fine.lower), min(known.upper, fine.upper), fine.worst_direction)
    return replace(found, record=replace(found.record, mu=bounds))


def _promising(bench: Workbench, offers: Sequence[Offer], least: float) -> Iterator[tuple[Offer, Given]]:
    """Yield the offers that fit the problem, and that an upper bound on their mu does not leave out."""
    fitting = [(o, given) for o in offers if (given := _given(bench, o)) is not None]
    if not fitting:
        return
    bound = np.full(len(fitting), np.inf)
    if not bench.problem.budget.depends_on_frames:
        points = np.stack([given.placed.points for _, given in fitting])
        normals = np.stack([_normals(bench, given) for _, given in fitting])
        stack = GraspStack(points, normals, bench.problem.models, bench.problem.origin)
        bound = screen(stack, bench.problem.task, force_budget=bench.problem.budget)
    for i in np.argsort(-bound, kind="stable"):
        if bound[i] > least:
            yield fitting[int(i)]


def _normals(bench: Workbench, given: Given) -> FloatArray:
    looked_up = bench.inward_normals(given.placed)
    return np.where(np.isnan(given.normals), looked_up, given.normals)


def _given(bench: Workbench, offer: Offer) -> Given | None:
    """Return an offer as a grasp of the problem; None where its contacts or its hand do not fit."""
    hand, models = bench.problem.hand, bench.problem.models
    if isinstance(hand, PosedHand):
        if offer.hand is None or len(offer.grasp) != len(models):
            return None
        try:
            known = hand.values_at(offer.hand, offer.grasp.points)
        except InputError:
            return None
        values = {v.name: known[v.name] for v in hand.variables(bench.problem.body.bounds)}  # in the program's order
        given: Given | None = Given(Placed(offer.faces, offer.grasp.points, values), offer.grasp.normals)
    else:
        given = with_more(bench, offer.grasp, offer.faces)
        if given is None and len(offer.grasp) == len(models):
            points, normals = offer.grasp.points, offer.grasp.normals
            values = bench.hand_points.start(points[None], normals[None])
            there = Placed(offer.faces, points, {name: value[0] for name, value in values.items()})
            given = Given(there, normals)
    return None if given is None else replace(given, origin=offer.origin)


def _answer(
    bench: Workbench,
    own: GraspSolution,
    seed: int,
    results: Sequence[StartResult],
    stop: Stop,
    begun: float,
) -> GraspSolution:
    """Return the answer from a solution's own starts and those from grasps offered."""
    best = best_of(results)
    after = look_back(bench, best, results, seed, stop)
    own_starts = [StartResult(record) for record in own.starts]
    cut_short = own.status if own.status is Status.TIME_LIMIT else None
    bound = None if own.bound is None else replace(own.bound, stated_gap=None)  # the gap was to another grasp
    search = Search(bench.problem, bench.options, seed, [*own_starts, *results], cut_short, bound=bound)
    before = own.solver.get("seconds", {})
    effort = search.effort + Effort(
        int(own.solver.get("iterations", 0)),
        float(before.get("ipopt", 0.0)),
        float(before.get("functions", 0.0)),
        int(own.solver.get("ipopt_calls", 0)),
        dict(own.solver.get("ipopt_failures", {})),
    )
    seconds = time.monotonic() - begun + float(before.get("total", 0.0))
    return replace(answer(search, after), solver=solver_record(bench.options, seed, effort, seconds))
