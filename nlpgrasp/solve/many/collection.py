"""The distinct grasps of a solve: where its starts ended, and where that are too few, what it met besides."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from nlpgrasp.common.stopping.stop import Stop
from nlpgrasp.common.validation import integer, share
from nlpgrasp.solution.findings import Robustness
from nlpgrasp.solution.many.found import FoundGrasp
from nlpgrasp.solve.after.least_forces import least_forces
from nlpgrasp.solve.after.look_back import Aftermath, attempted, before_grasp
from nlpgrasp.solve.after.robust import robustness
from nlpgrasp.solve.answer import hand_data
from nlpgrasp.solve.many.likeness import Likeness
from nlpgrasp.solve.many.neighbours import neighbours
from nlpgrasp.solve.start.given import Given, run_given
from nlpgrasp.solve.start.result import StartGrasp, StartResult
from nlpgrasp.solve.start.run import with_hand
from nlpgrasp.solve.workbench.clock import Clock
from nlpgrasp.solve.workbench.placed import Placed
from nlpgrasp.solve.workbench.workbench import Workbench
from nlpgrasp.solve.workers.one_thread import one_thread
from nlpgrasp.solve.workers.pool import Runner

HALF = 0.5  # of the best mu: what was met besides the starts has at least as much
MET = 4  # times as many placements are drawn from, as grasps are wanted
SHORT = 1.1  # times as many are certified at a time as are missing: not all turn out to be allowed


@dataclass(frozen=True)
class Keeping:
    """How many grasps a solve keeps.

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


ONE = Keeping()


def others_beside(
    runner: Runner, best: StartGrasp, results: Sequence[StartResult], keeping: Keeping, stop: Stop
) -> tuple[FoundGrasp, ...]:
    """Return the grasps that are kept beside the answer, best first.

    That are the ends of the starts, distinct from each other and from the answer, the best first. Where these are too
    few, grasps that the look over all placements met, and then the best neighbours of the grasps kept so far, with one
    contact elsewhere, as they are, join them: those with at least half the mu of the best.

    Parameters
    ----------
    runner : Runner
    best : StartGrasp
        The answer.
    results : sequence of StartResult
    keeping : Keeping
    stop : Stop
    """
    if keeping.count == 1:
        return ()
    solved = [r for r in results if isinstance(r, StartGrasp) and r.solved and r.record.index != best.record.index]
    solved.sort(key=lambda r: (-r.record.mu.lower, r.record.index))
    kept = _Distinct(Likeness(runner.bench, keeping.distinct), keeping.count, [best])
    for start in solved:
        kept.offer(start)
    if not stop.requested():
        least = HALF * max(r.record.mu.lower for r in (best, *solved[:1]))
        _fill(runner, kept, least, stop)
    beside = kept.grasps[1:]
    work = _plain if stop.requested() else _finished
    found = runner.each(work, beside)
    own = {id(r) for r in solved}
    told = [replace(f, start=f.start if id(r) in own else None) for r, f in zip(beside, found, strict=False)]
    weighs = runner.options.weighs_fragility
    if runner.options.maximise_robust:
        return tuple(sorted(told, key=lambda f: -(f.mu if f.robust is None else f.robust.mu).lower))
    return tuple(sorted(told, key=lambda f: (weighs and f.is_fragile, -f.mu.lower)))


class _Distinct:
    """Grasps that are distinct from each other."""

    def __init__(self, likeness: Likeness, most: int, grasps: list[StartGrasp]) -> None:
        self._likeness, self._most, self.grasps = likeness, most, grasps

    @property
    def missing(self) -> int:
        """How many more there may be."""
        return self._most - len(self.grasps)

    def has(self, placed: Placed) -> bool:
        """Return whether a placement is one of them."""
        return any(self._likeness.alike(placed, other.found.placed) for other in self.grasps)

    def alike(self, placed: Placed, others: Sequence[Placed]) -> bool:
        """Return whether a placement is one of some others."""
        return any(self._likeness.alike(placed, other) for other in others)

    def offer(self, start: StartGrasp) -> None:
        """Take a grasp where there is room, and it is none of them."""
        if self.missing > 0 and not self.has(start.found.placed):
            self.grasps.append(start)


def _fill(runner: Runner, kept: _Distinct, least: float, stop: Stop) -> None:
    """Add grasps that the solve met besides its starts, with a certified mu of ``least`` or more."""
    if kept.missing <= 0 or not runner.bench.follows_contacts:
        return
    waiting = _met(runner, kept, stop)
    while kept.missing > 0 and not stop.requested():
        batch: list[Placed] = []
        for placed in waiting:
            if not kept.has(placed) and not kept.alike(placed, batch):
                batch.append(placed)
            if len(batch) >= SHORT * kept.missing:
                break
        if not batch:
            return
        certified = [r for r in runner.each(_as_it_is, batch) if r is not None and r.record.mu.lower >= least]
        for start in sorted(certified, key=lambda r: -r.record.mu.lower):
            kept.offer(start)


def _met(runner: Runner, kept: _Distinct, stop: Stop) -> Iterator[Placed]:
    """Yield what the look over all placements met, then the neighbours of the grasps kept so far, the best first."""
    bench, count = runner.bench, MET * kept.missing
    seen = runner.outlook(stop)
    if seen is not None:
        yield from (with_hand(bench, placed) for placed in seen.placements(count))
    yield from neighbours(bench, [start.found.placed for start in kept.grasps], count)


def _as_it_is(bench: Workbench, placed: Placed) -> StartGrasp | None:
    """Return a placement on the body itself, certified; None where it breaks a constraint or exerts nothing."""
    found = next(iter(run_given(bench, Given(placed), 0, Stop(), improve=False)), None)
    return found if isinstance(found, StartGrasp) and found.solved else None


def _finished(bench: Workbench, start: StartGrasp) -> FoundGrasp:
    """Return a grasp with its forces, and what the options ask for besides: robustness, the hand just before."""
    placed, grasp = start.found.placed, start.found.grasp
    robust = start.robust
    with one_thread():
        if robust is None and bench.options.extras:
            robust = attempted(lambda: robustness(bench, placed, grasp, quickly=True))
        return _told(bench, start, robust, before_grasp(bench, start.found, Clock()))


def _plain(bench: Workbench, start: StartGrasp) -> FoundGrasp:
    """Return a grasp with its forces alone, where there is no time left."""
    with one_thread():
        return _told(bench, start, start.robust, Aftermath())


def _told(bench: Workbench, start: StartGrasp, robust: Robustness | None, before: Aftermath) -> FoundGrasp:
    found, bounds = start.found, start.record.mu
    exerted = least_forces(bench.problem, found.grasp, bench.budget(found.placed), bounds)
    return FoundGrasp(
        found.grasp,
        found.placed.faces,
        bounds,
        bench.problem.task.measure,
        hand_data(bench.problem, found, before),
        None if robust is None else robust.beside(bounds),
        exerted.forces,
        exerted.moments,
        exerted.needed,
        start.constraints,
        found.surface,
        start.record.index,
    )
