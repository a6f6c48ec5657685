"""One start: candidates, of which the more promising one is refined on the body, certified and measured."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from nlpgrasp.common.deadline import Clock, Deadline
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.optimize.candidate import Effort, GraspCandidate
from nlpgrasp.optimize.compiled_problem import CompiledProblem
from nlpgrasp.optimize.grasp_on_body import GraspOnBody
from nlpgrasp.optimize.initial_nlp import InitialGrasp, solve_initial_nlp
from nlpgrasp.optimize.local_search import RefinementResult, refine
from nlpgrasp.optimize.processes import single_thread
from nlpgrasp.optimize.projection import fix_to_triangles
from nlpgrasp.optimize.propose import propose, touch_candidates
from nlpgrasp.optimize.refine import advanced_on_body, refine_on_body
from nlpgrasp.optimize.robustness import maximise_robustness
from nlpgrasp.optimize.start_result import SOLVER_ERRORS, StartGrasp, StartResult, best_of, format_error
from nlpgrasp.quality import Bounds, mu
from nlpgrasp.quality.wrench_set import WrenchSet
from nlpgrasp.solution.records import CandidateOrigin, StartRecord, Status

COMPARED = 2  # candidates compared after a few rounds of refinement; the best one is refined to its end
MOST_TOUCHING = 2  # candidates that end in link collisions before a start gives up


def run_start(
    compiled: CompiledProblem,
    index: int,
    seed: int,
    deadline: Deadline,
    known: Sequence[FloatArray] = (),
    candidates: Sequence[GraspCandidate] = (),
) -> StartResult:
    """Run start ``index`` from candidates, or from those that it proposes by index and seed, also near known contacts.

    Never raises for a numerical failure: the record carries the status and the message. Bad input does raise.
    Linear algebra runs on one thread, so that rounding does not depend on how many cores there are.

    Parameters
    ----------
    compiled : CompiledProblem
    index, seed : int
    deadline : Deadline
    known : sequence of (k, space) array
        Contacts that proposals begin from as well, metres.
    candidates : sequence of GraspCandidate, optional
        The most promising first.
    """
    clock = Clock()
    with single_thread():
        try:
            found = _best_of_candidates(
                compiled, index, np.random.default_rng([seed, index]), deadline, clock, known, candidates
            )
        except SOLVER_ERRORS as error:
            return failed(index, error, clock.seconds)
    return replace(found, record=replace(found.record, seconds=clock.seconds))


def failed(index: int, error: Exception, seconds: Mapping[str, float] | None = None) -> StartResult:
    """Return the result of a start that an error ended."""
    return StartResult(StartRecord(index, Status.FAILED, seconds=seconds or {}, message=format_error(error)))


def follow_with_hand(
    compiled: CompiledProblem, candidate: GraspCandidate, normals: FloatArray | None = None
) -> GraspCandidate:
    """Return a candidate with the hand's variables computed from its contacts, where they follow from these.

    Inward normals (k, space) are the body's where none are given.
    """
    inward = compiled.inward_normals(candidate) if normals is None else normals
    hand = compiled.hand_points.start(candidate.points[None], inward[None])
    return GraspCandidate(candidate.faces, candidate.points, {name: value[0] for name, value in hand.items()})


def _best_of_candidates(
    compiled: CompiledProblem,
    index: int,
    rng: np.random.Generator,
    deadline: Deadline,
    clock: Clock,
    known: Sequence[FloatArray],
    candidates: Sequence[GraspCandidate],
) -> StartGrasp:
    """Return the best result over a start's candidates, with the total effort."""
    origin = CandidateOrigin.BOUND if known else CandidateOrigin.RANDOM
    plain = (
        None if compiled.follows_contacts else compiled.with_l2_budget
    )  # poses are compared under the paper's budget
    proposed = candidates or propose(compiled, rng, known)
    if not compiled.follows_contacts:
        proposed = touch_candidates(plain or compiled, proposed, rng, deadline)
    clock.mark("propose")
    ends, left, programs = list[StartGrasp](), list[InitialGrasp](), Effort()
    firsts = (solve_initial_nlp(plain or compiled, candidate, rng) for candidate in proposed)
    batch = list[InitialGrasp]()
    for number, first in enumerate(firsts, 1):
        programs += first.effort
        clock.mark("first program")
        (batch if first.score > 0.0 else left).append(first)
        if len(batch) < COMPARED and number < len(proposed) and not deadline.is_requested():
            continue
        for one in _by_promise(plain or compiled, batch, deadline):
            ends.append(_result_of_candidate(compiled, index, one, origin, deadline, clock))
            if _has_enough(ends):
                break
        if deadline.is_requested() or _has_enough(ends):
            break
        batch = []
    for first in sorted(left, key=lambda one: -one.score) if not ends else ():
        ends.append(_result_of_candidate(compiled, index, first, origin, deadline, clock))
        if deadline.is_requested() or ends[-1].record.has_grasp:
            break
    best = _best_of_results(ends)
    return replace(best, spent=best.spent + programs)


