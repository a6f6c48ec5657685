"""Starts over the machine's cores, each result as it comes."""

from __future__ import annotations

import pickle
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

import numpy as np
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
from nlpgrasp.solve.analyse import analyses_of, asked, with_analyses
from nlpgrasp.solve.bounding import bounding, nodes_of
from nlpgrasp.solve.options import SolveOptions
from nlpgrasp.solve.start.given import run_given
from nlpgrasp.solve.start.result import StartGrasp, StartResult
from nlpgrasp.solve.start.run import run_start
from nlpgrasp.solve.start.warm_starts import WarmStart, given_of
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
        self.tree = bounding(problem, options)
        self._parcel: Parcel[LazyBench[_Asked]] | None = None

    def bound(self, best: StartGrasp | None, stop: Stop) -> GlobalBound | None:
        """Return what a short branch and bound shows of all placements; None where the bound does not cover them.

        Where a gap is asked for it is as it was left.
        """
        if self.tree is None:
            return None
        if best is not None:
            weak = np.array(best.kkt.directions) if best.kkt is not None and best.kkt.directions else None
            self.tree.expect(best.record.mu.lower, weak)
        if self.options.gap is None:
            self.tree.grow(nodes_of(self.problem, self.count), stop.requested)
        return self.tree.bound()

    def starts(self, seed: int, stop: Stop) -> Iterator[StartResult]:
        """Yield each start's result as it is done, in any order."""
        if self.workers == 1:
            yield from self._here(seed, stop)
        else:
            yield from self._in_processes(seed, stop)

    def warm_starts(self, known: Sequence[WarmStart], stop: Stop) -> Iterator[StartResult]:
        """Yield the starts from known grasps, as each is and refined, numbered after the others."""
        items = [(self.count + 2 * i, grasp) for i, grasp in enumerate(known)]
        for found in self.begin(partial(_warm, stop=stop), items)() if items else ():
            yield from found

    def look_back(self, best: StartGrasp | None, results: Sequence[StartResult], seed: int, stop: Stop) -> Aftermath:
        """Return what is worth knowing after the starts; nothing where a worker ends over it."""
        seen = [] if best is not None and self._parcel is not None else list(results)
        looked = self.begin(partial(_look_back, results=seen, seed=seed, stop=stop), [best])
        return next(iter(looked()), Aftermath())

    def analysed(
        self, solution: GraspSolution, best: StartGrasp | None, stop: Stop
    ) -> tuple[GraspSolution, Mapping[str, float]]:
        """Return the answer with the analyses that the options ask for, and the seconds of each."""
        names = asked(self.options, solution, self.problem.hand)
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

    def _here(self, seed: int, stop: Stop) -> Iterator[StartResult]:
        """Run the starts in this process; once a stop is requested the running start finishes with what it has."""
        for index in range(self.count):
            if stop.requested():
                break
            yield run_start(self.bench, index, seed, stop)

    def _in_processes(self, seed: int, stop: Stop) -> Iterator[StartResult]:
        try:
            self._parcel = Parcel.of(LazyBench(partial(_Asked, self.problem, self.options)))
        except (TypeError, ValueError, AttributeError, pickle.PicklingError) as error:
            reason = f"{type(error).__name__}: {error}"
            raise InputError("problem", reason, "parts that can be sent to worker processes, or workers=1") from None
        processes = Processes(self.workers)
        pending = {processes.submit(_work, self._parcel, i, seed, stop): i for i in range(self.count)}
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


def _work(parcel: Parcel[LazyBench[_Asked]], index: int, seed: int, stop: Stop) -> StartResult | None:
    """Run one start in a worker; None where it is too late to begin."""
    return None if stop.requested() else run_start(parcel.unpacked().bench, index, seed, stop)


def _warm(bench: Workbench, item: tuple[int, WarmStart], stop: Stop) -> list[StartResult]:
    """Run the starts from one known grasp."""
    return run_given(bench, given_of(bench, item[1]), item[0], stop)


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
