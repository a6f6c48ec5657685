"""One start of the search: initial NLPs of candidates, comparison in pairs, refinement and certificate.

The initial NLP brings each proposed candidate to exert the task, where it does not; two of these at a time are compared
after a few rounds of refinement. Then each is refined on the body, certified and measured, the better one first, until
a result is solved. With a hand that has a pose the candidates come from a race, need neither, and are polished
(``polish.py``), which ends at a local optimum.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from nlpgrasp.common.deadline import Deadline, Stopwatch
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.nlp import formulate
from nlpgrasp.nlp.formulation import has_closed_form
from nlpgrasp.optimize.candidate import GraspCandidate, SolverEffort
from nlpgrasp.optimize.compiled_problem import FEASIBLE, CompiledProblem
from nlpgrasp.optimize.grasp_on_body import GraspOnBody
from nlpgrasp.optimize.initial_nlp import ScoredCandidate, solve_initial_nlp
from nlpgrasp.optimize.local_search import RefinementResult, refine
from nlpgrasp.optimize.polish import polish
from nlpgrasp.optimize.processes import single_thread
from nlpgrasp.optimize.projection import fix_to_faces, fix_to_triangles, put_on_body
from nlpgrasp.optimize.propose import propose
from nlpgrasp.optimize.refine_on_body import advance_on_body, refine_on_body
from nlpgrasp.optimize.robustness import maximise_robustness
from nlpgrasp.optimize.start_result import SOLVER_ERRORS, StartGrasp, StartResult, best_of, format_error
from nlpgrasp.optimize.volume_ascent import largest_volumes, maximise_volume, sampled_volume
from nlpgrasp.quality import Bounds
from nlpgrasp.quality.measures import certify
from nlpgrasp.quality.provable_ends import ForceCones, provable_upper
from nlpgrasp.quality.wrench_set import WrenchSet
from nlpgrasp.solution.records import CandidateOrigin, StartRecord, Status

COMPARED = 2  # candidates compared after a few rounds of refinement; the best one is refined to its end
CLIMBING = 3  # candidates of which the volume is maximised
PROMISE = 0.8  # share of the mu before refinement on the body that a candidate is taken to keep at least
AS_RACED = "not polished"  # message of a start that is left where its race ended
MOST_COLLIDING = 4  # candidates that end in link collisions before a start gives up


def run_start(
    compiled: CompiledProblem,
    index: int,
    seed: int,
    deadline: Deadline,
    known_contacts: Sequence[FloatArray] = (),
    candidates: Sequence[GraspCandidate] = (),
    rtol: float | None = None,
    settles: bool = True,
) -> StartResult:
    """Run one start from given candidates, or from candidates proposed with the start's index and seed.

    Never raises for a numerical failure: the record carries the status and the message. Bad input does raise.
    Linear algebra runs on one thread, so that rounding does not depend on the number of cores.

    Parameters
    ----------
    compiled : CompiledProblem
    index, seed : int
    deadline : Deadline
    known_contacts : sequence of (k, space) array
        Contacts near which candidates are proposed as well, metres.
    candidates : sequence of GraspCandidate, optional
        The most promising first.
    rtol : float, optional
        Relative gap of certificates; that of the options if not given.
    settles : bool
        Whether a hand's candidates are polished to their local optimum.
    """
    clock = Stopwatch()
    with single_thread():
        try:
            rng = np.random.default_rng([seed, index])
            result = _best_of_candidates(
                compiled, index, rng, deadline, clock, known_contacts, candidates, rtol, settles
            )
        except SOLVER_ERRORS as error:
            return failed_start(index, error, clock.seconds)
    return replace(result, record=replace(result.record, seconds=clock.seconds))


def failed_start(index: int, error: Exception, seconds: Mapping[str, float] | None = None) -> StartResult:
    """Return the result of a start that ended by an error."""
    return StartResult(StartRecord(index, Status.FAILED, seconds=seconds or {}, message=format_error(error)))


def follow_with_hand(
    compiled: CompiledProblem, candidate: GraspCandidate, normals: FloatArray | None = None
) -> GraspCandidate:
    """Return a candidate with the hand's variables computed from its contacts.

    For hands that are determined by their contacts. Inward normals (k, space) are the body's if not given.
    """
    inward_normals = compiled.inward_normals(candidate) if normals is None else normals
    hand = compiled.hand_functions.start(candidate.points[None], inward_normals[None])
    return GraspCandidate(candidate.faces, candidate.points, {name: value[0] for name, value in hand.items()})


def _best_of_candidates(
    compiled: CompiledProblem,
    index: int,
    rng: np.random.Generator,
    deadline: Deadline,
    clock: Stopwatch,
    known_contacts: Sequence[FloatArray],
    candidates: Sequence[GraspCandidate],
    rtol: float | None,
    settles: bool,
) -> StartGrasp:
    """Return the best result over a start's candidates, with the total effort."""
    origin = CandidateOrigin.BOUND if known_contacts else CandidateOrigin.RANDOM
    if compiled.problem.objective == "nu":
        return _best_by_volume(compiled, index, candidates or propose(compiled, rng), rng, deadline, clock)
    proposed = candidates or propose(compiled, rng, known_contacts)
    refinement = _Refinement(compiled, index, origin, deadline, clock, rtol, settles)
    clock.mark("propose")
    if not compiled.follows_contacts:
        return _best_of_results(refinement.best_first([ScoredCandidate(raced, raced.promise) for raced in proposed]))
    results, unpromising, initial_effort = list[StartGrasp](), list[ScoredCandidate](), SolverEffort()
    initial_grasps = (solve_initial_nlp(compiled, candidate, rng) for candidate in proposed)
    batch = list[ScoredCandidate]()
    for count, initial in enumerate(initial_grasps, 1):
        initial_effort += initial.effort
        clock.mark("first program")
        (batch if initial.score > 0.0 else unpromising).append(initial)
        if len(batch) < COMPARED and count < len(proposed) and not deadline.should_stop():
            continue
        results += refinement.best_first(_sort_by_promise(compiled, batch, deadline))
        if deadline.should_stop() or _can_stop(results):
            break
        batch = []
    for initial in sorted(unpromising, key=lambda grasp: -grasp.score) if not results else ():
        results += refinement.best_first([initial])
        if deadline.should_stop() or results[-1].record.has_grasp:
            break
    best = _best_of_results(results)
    return replace(best, total_effort=best.total_effort + initial_effort)


