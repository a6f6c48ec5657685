"""Starts over the machine's cores, each result as it comes."""

from __future__ import annotations

import pickle
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

from loky.process_executor import BrokenProcessPool

from nlpgrasp.common.stopping.stop import Stop
from nlpgrasp.errors import InputError
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.solution.measures.global_bound import GlobalBound
from nlpgrasp.solution.records import StartRecord, Status
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.solve.after.choice import chosen
from nlpgrasp.solve.after.final_step import at_local_optimum
from nlpgrasp.solve.after.look_back import Aftermath, look_back
from nlpgrasp.solve.after.way_in import with_free_way
from nlpgrasp.solve.analyse import all_analyses, analyses_of, is_stated, with_analyses
from nlpgrasp.solve.options import SolveOptions
from nlpgrasp.solve.outlook.outlook import Outlook, outlook
from nlpgrasp.solve.posture.roomy import with_room
from nlpgrasp.solve.start.result import StartGrasp, StartResult
from nlpgrasp.solve.start.run import run_start
from nlpgrasp.solve.workbench.placed import Placed
from nlpgrasp.solve.workbench.programs import follows_contacts
from nlpgrasp.solve.workbench.workbench import Workbench
from nlpgrasp.solve.workers.parcel import LazyBench, Parcel
from nlpgrasp.solve.workers.processes import Processes, cores

Item = TypeVar("Item")
Found = TypeVar("Found")
NOT_BEGUN = "not begun"
GRACE = 10.0  # seconds in-flight starts get to finish after a stop


@dataclass(frozen=True)
class _Asked:
    """A problem and how it is solved."""

    problem: GraspProblem
    options: SolveOptions


