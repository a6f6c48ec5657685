"""Collection of distinct grasps kept beside the answer of a solve."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import zip_longest

import numpy as np

from nlpgrasp.common.deadline import Deadline
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, integer, share
from nlpgrasp.contacts import PlaneContact
from nlpgrasp.hands import ParallelJaw
from nlpgrasp.optimize.candidate import GraspCandidate
from nlpgrasp.optimize.compiled_problem import FEASIBLE, CompiledProblem
from nlpgrasp.optimize.coordinate_exchange import ContactPlacements, exchanged_candidates, sampled_quality
from nlpgrasp.optimize.exerted_forces import compute_exerted_forces
from nlpgrasp.optimize.grasp_equivalence import GraspEquivalence
from nlpgrasp.optimize.hand_approach import add_hand_record, hand_posture
from nlpgrasp.optimize.jaw_pairs import opposite_candidates
from nlpgrasp.optimize.parallel_starts import StartRunner
from nlpgrasp.optimize.processes import single_thread
from nlpgrasp.optimize.robustness import robustness
from nlpgrasp.optimize.start_result import StartGrasp, StartResult, attempt
from nlpgrasp.optimize.warm_starts import WarmStart, certify_as_is
from nlpgrasp.quality import mu
from nlpgrasp.quality.grasp import Grasp, GraspStack
from nlpgrasp.quality.screening import screen
from nlpgrasp.solution.analysis_records import Robustness
from nlpgrasp.solution.kept_grasps import FoundGrasp, rank_by
from nlpgrasp.solution.obstructions import approach_obstructions, way_obstructions

MOST_KNOWN = 12  # grasps whose neighbours are computed, at most
POSITIONS = 48  # positions tried per contact
SCREENED = 4  # placements screened closely per requested grasp
HALF = 0.5  # least share of the best mu of grasps that are not results of starts
EXCHANGED = 4  # candidates of the coordinate exchange per missing grasp
MOST_PER_WANTED = 2  # grasps by parallel jaws per requested one, blocked ones included
OVERSHOOT = 1.1  # grasps certified at a time per missing one, as some are rejected
_CertifiedGrasp = tuple[StartGrasp, FoundGrasp]


@dataclass(frozen=True)
class KeepOptions:
    """Options of kept grasps: their number, and the least distance between two of them.

    Parameters
    ----------
    count : int
        Number of grasps, at most.
    distinct : float
        Least distance between two of them, over the body's size.
    """

    count: int = 1
    distinct: float = 0.1

    def __post_init__(self) -> None:
        object.__setattr__(self, "count", integer("keep", self.count, at_least=1, at_most=10_000))
        object.__setattr__(self, "distinct", share("distinct", self.distinct))


ONE = KeepOptions()


class GraspCollection:
    """Distinct grasps kept beside the answer, certified by workers while the answer is completed.

    They are the results of the starts, distinct from each other and from the answer, the best first. Where these are
    too few, candidates of one more coordinate exchange are added, then the best neighbours of the kept grasps, which
    differ in one contact; for parallel jaws opposite pairs. Neither are refined; their mu is at least half the best.
    Grasps by parallel jaws without a free way in are replaced by as many further ones, where there are any: at other
    contacts, then at the same contacts with the gripper's pads turned about the closing line.

    Parameters
    ----------
    runner : StartRunner
    keeping : KeepOptions
    deadline : Deadline
    turns_pads : bool
        Whether the pads of a gripper may be turned from the direction that the problem states.
    """

    def __init__(self, runner: StartRunner, keeping: KeepOptions, deadline: Deadline, turns_pads: bool = True) -> None:
        self._runner, self._deadline = runner, deadline
        problem = runner.problem
        self._replaces_blocked = isinstance(problem.hand, ParallelJaw) and problem.body.space == 3
        self._turns_pads = turns_pads and problem.has_gripper_pads
        self._wanted, self._blocked = keeping.count, 0
        capacity = MOST_PER_WANTED * keeping.count if self._replaces_blocked else keeping.count
        self._distinct = DistinctGrasps(GraspEquivalence(runner.compiled, keeping.distinct), capacity)
        self._finished_results: Callable[[], list[FoundGrasp]] = list
        self._additions: list[FoundGrasp] = []
        self._least = 0.0
        self._candidates: Iterator[GraspCandidate] | None = None
        self._batch: Callable[[], list[_CertifiedGrasp | None]] | None = None

    def begin(self, best: StartGrasp, results: Sequence[StartResult]) -> None:
        """Begin to certify the kept grasps, given the answer and the results of all starts."""
        distinct, runner, deadline = self._distinct, self._runner, self._deadline
        distinct.add(best)
        grasps = [r for r in results if isinstance(r, StartGrasp) and r.record.has_grasp]
        others = [r for r in grasps if r.record.index != best.record.index]
        others.sort(key=lambda r: (not r.solved, -r.record.mu.lower, r.record.index))
        for start in others:
            distinct.add(start)
        self._finished_results = runner.begin(partial(_complete_record, deadline=deadline), distinct.grasps[1:])
        self._least = HALF * max(r.record.mu.lower for r in (best, *others[:1]))
        self._blocked = self._count_blocked([best.hand])
        self._batch = self._begin_batch()

    def grasps(self) -> tuple[FoundGrasp, ...]:
        """Wait for the kept grasps and return them, best first."""
        results = self._finished_results()
        self._blocked += self._count_blocked([grasp.hand for grasp in results])
        self._batch = self._batch or self._begin_batch()
        while self._batch is not None:
            certified = [grasp for grasp in self._batch() if grasp is not None]
            for start, finished in sorted(certified, key=lambda grasp: -grasp[0].record.mu.lower):
                if self._distinct.add(start):
                    self._additions.append(finished)
                    self._blocked += self._count_blocked([finished.hand])
            self._batch = self._begin_batch()
        grasps = [*results, *self._additions]
        grasps += self._with_turned_pads(grasps)
        return tuple(sorted(grasps, key=rank_by(self._runner.options.to_dict())))

    def _with_turned_pads(self, kept: Sequence[FoundGrasp]) -> list[FoundGrasp]:
        """Return grasps at the contacts of the collected ones with turned pads, as many as usable ones are missing.

        Usable are those with a free way in and the pads on their faces. The collected grasps take turns, the best
        first. ``kept`` are those beside the answer.
        """
        starts = self._distinct.grasps
        hands = [starts[0].hand, *(grasp.hand for grasp in kept)]
        missing = self._wanted - sum(not approach_obstructions(hand) for hand in hands)
        if missing <= 0 or not self._turns_pads or self._deadline.should_stop():
            return []
        usable = self._runner.begin(_usable_turns, starts)()
        in_turn = zip_longest(*([(start, d) for d in turns] for start, turns in zip(starts, usable, strict=False)))
        turned = [pair for pairs in in_turn for pair in pairs if pair is not None][: int(np.ceil(OVERSHOOT * missing))]
        certify = partial(_certify_turned, least=self._least, deadline=self._deadline)
        return [grasp for grasp in self._runner.begin(certify, turned)() if grasp is not None][:missing]

    def _count_blocked(self, hands: Iterable[Json | None]) -> int:
        """Return how many grasps by parallel jaws have no free way in; 0 for other hands."""
        return sum(self._replaces_blocked and bool(way_obstructions(hand)) for hand in hands)

    @property
    def _missing(self) -> int:
        """Number of grasps that are missing, beside those without a free way in."""
        return min(self._distinct.missing, self._wanted + self._blocked - self._distinct.size)

    def _begin_batch(self) -> Callable[[], list[_CertifiedGrasp | None]] | None:
        """Begin to certify as many candidates as grasps are missing, and return a callable for the results.

        There are a few more candidates than missing grasps; None without candidates.
        """
        if self._missing <= 0 or not self._runner.compiled.follows_contacts or self._deadline.should_stop():
            return None
        if self._candidates is None:
            self._candidates = _further_candidates(self._runner, self._distinct, self._deadline)
        batch: list[GraspCandidate] = []
        is_blocked, has_enough = self._runner.compiled.hand_functions.is_blocked, self._distinct.size >= self._wanted
        for candidate in self._candidates:
            if has_enough and is_blocked(candidate.points):  # it would replace a blocked one
                continue
            if not self._distinct.contains(candidate) and not self._distinct.has_equivalent(batch, candidate):
                batch.append(candidate)
            if len(batch) >= OVERSHOOT * self._missing:
                break
        return (
            self._runner.begin(partial(_certify_candidate, least=self._least, deadline=self._deadline), batch)
            if batch
            else None
        )


class DistinctGrasps:
    """Set of pairwise distinct grasps, of limited size."""

    def __init__(self, equivalence: GraspEquivalence, capacity: int) -> None:
        self._equivalence, self._capacity = equivalence, capacity
        self.grasps: list[StartGrasp] = []

    @property
    def distance(self) -> float:
        """Distance of matched contacts above which two grasps are distinct, metres."""
        return self._equivalence.distance

    @property
    def size(self) -> int:
        """Number of grasps."""
        return len(self.grasps)

    @property
    def missing(self) -> int:
        """Number of grasps that can still be added."""
        return self._capacity - self.size

    def contains(self, candidate: GraspCandidate) -> bool:
        """Return whether a candidate is equivalent to a grasp of the set."""
        return self.has_equivalent([start.on_body.candidate for start in self.grasps], candidate)

    def has_equivalent(self, others: Sequence[GraspCandidate], candidate: GraspCandidate) -> bool:
        """Return whether a candidate is equivalent to any of several others."""
        return any(self._equivalence.are_equivalent(candidate, other) for other in others)

    def add(self, start: StartGrasp) -> bool:
        """Add a grasp if the set is not full and has no equivalent one; return whether it was added."""
        is_new = self.missing > 0 and not self.contains(start.on_body.candidate)
        if is_new:
            self.grasps.append(start)
        return is_new


def neighbouring_candidates(
    compiled: CompiledProblem, candidates: Sequence[GraspCandidate], count: int
) -> list[GraspCandidate]:
    """Return up to ``count`` feasible candidates that differ from given ones in one contact, the best first.

    An upper bound on their mu is above 0. For problems whose hand, if any, follows the contacts.

    Parameters
    ----------
    compiled : CompiledProblem
    candidates : sequence of GraspCandidate
        The best first.
    count : int
    """
    neighbours = [_relocate_contacts(compiled, candidate) for candidate in candidates[:MOST_KNOWN]]
    points = np.concatenate([moved.points for moved in neighbours])
    normals = np.concatenate([moved.normals for moved in neighbours])
    faces = np.concatenate([moved.faces for moved in neighbours])
    hand = compiled.hand_functions.start(points, normals)
    feasible = np.flatnonzero(compiled.rows.violations(points, normals, hand) <= FEASIBLE)
    if not len(feasible):
        return []
    quality = sampled_quality(compiled, points[feasible], normals[feasible])
    best = feasible[np.argsort(-quality, kind="stable")[: SCREENED * count]]
    stack = GraspStack(points[best], normals[best], compiled.problem.models, compiled.problem.origin)
    upper = screen(stack, compiled.problem.task, force_budget=compiled.screening_budget)
    order = [int(i) for i in np.argsort(-upper, kind="stable") if upper[i] > 0.0]
    chosen = best[order[:count]]
    return [GraspCandidate(tuple(faces[i]), points[i], {name: v[i] for name, v in hand.items()}) for i in chosen]


def _relocate_contacts(compiled: CompiledProblem, candidate: GraspCandidate) -> ContactPlacements:
    """Return copies of a candidate, each with one contact moved to a point of its allowed faces."""
    k, count = len(candidate.faces), POSITIONS * len(candidate.faces)
    points, normals = (np.stack([a] * count) for a in (candidate.points, compiled.inward_normals(candidate)))
    faces = np.empty((count, k), dtype=object)
    faces[:] = candidate.faces
    for i in range(k):
        cloud, block = compiled.surface.cloud(i), slice(i * POSITIONS, (i + 1) * POSITIONS)
        spread = np.linspace(0, len(cloud.points) - 1, POSITIONS).astype(int)
        points[block, i], normals[block, i], faces[block, i] = (
            cloud.points[spread],
            cloud.normals[spread],
            cloud.faces[spread],
        )
    return ContactPlacements(points, normals, faces)


def _further_candidates(runner: StartRunner, distinct: DistinctGrasps, deadline: Deadline) -> Iterator[GraspCandidate]:
    """Yield candidates of a coordinate exchange, then the best neighbours of the kept grasps.

    For parallel jaws they are opposite pairs of surface samples.
    """
    compiled, count = runner.compiled, EXCHANGED * distinct.missing
    if isinstance(compiled.problem.hand, ParallelJaw) and len(compiled.sample_tables.pairs):
        yield from opposite_candidates(compiled, distinct.distance, count)
        return
    if not deadline.should_stop():
        yield from exchanged_candidates(compiled, np.random.default_rng(0), count=count)
    yield from neighbouring_candidates(compiled, [start.on_body.candidate for start in distinct.grasps], count)


def _certify_candidate(
    compiled: CompiledProblem, candidate: GraspCandidate, least: float, deadline: Deadline
) -> _CertifiedGrasp | None:
    """Return a candidate as a certified grasp with its record; None if infeasible or with mu below ``least``."""
    start = certify_as_is(compiled, WarmStart(candidate), 0)
    if start is None or start.record.mu.lower < least:
        return None
    return start, replace(_complete_record(compiled, start, deadline), start=None)


def _usable_turns(compiled: CompiledProblem, start: StartGrasp) -> list[FloatArray]:
    """Return the approaches (3,) of a gripper with turned pads at the contacts of a start."""
    return compiled.hand_functions.usable_turns(start.on_body.grasp.points)


def _certify_turned(
    compiled: CompiledProblem, turned: tuple[StartGrasp, FloatArray], least: float, deadline: Deadline
) -> FoundGrasp | None:
    """Return the grasp of a start with the pads along another approach, certified; None if mu is below ``least``."""
    start, direction = turned
    on_body, (x, y, z) = start.on_body, direction.tolist()
    grasp = on_body.grasp
    pads = [replace(pad, direction=(x, y, z)) for pad in grasp.contacts if isinstance(pad, PlaneContact)]
    on_body = replace(on_body, grasp=Grasp(grasp.points, grasp.normals, pads, grasp.torque_origin))
    with single_thread():
        budget, rtol = compiled.budget(on_body.candidate), compiled.options.rtol
        bounds = mu(on_body.grasp, compiled.problem.task, rtol, force_budget=budget)
        if bounds.lower < least:
            return None
        posed = start if start.hand else add_hand_record(compiled, start)
        hand = {**(posed.hand or {}), **compiled.hand_functions.along_approach(grasp.points, direction)}
    record = replace(start.record, mu=bounds)
    turned_start = replace(start, on_body=on_body, record=record, hand=hand, robust=None)
    return replace(_complete_record(compiled, turned_start, deadline), start=None)


def _complete_record(compiled: CompiledProblem, start: StartGrasp, deadline: Deadline) -> FoundGrasp:
    """Return the record of a start's grasp, after computing missing robustness and hand record if time permits."""
    candidate, grasp = start.on_body.candidate, start.on_body.grasp
    with single_thread():
        if deadline.should_stop():
            return _kept_grasp_record(compiled, replace(start, hand=hand_posture(compiled, start)), start.robust)
        robust = start.robust
        if robust is None and compiled.options.weighs_fragility:
            robust, _ = attempt(lambda: robustness(compiled, candidate, grasp, quickly=True))
        return _kept_grasp_record(compiled, start if start.hand else add_hand_record(compiled, start), robust)


def _kept_grasp_record(compiled: CompiledProblem, start: StartGrasp, robust: Robustness | None) -> FoundGrasp:
    """Return the record of a start's grasp from given results; only its finger forces are computed."""
    on_body, bounds = start.on_body, start.record.mu
    exerted = compute_exerted_forces(compiled.problem, on_body.grasp, compiled.budget(on_body.candidate), bounds)
    return FoundGrasp(
        on_body.grasp,
        on_body.candidate.faces,
        bounds,
        compiled.problem.task.measure,
        start.hand,
        None if robust is None else robust.beside(bounds),
        exerted.forces,
        exerted.moments,
        exerted.needed,
        start.constraints,
        on_body.surface,
        start.record.index,
    )
