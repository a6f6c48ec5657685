"""Collection of distinct grasps beside the answer: from starts, coordinate exchange and neighbours."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from nlpgrasp.common.deadline import Deadline
from nlpgrasp.common.validation import integer, share
from nlpgrasp.optimize.candidate import GraspCandidate
from nlpgrasp.optimize.compiled_problem import FEASIBLE, CompiledProblem
from nlpgrasp.optimize.coordinate_exchange import RandomContacts, exchanged_candidates, sampled_quality
from nlpgrasp.optimize.exerted_forces import least_forces
from nlpgrasp.optimize.grasp_equivalence import GraspEquivalence
from nlpgrasp.optimize.hand_approach import add_hand_record, hand_posture
from nlpgrasp.optimize.parallel_starts import StartRunner
from nlpgrasp.optimize.processes import single_thread
from nlpgrasp.optimize.robustness import robustness
from nlpgrasp.optimize.start_result import StartGrasp, StartResult, attempt
from nlpgrasp.optimize.warm_starts import WarmStart, certify_as_is
from nlpgrasp.quality.grasp import GraspStack
from nlpgrasp.quality.screening import screen
from nlpgrasp.solution.analysis_records import Robustness
from nlpgrasp.solution.kept_grasps import FoundGrasp
from nlpgrasp.solution.obstructions import approach_obstructions, grasp_obstructions

KNOWN = 12  # best grasps whose neighbours are computed
PLACES = 48  # positions tried per contact
SCREENED = 4  # placements screened closely per grasp wanted
HALF = 0.5  # of the best mu: lower bound for grasps that are not ends of starts
MET = 4  # candidates drawn per grasp wanted
SHORT = 1.1  # grasps certified at a time per missing one, as some are rejected
_Filled = tuple[StartGrasp, FoundGrasp]


@dataclass(frozen=True)
class KeepOptions:
    """Number and distinctness of the grasps that a solve keeps.

    Parameters
    ----------
    count : int
        At most.
    distinct : float
        Of the body's size: how far apart two of them are at least.
    """

    count: int = 1
    distinct: float = 0.1

    def __post_init__(self) -> None:
        object.__setattr__(self, "count", integer("keep", self.count, at_least=1, at_most=10_000))
        object.__setattr__(self, "distinct", share("distinct", self.distinct))


ONE = KeepOptions()


class GraspCollection:
    """Distinct grasps kept beside the answer, processed by the workers while the answer is completed.

    That are the ends of the starts, distinct from each other and from the answer, the best first. Where these are too
    few, candidates of one more coordinate exchange, and then the best neighbours of the grasps kept so far, with one
    contact elsewhere, as they are, join them: those with at least half the mu of the best.

    Parameters
    ----------
    runner : StartRunner
    keeping : KeepOptions
    deadline : Deadline
    """

    def __init__(self, runner: StartRunner, keeping: KeepOptions, deadline: Deadline) -> None:
        self._runner, self._stop = runner, deadline
        self._kept = DistinctGrasps(GraspEquivalence(runner.compiled, keeping.distinct), keeping.count)
        self._ends: Callable[[], list[FoundGrasp]] = list
        self._filled: list[FoundGrasp] = []
        self._least = 0.0
        self._waiting: Iterator[GraspCandidate] = iter(())
        self._begun: Callable[[], list[_Filled | None]] | None = None

    def begin(self, best: StartGrasp, results: Sequence[StartResult]) -> None:
        """Begin to process the grasps beside the answer, given the results of all starts."""
        kept, runner, deadline = self._kept, self._runner, self._stop
        kept.offer(best)
        ended = [r for r in results if isinstance(r, StartGrasp) and r.record.has_grasp]
        solved = [r for r in ended if r.record.index != best.record.index]
        solved.sort(key=lambda r: (not r.solved, -r.record.mu.lower, r.record.index))
        for start in solved:
            kept.offer(start)
        self._ends = runner.begin(partial(_finish, deadline=deadline), kept.grasps[1:])
        self._least = HALF * max(r.record.mu.lower for r in (best, *solved[:1]))
        full = kept.missing <= 0 or not runner.compiled.follows_contacts or deadline.is_requested()
        self._waiting = iter(()) if full else _met(runner, kept, deadline)
        self._begun = self._next()

    def grasps(self) -> tuple[FoundGrasp, ...]:
        """Return the kept grasps, best first, once they are processed."""
        while self._begun is not None:
            filled = [one for one in self._begun() if one is not None]
            for start, told in sorted(filled, key=lambda one: -one[0].record.mu.lower):
                if self._kept.offer(start):
                    self._filled.append(told)
            self._begun = self._next()
        found = [*self._ends(), *self._filled]
        weighs = self._runner.options.weighs_fragility
        by_robust = self._runner.options.maximise_robust

        def order(grasp: FoundGrasp) -> tuple[bool, bool, bool, float]:
            bounds = grasp.robust.mu if by_robust and grasp.robust is not None else grasp.mu
            fragile = weighs and not by_robust and grasp.is_fragile
            return bool(grasp_obstructions(grasp.hand)), bool(approach_obstructions(grasp.hand)), fragile, -bounds.lower

        return tuple(sorted(found, key=order))

    def _next(self) -> Callable[[], list[_Filled | None]] | None:
        """Begin to certify and finish about as many as are missing; None without candidates or time."""
        if self._kept.missing <= 0 or self._stop.is_requested():
            return None
        batch: list[GraspCandidate] = []
        for candidate in self._waiting:
            if not self._kept.has(candidate) and not self._kept.alike(candidate, batch):
                batch.append(candidate)
            if len(batch) >= SHORT * self._kept.missing:
                break
        return (
            self._runner.begin(partial(_finish_unrefined, least=self._least, deadline=self._stop), batch)
            if batch
            else None
        )


class DistinctGrasps:
    """Set of pairwise distinct grasps."""

    def __init__(self, likeness: GraspEquivalence, most: int) -> None:
        self._likeness, self._most = likeness, most
        self.grasps: list[StartGrasp] = []

    @property
    def missing(self) -> int:
        """Number of grasps that can still be added."""
        return self._most - len(self.grasps)

    def has(self, candidate: GraspCandidate) -> bool:
        """Return whether a placement is equivalent to one in the set."""
        return any(self._likeness.alike(candidate, other.on_body.candidate) for other in self.grasps)

    def alike(self, candidate: GraspCandidate, others: Sequence[GraspCandidate]) -> bool:
        """Return whether a placement is equivalent to one of some others."""
        return any(self._likeness.alike(candidate, other) for other in others)

    def offer(self, start: StartGrasp) -> bool:
        """Add a grasp if the set is not full and has no equivalent one; return whether it was added."""
        taken = self.missing > 0 and not self.has(start.on_body.candidate)
        if taken:
            self.grasps.append(start)
        return taken


def neighbouring_grasps(compiled: CompiledProblem, known: Sequence[GraspCandidate], count: int) -> list[GraspCandidate]:
    """Return up to ``count`` grasps that differ from a known one in one contact, the best first.

    They keep the constraints, and exert the task as far as an upper bound on their mu tells. For problems whose hand,
    if any, follows from the contacts.

    Parameters
    ----------
    compiled : CompiledProblem
    known : sequence of GraspCandidate
        The best first.
    count : int
    """
    drawn = [_relocate_contacts(compiled, candidate) for candidate in known[:KNOWN]]
    points = np.concatenate([moved.points for moved in drawn])
    normals = np.concatenate([moved.normals for moved in drawn])
    faces = np.concatenate([moved.faces for moved in drawn])
    hand = compiled.hand_points.start(points, normals)
    allowed = np.flatnonzero(compiled.rows.violations(points, normals, hand) <= FEASIBLE)
    if not len(allowed):
        return []
    worth = sampled_quality(compiled, points[allowed], normals[allowed])
    best = allowed[np.argsort(-worth, kind="stable")[: SCREENED * count]]
    stack = GraspStack(points[best], normals[best], compiled.problem.models, compiled.problem.origin)
    bound = screen(stack, compiled.problem.task, force_budget=compiled.screening_budget)
    order = [int(i) for i in np.argsort(-bound, kind="stable") if bound[i] > 0.0]
    chosen = best[order[:count]]
    return [GraspCandidate(tuple(faces[i]), points[i], {name: v[i] for name, v in hand.items()}) for i in chosen]


def _relocate_contacts(compiled: CompiledProblem, candidate: GraspCandidate) -> RandomContacts:
    """Return a grasp with each contact in turn at points spread over the faces that it may use."""
    k, count = len(candidate.faces), PLACES * len(candidate.faces)
    points, normals = (np.stack([a] * count) for a in (candidate.points, compiled.inward_normals(candidate)))
    faces = np.empty((count, k), dtype=object)
    faces[:] = candidate.faces
    for i in range(k):
        cloud, rows = compiled.surface.cloud(i), slice(i * PLACES, (i + 1) * PLACES)
        where = np.linspace(0, len(cloud.points) - 1, PLACES).astype(int)
        points[rows, i], normals[rows, i], faces[rows, i] = (
            cloud.points[where],
            cloud.normals[where],
            cloud.faces[where],
        )
    return RandomContacts(points, normals, faces)


def _met(runner: StartRunner, kept: DistinctGrasps, deadline: Deadline) -> Iterator[GraspCandidate]:
    """Yield candidates of a coordinate exchange, then the best neighbours of the grasps kept so far."""
    compiled, count = runner.compiled, MET * kept.missing
    if not deadline.is_requested():
        yield from exchanged_candidates(compiled, np.random.default_rng(0), count=count)
    yield from neighbouring_grasps(compiled, [start.on_body.candidate for start in kept.grasps], count)


def _finish_unrefined(
    compiled: CompiledProblem, candidate: GraspCandidate, least: float, deadline: Deadline
) -> _Filled | None:
    """Return a placement on the body itself, certified and finished; None where infeasible or below the least mu."""
    found = certify_as_is(compiled, WarmStart(candidate), 0)
    if found is None or found.record.mu.lower < least:
        return None
    return found, replace(_finish(compiled, found, deadline), start=None)


def _finish(compiled: CompiledProblem, start: StartGrasp, deadline: Deadline) -> FoundGrasp:
    """Return a grasp with its forces, and where time permits its robustness and pregrasp, if requested."""
    candidate, grasp = start.on_body.candidate, start.on_body.grasp
    with single_thread():
        if deadline.is_requested():
            return _kept_grasp_record(compiled, replace(start, hand=hand_posture(compiled, start)), start.robust)
        robust = start.robust
        if robust is None and compiled.options.weighs_fragility:
            robust, _ = attempt(lambda: robustness(compiled, candidate, grasp, quickly=True))
        return _kept_grasp_record(compiled, start if start.hand else add_hand_record(compiled, start), robust)


def _kept_grasp_record(compiled: CompiledProblem, start: StartGrasp, robust: Robustness | None) -> FoundGrasp:
    found, bounds = start.on_body, start.record.mu
    exerted = least_forces(compiled.problem, found.grasp, compiled.budget(found.candidate), bounds)
    return FoundGrasp(
        found.grasp,
        found.candidate.faces,
        bounds,
        compiled.problem.task.measure,
        start.hand,
        None if robust is None else robust.beside(bounds),
        exerted.forces,
        exerted.moments,
        exerted.needed,
        start.constraints,
        found.surface,
        start.record.index,
    )