def _by_promise(compiled: CompiledProblem, batch: Sequence[InitialGrasp], deadline: Deadline) -> list[InitialGrasp]:
    """Return candidates after a few rounds of refinement each, the best first; a single one as it is."""
    if len(batch) < 2:
        return list(batch)
    each = [(first, advanced_on_body(compiled, first.candidate, deadline)) for first in batch]
    each.sort(key=lambda one: -one[1].point.value)
    return [replace(first, candidate=advanced.point.candidate) for first, advanced in each]


def _refine_candidates(
    compiled: CompiledProblem, index: int, candidate: GraspCandidate, deadline: Deadline
) -> Iterator[tuple[GraspOnBody, RefinementResult]]:
    """Yield refined grasps; under other budgets than L2 some are refined under L2 first.

    The paper's support, a root of a sum of squares over the contacts, is smooth where those of other budgets have
    edges. Every other start goes that way, and with a hand that has a pose all, from its end as well as to there.
    """
    smooth = compiled.with_l2_budget if index % 2 or not compiled.follows_contacts else None
    if smooth is not None:
        found, there = refine_on_body(smooth, candidate, deadline)
        candidate = there.point.candidate
        if not compiled.follows_contacts:
            yield found, refine(*fix_to_triangles(compiled, candidate), deadline, rounds=0)
    yield refine_on_body(compiled, candidate, deadline)


def _has_enough(ends: Sequence[StartGrasp]) -> bool:
    """Return whether a candidate led to a feasible grasp, or too many to colliding links."""
    touching = sum(end.record.status is Status.TOUCHES for end in ends)
    return any(end.solved for end in ends) or touching >= MOST_TOUCHING


def _result_of_candidate(
    compiled: CompiledProblem,
    index: int,
    first: InitialGrasp,
    origin: CandidateOrigin,
    deadline: Deadline,
    clock: Clock,
) -> StartGrasp:
    """Return the best result of a candidate: refined, on the body, certified and measured."""
    ends, message = list[StartGrasp](), first.message or origin.value
    for found, refined in _refine_candidates(compiled, index, first.candidate, deadline):
        clock.mark("refine")
        robust = None
        if compiled.options.maximise_robust:
            found, robust = maximise_robustness(compiled, found)
            clock.mark("robust")
        bounds = _certify_grasp(compiled, found, refined, deadline)
        clock.mark("certificate")
        state = refined.state()
        ends.append(StartGrasp.of(compiled, index, found, bounds, state, message, origin=origin, robust=robust))
        clock.mark("link depth")
    return _best_of_results(ends)


def _certify_grasp(
    compiled: CompiledProblem, found: GraspOnBody, refined: RefinementResult, deadline: Deadline
) -> Bounds:
    """Return the certified bounds of a grasp, the upper one tightened by known weak directions."""
    budget, limit, rtol = compiled.budget(found.candidate), deadline.certificate_deadline(), compiled.options.rtol
    begun, weak = refined.certificate, refined.point.minimisers
    if begun is not None and begun.belongs_to(found.grasp, budget):
        bounds = begun.bounds(rtol, limit)
    else:
        bounds = mu(found.grasp, compiled.problem.task, rtol, force_budget=budget, deadline=limit)
    ratios = WrenchSet.of(found.grasp, budget).support(weak)[0] if len(weak) else np.array([np.inf])
    least = int(np.argmin(ratios))
    if not bounds.lower <= ratios[least] < bounds.upper:
        return bounds
    return replace(bounds, upper=float(ratios[least]), worst_direction=weak[least])


def _best_of_results(ends: Sequence[StartGrasp]) -> StartGrasp:
    """Return the best of several results, collision-free ones first, with their total effort."""
    best = best_of(ends) or max(ends, key=lambda end: end.rank.lower)
    return replace(best, spent=sum((end.effort for end in ends), Effort()))