class Runner:
    """Runs the starts of one problem, and looks back at them, where the problem's programs are.

    A worker that dies costs the starts in flight, which are reported as failed.

    Parameters
    ----------
    problem : GraspProblem
    options : SolveOptions
    starts : int
    bench : Workbench, optional
        Of the problem, where it has one already: the starts then run in this process.
    """

    def __init__(
        self, problem: GraspProblem, options: SolveOptions, starts: int, bench: Workbench | None = None
    ) -> None:
        self.problem, self.options, self.count = problem, options, starts
        self.workers = 1 if bench is not None else min(options.workers or cores(), starts)
        self._bench = bench
        self._outlook: Outlook | None = None
        self._parcel: Parcel[LazyBench[_Asked]] | None = None

    def outlook(self, stop: Stop) -> Outlook | None:
        """Return a look over all placements, taken where it is first asked for; None where none is possible."""
        if self._outlook is None:
            self._outlook = outlook(self.problem, self.options, stop, self.count)
        return self._outlook

    def bound(self, stop: Stop) -> GlobalBound | None:
        """Return what the look shows of all placements, None where none is possible."""
        seen = self.outlook(stop)
        return None if seen is None else seen.bound()

    def starts(self, seed: int, stop: Stop) -> Iterator[StartResult]:
        """Yield each start's result as it is done, in any order.

        The first three quarters of them begin from the best grasps that the outlook met, as many as there are; the
        first half where it left something out, which those grasps may break.
        """
        begin = self._known(stop)
        if self.workers == 1:
            yield from self._here(begin, seed, stop)
        else:
            yield from self._in_processes(begin, seed, stop)

    def _known(self, stop: Stop) -> list[Placed | None]:
        """Return what each start begins from, None where it draws for itself."""
        known: list[Placed | None] = []
        if follows_contacts(self.problem) and (seen := self.outlook(stop)) is not None:
            known += seen.placements((3 * self.count + 3) // 4 if seen.complete else (self.count + 1) // 2)
        return known + [None] * (self.count - len(known))

    def look_back(self, best: StartGrasp | None, results: Sequence[StartResult], seed: int, stop: Stop) -> Aftermath:
        """Return what is worth knowing after the starts; nothing where a worker ends over it."""
        seen = [] if best is not None and self._parcel is not None else list(results)
        looked = self.begin(partial(_look_back, results=seen, seed=seed, stop=stop), [best])
        return next(iter(looked()), Aftermath())

    def analysed(
        self, solution: GraspSolution, best: StartGrasp | None, stop: Stop
    ) -> tuple[GraspSolution, Mapping[str, float]]:
        """Return the answer with the analyses that the options ask for, and the seconds of each."""
        names = all_analyses(self.problem.hand) if self.options.extras else self.options.analyses
        names = [name for name in names if not is_stated(solution, name)]
        if best is None or not names or stop.requested():
            return solution, {}
        found, seconds = next(iter(self.begin(partial(analyses_of, names=names, stop=stop), [best])()), ({}, {}))
        return with_analyses(solution, found, self.problem.hand), seconds

    def choose(
        self, best: StartGrasp | None, results: Sequence[StartResult], stop: Stop
    ) -> Callable[[], StartGrasp | None]:
        """Begin to choose the start that is the answer: the best, or one that is not fragile where that is weighed.

        The call that is returned waits for it.
        """
        if best is None or not self.options.weighs_fragility or stop.requested():
            return lambda: best
        choosing = self.begin(partial(chosen, results=list(results), stop=stop), [best])
        return lambda: next(iter(choosing()), best)

    def roomy(self, best: StartGrasp | None, stop: Stop) -> StartGrasp | None:
        """Return the answer with its hand's joints away from their limits, where the options ask for that."""
        if best is None or not self.options.seeks_room or self.problem.hand is None or stop.requested():
            return best
        return next(iter(self.begin(partial(with_room, stop=stop), [best])()), best)

    def at_local_optimum(self, best: StartGrasp | None, stop: Stop) -> StartGrasp | None:
        """Return the answer at the local optimum of the program next to it, or as it is, with its KKT residuals."""
        if best is None or stop.requested():
            return best
        return next(iter(self.begin(partial(at_local_optimum, stop=stop), [best])()), best)

    def reachable(self, best: StartGrasp | None, results: list[StartResult], stop: Stop) -> StartGrasp | None:
        """Return the answer with its hand's way in: the best start, or the next one whose way is free.

        The results of the starts that were looked at are replaced, with what blocks them.
        """
        if best is None or self.problem.hand is None or stop.requested():
            return best
        seen = self.begin(partial(with_free_way, results=list(results), stop=stop), [best])
        looked_at = next(iter(seen()), (best,))
        by_index = {start.record.index: start for start in looked_at}
        results[:] = [by_index.get(result.record.index, result) for result in results]
        return looked_at[0]

    def begin(self, work: Callable[[Workbench, Item], Found], items: Sequence[Item]) -> Callable[[], list[Found]]:
        """Begin what a function of some module makes of the workbench and each item.

        The call that is returned waits for it: nothing where a worker ends. Without workers the work is done then.
        """
        if self._parcel is None:
            return lambda: [work(self.bench, item) for item in items]
        processes = Processes(self.workers)
        try:
            return partial(_done, [processes.submit(_each, self._parcel, work, item) for item in items])
        except (BrokenProcessPool, OSError, RuntimeError):
            return list

    @property
    def bench(self) -> Workbench:
        """The workbench in this process, built where it is first asked for."""
        if self._bench is None:
            self._bench = Workbench(self.problem, self.options)
        return self._bench

    def _here(self, begin: Sequence[Placed | None], seed: int, stop: Stop) -> Iterator[StartResult]:
        """Run the starts in this process; once a stop is requested the running start finishes with what it has."""
        for index, known in enumerate(begin):
            if stop.requested():
                break
            yield run_start(self.bench, index, seed, stop, known)

    def _in_processes(self, begin: Sequence[Placed | None], seed: int, stop: Stop) -> Iterator[StartResult]:
        try:
            self._parcel = Parcel.of(LazyBench(partial(_Asked, self.problem, self.options)))
        except (TypeError, ValueError, AttributeError, pickle.PicklingError) as error:
            reason = f"{type(error).__name__}: {error}"
            raise InputError("problem", reason, "parts that can be sent to worker processes, or workers=1") from None
        processes = Processes(self.workers)
        pending = {processes.submit(_work, self._parcel, i, seed, stop, known): i for i, known in enumerate(begin)}
        give_up = None
        while pending:
            done, _ = wait(pending, timeout=0.2, return_when=FIRST_COMPLETED)
            for future in done:
                yield _result(future, pending.pop(future))
            if stop.requested() and pending:
                give_up = give_up or time.monotonic() + GRACE
                for future in [f for f in pending if f.cancel()]:
                    pending.pop(future)
                if time.monotonic() > give_up:
                    processes.end()
                    break


def _work(
    parcel: Parcel[LazyBench[_Asked]], index: int, seed: int, stop: Stop, known: Placed | None
) -> StartResult | None:
    """Run one start in a worker; None where it is too late to begin."""
    return None if stop.requested() else run_start(parcel.unpacked().bench, index, seed, stop, known)


def _look_back(
    bench: Workbench, best: StartGrasp | None, results: list[StartResult], seed: int, stop: Stop
) -> Aftermath:
    return look_back(bench, best, results, seed, stop)


def _each(parcel: Parcel[LazyBench[_Asked]], work: Callable[[Workbench, Item], Found], item: Item) -> Found:
    """Do a part of what is left to do in a worker."""
    return work(parcel.unpacked().bench, item)


def _done(futures: Sequence[Future[Found]]) -> list[Found]:
    """Wait for parts of what is left to do; none of them where a worker ends."""
    try:
        return [future.result() for future in futures]
    except (BrokenProcessPool, CancelledError, OSError, RuntimeError):
        return []


def _result(future: Future[StartResult | None], index: int) -> StartResult:
    try:
        result = future.result()
    except (BrokenProcessPool, CancelledError, OSError, SystemExit, ImportError) as error:
        text = f"the worker process ended: {type(error).__name__}: {error}".splitlines()[0]
        return StartResult(StartRecord(index, Status.FAILED, message=text))
    if result is None:
        return StartResult(StartRecord(index, Status.TIME_LIMIT, message=NOT_BEGUN))
    return result
