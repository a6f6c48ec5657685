"""One start of the search: initial NLPs of candidates, comparison in pairs, refinement and certificate.

With a hand that has a pose the candidates come from a race; the best one is refined with the samples of its links near
the body as constraints. For other problems the initial NLP brings each proposed candidate to exert the task, where it
does not; two of these at a time are compared after a few rounds of refinement. Then each is refined on the body,
certified and measured, the better one first, until a result is solved.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from nlpgrasp.common.deadline import Deadline, Stopwatch
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.hands.urdf_hand import LinkConstraints
from nlpgrasp.optimize.added_clearance import AddedClearance
from nlpgrasp.optimize.candidate import GraspCandidate, SolverEffort
from nlpgrasp.optimize.compiled_problem import CompiledProblem
from nlpgrasp.optimize.cutting_planes import weakest_directions_of
from nlpgrasp.optimize.grasp_on_body import GraspOnBody
from nlpgrasp.optimize.hand_race import points_near_body
from nlpgrasp.optimize.initial_nlp import ScoredCandidate, solve_initial_nlp
from nlpgrasp.optimize.local_search import RefinementResult, refine
from nlpgrasp.optimize.processes import single_thread
from nlpgrasp.optimize.projection import fix_to_triangles, put_on_body
from nlpgrasp.optimize.propose import propose
from nlpgrasp.optimize.refine_on_body import advance_on_body, refine_on_body, refine_on_triangles
from nlpgrasp.optimize.robustness import maximise_robustness
from nlpgrasp.optimize.start_result import SOLVER_ERRORS, StartGrasp, StartResult, best_of, format_error
from nlpgrasp.optimize.volume_ascent import largest_volumes, maximise_volume, sampled_volume
from nlpgrasp.quality import Bounds
from nlpgrasp.quality.measures import certify
from nlpgrasp.quality.provable_ends import ForceCones, provable_upper
from nlpgrasp.quality.wrench_set import WrenchSet
from nlpgrasp.solution.records import CandidateOrigin, StartRecord, Status

MOST_CLEARANCES = 6  # refinements that move links off what they penetrate, at most
WORTH_FREEING = 0.8  # least mu without the penetration over that with it
COMPARED = 2  # candidates compared after a few rounds of refinement; the best one is refined to its end
PROMISE = 0.8  # share of the mu before refinement on the body that a candidate is taken to keep at least
MOST_COLLIDING = 4  # candidates that end in link collisions before a start gives up


def run_start(
    compiled: CompiledProblem,
    index: int,
    seed: int,
    deadline: Deadline,
    known_contacts: Sequence[FloatArray] = (),
    candidates: Sequence[GraspCandidate] = (),
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
    """
    clock = Stopwatch()
    with single_thread():
        try:
            result = _best_of_candidates(
                compiled, index, np.random.default_rng([seed, index]), deadline, clock, known_contacts, candidates
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
) -> StartGrasp:
    """Return the best result over a start's candidates, with the total effort."""
    origin = CandidateOrigin.BOUND if known_contacts else CandidateOrigin.RANDOM
    if compiled.problem.objective == "nu":
        return _best_by_volume(compiled, index, candidates or propose(compiled, rng), rng, deadline, clock)
    # hand poses are scored under the L2 budget
    comparing = compiled if compiled.follows_contacts else compiled.l2_variant or compiled
    proposed = candidates or propose(compiled, rng, known_contacts)
    refinement, results = _Refinement(compiled, index, origin, deadline, clock), list[StartGrasp]()
    if not compiled.follows_contacts:
        clock.mark("propose")
        values = [weakest_directions_of(comparing, raced, rng).value for raced in proposed]
        links = [points_near_body(compiled, raced) for raced in proposed]
        scored = [ScoredCandidate(*parts) for parts in zip(proposed, values, links, strict=True)]
        scored.sort(key=lambda raced: -raced.score)
        results = refinement.best_first(scored)
        if not any(result.record.has_grasp for result in results) and not deadline.should_stop():
            results += refinement.best_first([replace(raced, links=LinkConstraints()) for raced in scored])
        return _best_of_results(results)
    clock.mark("propose")
    unpromising, initial_effort = list[ScoredCandidate](), SolverEffort()
    initial_grasps = (solve_initial_nlp(comparing, candidate, rng) for candidate in proposed)
    batch = list[ScoredCandidate]()
    for count, initial in enumerate(initial_grasps, 1):
        initial_effort += initial.effort
        clock.mark("first program")
        (batch if initial.score > 0.0 else unpromising).append(initial)
        if len(batch) < COMPARED and count < len(proposed) and not deadline.should_stop():
            continue
        results += refinement.best_first(_sort_by_promise(comparing, batch, deadline))
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
    for candidate in largest_volumes(compiled, candidates, rng, COMPARED):
        on_faces, snapped = fix_to_triangles(compiled, candidate)
        moved = maximise_volume(on_faces, snapped, deadline)
        on_body, refined = put_on_body(compiled, on_faces, moved), refine(on_faces, moved, deadline, rounds=0)
        clock.mark("refine")
        bounds = _certify_grasp(compiled, on_body, refined, deadline)
        clock.mark("certificate")
        origin = CandidateOrigin.RANDOM
        result = StartGrasp.of(compiled, index, on_body, bounds, refined.state(), origin.value, origin=origin)
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