def _best_by_volume(
    compiled: CompiledProblem,
    index: int,
    candidates: Sequence[GraspCandidate],
    rng: np.random.Generator,
    deadline: Deadline,
    clock: Stopwatch,
) -> StartGrasp:
    """Return the result of largest nu from the most promising of given and random candidates."""
    results = list[StartGrasp]()
    for candidate in largest_volumes(compiled, candidates, rng, CLIMBING):
        on_faces, snapped = fix_to_triangles(compiled, candidate)
        moved = maximise_volume(on_faces, snapped, deadline)
        on_body, refined = put_on_body(compiled, on_faces, moved), refine(on_faces, moved, deadline, rounds=0)
        clock.mark("refine")
        bounds = _certify_grasp(compiled, on_body, refined, deadline, compiled.options.final_rtol)
        clock.mark("certificate")
        origin = CandidateOrigin.RANDOM
        result = StartGrasp.of(compiled, index, on_body, bounds, refined.state(), origin.value, origin=origin)
        if bounds.lower < (compiled.problem.least_mu or 0.0):
            record = replace(result.record, status=Status.NO_GRASP, message=f"mu in {bounds}, below its floor")
            result = replace(result, record=record)
        results.append(replace(result, volume=float(np.exp(sampled_volume(compiled, on_body.grasp)))))
        if deadline.should_stop():
            break
    return _best_of_results(results)


def _sort_by_promise(
    compiled: CompiledProblem, batch: Sequence[ScoredCandidate], deadline: Deadline
) -> list[ScoredCandidate]:
    """Return candidates after a few rounds of refinement each, the best first; a single one unchanged."""
    if len(batch) < 2:
        return list(batch)
    advanced_grasps = [(initial, advance_on_body(compiled, initial.candidate, deadline)) for initial in batch]
    advanced_grasps.sort(key=lambda pair: -pair[1].point.value)
    return [
        replace(initial, candidate=advanced.point.candidate, score=advanced.point.value)
        for initial, advanced in advanced_grasps
    ]


def _grasp_of_program(
    compiled: CompiledProblem, candidate: GraspCandidate, deadline: Deadline
) -> tuple[GraspOnBody, RefinementResult]:
    """Return the grasp at which the program (3.5-4) ends from a candidate, and a search from there.

    Directions join until its beta is certified. On a mesh the contacts stay on their triangles. Steps follow under
    budgets other than L2: along fixed directions the program is loose at kinks of the support, where optima are.
    """
    on_faces, snapped = fix_to_faces(compiled, candidate)
    program = formulate(on_faces.problem, forces=not has_closed_form(on_faces.problem))
    start = {f"position {i}": point for i, point in enumerate(snapped.points)}
    options: dict[str, Any] = dict(compiled.options.ipopt)
    solved = program.solve(start, refine=True, rtol=compiled.options.final_rtol, **options)
    moved = follow_with_hand(on_faces, replace(snapped, points=solved.grasp.points))
    if on_faces.violation(moved) > FEASIBLE:  # IPOPT has left the constraints
        moved = snapped
    refined = refine(on_faces, moved, deadline, rounds=0 if compiled.cutting_planes.holds_supports else None)
    return put_on_body(compiled, on_faces, refined.point.candidate), refined


def _can_stop(results: Sequence[StartGrasp]) -> bool:
    """Return whether a start can end: a result is solved, or too many have colliding links."""
    return any(result.solved for result in results) or _count_colliding(results) >= MOST_COLLIDING


def _count_colliding(results: Sequence[StartGrasp]) -> int:
    """Return the number of results whose only flaw are colliding links."""
    return sum(result.record.status is Status.TOUCHES for result in results)


@dataclass(frozen=True)
class _Refinement:
    """Refinement of a start's candidates to certified grasps.

    Parameters
    ----------
    compiled : CompiledProblem
    index : int
        Of the start.
    origin : CandidateOrigin
    deadline : Deadline
    clock : Stopwatch
    rtol : float, optional
        Relative gap of certificates; that of the options if not given.
    settles : bool
    """

    compiled: CompiledProblem
    index: int
    origin: CandidateOrigin
    deadline: Deadline
    clock: Stopwatch
    rtol: float | None = None
    settles: bool = True

    def best_first(self, candidates: Sequence[ScoredCandidate]) -> list[StartGrasp]:
        """Return the results of candidates, sorted by their scores, until one is solved and no other promises more."""
        results = list[StartGrasp]()
        for initial in candidates:
            best = max((result.record.mu.lower for result in results if result.solved), default=0.0)
            if best > 0.0 and PROMISE * initial.score <= best:
                break
            results.append(self._certified_grasp(initial))
            if self.deadline.should_stop() or _count_colliding(results) >= MOST_COLLIDING:
                break
        return results

    def _certified_grasp(self, initial: ScoredCandidate) -> StartGrasp:
        """Return the grasp of a candidate, refined on the body, certified and measured."""
        compiled, message = self.compiled, initial.message or self.origin.value
        if not compiled.follows_contacts:
            polished = polish(compiled, initial.candidate, self.deadline, self.rtol, self.settles)
            self.clock.mark("refine")
            result = StartGrasp.at_optimum(compiled, self.index, polished, message, self.origin)
            self.clock.mark("link depth")
            return result if self.settles else replace(result.with_message(AS_RACED), is_settled=False)
        if compiled.options.method == "program":
            on_body, refined = _grasp_of_program(compiled, initial.candidate, self.deadline)
        else:
            on_body, refined = refine_on_body(compiled, initial.candidate, self.deadline)
        self.clock.mark("refine")
        robust = None
        if compiled.options.maximise_robust:
            on_body, robust = maximise_robustness(compiled, on_body, self.deadline)
            self.clock.mark("robust")
        bounds = _certify_grasp(compiled, on_body, refined, self.deadline, self.rtol)
        self.clock.mark("certificate")
        state = refined.state()
        return StartGrasp.of(compiled, self.index, on_body, bounds, state, message, origin=self.origin, robust=robust)


def _certify_grasp(
    compiled: CompiledProblem,
    on_body: GraspOnBody,
    result: RefinementResult,
    deadline: Deadline,
    rtol: float | None = None,
) -> Bounds:
    """Return the certified bounds of a grasp, with the upper bound tightened by known weak directions."""
    budget, time_limit = compiled.budget(on_body.candidate), deadline.certificate_deadline()
    rtol = rtol or compiled.options.rtol
    certificate, directions = result.certificate, result.point.minimisers
    if certificate is not None and certificate.belongs_to(on_body.grasp, budget):
        bounds = certificate.bounds(rtol, time_limit)
    else:
        bounds = certify(on_body.grasp, compiled.problem.task, rtol, budget, deadline=time_limit)
    wrenches = WrenchSet.of(on_body.grasp, budget)
    ratios = wrenches.support(directions)[0] if len(directions) else np.array([np.inf])
    y = directions[int(np.argmin(ratios))] if np.min(ratios) < bounds.upper else None
    upper = np.inf if y is None else provable_upper(wrenches, ForceCones.of(wrenches), y, compiled.problem.task)[0]
    return replace(bounds, upper=upper, worst_direction=y) if bounds.lower <= upper < bounds.upper else bounds


def _best_of_results(results: Sequence[StartGrasp]) -> StartGrasp:
    """Return the best of several results, collision-free ones first, with their total effort."""
    best = best_of(results) or max(results, key=lambda result: result.ranking_bounds.lower)
    return replace(best, total_effort=sum((result.effort for result in results), SolverEffort()))