def _refined_grasps(
    compiled: CompiledProblem, index: int, candidate: GraspCandidate, deadline: Deadline
) -> Iterator[tuple[GraspOnBody, RefinementResult]]:
    """Yield the refined grasps of a candidate; some are first refined under the L2 budget.

    The support under L2, a root of a sum of squares over the contacts, is smooth where those of other budgets have
    edges. Every other start does so, and with a hand that has a pose all; the grasp refined under L2 is then yielded as
    well.
    """
    under_l2 = compiled.l2_variant if index % 2 or not compiled.follows_contacts else None
    if under_l2 is not None:
        on_body, result = refine_on_body(under_l2, candidate, deadline)
        candidate = result.point.candidate
        if not compiled.follows_contacts:
            yield on_body, refine(*fix_to_triangles(compiled, candidate), deadline, rounds=0)
    yield refine_on_body(compiled, candidate, deadline)


def _can_stop(results: Sequence[StartGrasp]) -> bool:
    """Return whether a start can end: a result is solved, or too many have colliding links."""
    colliding = sum(result.record.status is Status.TOUCHES for result in results)
    return any(result.solved for result in results) or colliding >= MOST_COLLIDING


@dataclass(frozen=True)
class _Refinement:
    """Refinement of a start's candidates to certified grasps, whose links are moved off what they penetrate.

    Parameters
    ----------
    compiled : CompiledProblem
    index : int
        Of the start.
    origin : CandidateOrigin
    deadline : Deadline
    clock : Stopwatch
    """

    compiled: CompiledProblem
    index: int
    origin: CandidateOrigin
    deadline: Deadline
    clock: Stopwatch

    def best_first(self, candidates: Sequence[ScoredCandidate]) -> list[StartGrasp]:
        """Return the results of candidates, sorted by their scores, until one is solved.

        The links of a refined grasp are moved off what they penetrate once no other candidate promises more.
        """
        waiting, refined, results = list(candidates), list[StartGrasp](), list[StartGrasp]()
        while (waiting or refined) and not _can_stop(results) and not (results and self.deadline.should_stop()):
            lower_bounds = [grasp.record.mu.lower for grasp in refined]
            if waiting and (not refined or PROMISE * waiting[0].score > max(lower_bounds)):
                refined += self._certified_grasps(waiting.pop(0))
            else:
                results.append(self._free_links(refined.pop(int(np.argmax(lower_bounds)))))
                self.clock.mark("refine")
        return [*results, *refined]

    def _certified_grasps(self, initial: ScoredCandidate) -> Iterator[StartGrasp]:
        """Yield the grasps of a candidate, refined on the body, certified and measured."""
        compiled, index, origin, message = self.compiled, self.index, self.origin, initial.message or self.origin.value
        compiled = compiled.with_link_constraints(initial.links)
        for on_body, refined in _refined_grasps(compiled, index, initial.candidate, self.deadline):
            self.clock.mark("refine")
            robust = None
            if compiled.options.maximise_robust:
                on_body, robust = maximise_robustness(compiled, on_body, self.deadline)
                self.clock.mark("robust")
            bounds = _certify_grasp(compiled, on_body, refined, self.deadline)
            self.clock.mark("certificate")
            state = refined.state()
            yield StartGrasp.of(compiled, index, on_body, bounds, state, message, origin=origin, robust=robust)
            self.clock.mark("link depth")

    def _free_links(self, touching: StartGrasp) -> StartGrasp:
        """Return a grasp refined until its links hardly penetrate anything; unchanged if that costs much of mu.

        The spheres need not cover a link, so that its shape may penetrate where they do not. Constraints are added
        there, and the grasp is refined again: on the triangles that it touches, or if these do not permit it, over the
        whole body. Where the worst displacement is maximised, which the refinement does not know, the grasp is
        unchanged.
        """
        added, results, deadline = AddedClearance(self.compiled, touching.link_constraints), [touching], self.deadline
        if not touching.record.has_grasp or self.compiled.options.maximise_robust:
            return touching
        while len(results) <= MOST_CLEARANCES and not deadline.should_stop():
            before = results[-1]
            if not added.extend(before.on_body.candidate):
                break
            if before.record.has_grasp:
                on_body, refined = refine_on_triangles(added.finer, before.refined_candidate, deadline)
            else:
                on_body, refined = refine_on_body(added.finer, before.refined_candidate, deadline)
            bounds = _certify_grasp(added.finer, on_body, refined, deadline)
            record, state = touching.record, refined.state()
            results.append(
                StartGrasp.of(added.finer, record.index, on_body, bounds, state, record.message, origin=record.origin)
            )
            if _is_stuck(before, results[-1]):
                break
        least_mu = WORTH_FREEING * touching.record.mu.lower
        free = [result for result in results if result.solved and result.record.mu.lower >= least_mu] or [touching]
        best = min(free, key=lambda result: added.depth(result.on_body.candidate))
        return replace(best, total_effort=sum((result.effort for result in results), SolverEffort()))


def _is_stuck(before: StartGrasp, after: StartGrasp) -> bool:
    """Return whether further refinement would leave the links where they are, or a grasp was free and is not now."""
    if before.solved and after.record.status is Status.TOUCHES:
        return True
    if after.refined_candidate.is_near(before.refined_candidate):
        return after.record.has_grasp == before.record.has_grasp
    if after.record.has_grasp or before.depth is None or after.depth is None:
        return False
    return not after.depth.is_free and after.depth.depth >= before.depth.depth


def _certify_grasp(
    compiled: CompiledProblem, on_body: GraspOnBody, result: RefinementResult, deadline: Deadline
) -> Bounds:
    """Return the certified bounds of a grasp, with the upper bound tightened by known weak directions."""
    budget, time_limit, rtol = (
        compiled.budget(on_body.candidate),
        deadline.certificate_deadline(),
        compiled.options.rtol,
    )
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
