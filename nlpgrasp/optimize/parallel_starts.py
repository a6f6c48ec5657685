"""Parallel runs of starts over the machine's cores, with results as they complete.

Compiled programs are not pickled: a worker process receives the problem and its options once, compiles them itself
(``LazyCompiledProblem``) and keeps the compiled problem for all further starts.
"""

from __future__ import annotations

import pickle
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import islice
from typing import Generic, Protocol, TypeVar, cast

from loky.process_executor import BrokenProcessPool

from nlpgrasp.common.deadline import Deadline
from nlpgrasp.errors import InputError
from nlpgrasp.optimize.candidate import GraspCandidate
from nlpgrasp.optimize.compiled_problem import CompiledProblem
from nlpgrasp.optimize.options import SolveOptions
from nlpgrasp.optimize.processes import Processes, WorkerPayload, cores
from nlpgrasp.optimize.start import failed, run_start
from nlpgrasp.optimize.start_result import StartGrasp, StartResult
from nlpgrasp.optimize.warm_starts import KnownGrasp, WarmStart, run_warm_start
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.solution.records import StartRecord, Status

NOT_BEGUN = "not begun"  # message of a start that a stop came before
WAITING = 4  # starts per worker that are under way or wait for one
GRACE = 10.0  # seconds in-flight starts get to finish after a stop
Item = TypeVar("Item")
Found = TypeVar("Found")
Candidates = Iterable[tuple[int, Sequence[GraspCandidate]]]
"""Numbers of starts with the candidates of each."""
_kept: list[StartRunner] = []  # the last solve's, at most one, and nobody's while it is here


class StartRunner:
    """Runs starts and analyses of one problem, in worker processes that hold its compiled programs or in this one.

    A worker that dies costs the starts in flight, which are reported as failed.

    Parameters
    ----------
    problem : GraspProblem
    options : SolveOptions
    starts : int
    compiled : CompiledProblem, optional
        Of the problem, where it has one already: the starts then run in this process.
    """

    def __init__(
        self, problem: GraspProblem, options: SolveOptions, starts: int, compiled: CompiledProblem | None = None
    ) -> None:
        self.problem, self.options, self.count = problem, options, starts
        self.workers = 1 if compiled is not None else min(options.workers or cores(), starts)
        self._bench = compiled
        self._parcel: WorkerPayload[LazyCompiledProblem[_WorkItem]] | None = None

    @classmethod
    def going_on(cls, problem: GraspProblem, options: SolveOptions, starts: int) -> StartRunner:
        """Return a runner that compiles nothing anew where the runner kept last had the same problem and options."""
        last = _kept.pop() if _kept else None
        new = cls(problem, options, starts)
        if last is not None and last.problem is problem and last.options == options:
            new._bench = last._bench
            new._parcel = last._parcel if new.workers > 1 else None
        return new

    def keep(self) -> None:
        """Keep what was compiled for the next solve, if that is of the same problem."""
        _kept[:] = [self]

    def prepare(self) -> None:
        """Begin to compile the problem in worker processes, where there are any."""
        if self.workers == 1:
            return
        try:
            self._parcel = self._parcel or WorkerPayload.of(
                LazyCompiledProblem(partial(_WorkItem, self.problem, self.options))
            )
        except (TypeError, ValueError, AttributeError, pickle.PicklingError) as error:
            reason = f"{type(error).__name__}: {error}"
            raise InputError("problem", reason, "parts that can be sent to worker processes, or workers=1") from None
        processes = Processes(self.workers)
        for _ in range(self.workers):
            processes.submit(_compile, self._parcel)

    def starts(self, candidates: Candidates, seed: int, deadline: Deadline) -> Iterator[StartResult]:
        """Yield the result of each start, given by its number and candidates, as it is done, in any order."""
        if self.workers == 1:
            yield from self._run_in_process(candidates, seed, deadline)
        else:
            yield from self._in_processes(candidates, seed, deadline)

    def warm_starts(self, known: Sequence[KnownGrasp], first: int, deadline: Deadline) -> Iterator[StartResult]:
        """Yield the starts from known grasps, as each is and refined, numbered from ``first`` on, two each."""
        items = [(first + 2 * i, grasp) for i, grasp in enumerate(known)]
        for found in self.begin(partial(_run_known_grasp, deadline=deadline), items)():
            yield from found

    def run(self, work: Callable[[CompiledProblem, Item], Found], item: Item) -> Found | None:
        """Return what a function of some module makes of the workbench and an item; None where a worker ends."""
        return next(iter(self.begin(work, [item])()), None)

    def begin(self, work: Callable[[CompiledProblem, Item], Found], items: Sequence[Item]) -> Callable[[], list[Found]]:
        """Begin a module-level function of the compiled problem on each item.

        The call that is returned waits for it: nothing where a worker ends. Without workers the work is done then.
        """
        if self._parcel is None or not items:
            return lambda: [work(self.compiled, item) for item in items]
        processes = Processes(self.workers)
        try:
            return partial(_wait_for_results, [processes.submit(_run_part, self._parcel, work, item) for item in items])
        except (BrokenProcessPool, OSError, RuntimeError):
            return list

    @property
    def compiled(self) -> CompiledProblem:
        """Compiled problem of this process, built on first use."""
        if self._bench is None:
            self._bench = CompiledProblem(self.problem, self.options)
        return self._bench

    def _run_in_process(self, candidates: Candidates, seed: int, deadline: Deadline) -> Iterator[StartResult]:
        """Run the starts in this process; after a stop request the running one, or the first, ends with what it has."""
        for index, own in candidates:
            if deadline.is_requested() and index:
                break
            yield run_start(self.compiled, index, seed, deadline, candidates=own)

    def _in_processes(self, candidates: Candidates, seed: int, deadline: Deadline) -> Iterator[StartResult]:
        parcel, processes = cast("WorkerPayload[LazyCompiledProblem[_WorkItem]]", self._parcel), Processes(self.workers)
        waiting, pending, give_up = iter(candidates), dict[Future[StartResult], int](), None
        while True:
            for index, own in islice(waiting, max(0, WAITING * self.workers - len(pending))):
                try:
                    future = processes.submit(_run_start_in_worker, parcel, index, own, seed, deadline)
                except BrokenProcessPool:  # a worker has died since: the starts still to come have new ones
                    processes = Processes(self.workers)
                    future = processes.submit(_run_start_in_worker, parcel, index, own, seed, deadline)
                pending[future] = index
            if not pending:
                break
            done, _ = wait(pending, timeout=0.2, return_when=FIRST_COMPLETED)
            for future in done:
                yield _result(future, pending.pop(future))
            if deadline.is_requested() and pending:
                give_up = give_up or time.monotonic() + GRACE
                for future in [f for f in pending if f.cancel()]:
                    pending.pop(future)
                if time.monotonic() > give_up:
                    processes.end()
                    break


class ProblemWithOptions(Protocol):
    """Protocol of a problem with its solve options."""

    @property
    def problem(self) -> GraspProblem:
        """Problem to solve."""

    @property
    def options(self) -> SolveOptions:
        """Options of the solve."""


Case = TypeVar("Case", bound=ProblemWithOptions)


@dataclass(frozen=True)
class LazyCompiledProblem(Generic[Case]):
    """Compiled problem, built on first use in each process: compiled programs are not pickled.

    Parameters
    ----------
    make : callable
        Returns what is asked; called once in a process.
    """

    make: Callable[[], Case]

    @cached_property
    def case(self) -> Case:
        """Problem and options, made in this process."""
        return self.make()

    @cached_property
    def compiled(self) -> CompiledProblem:
        """Compiled problem."""
        return CompiledProblem(self.case.problem, self.case.options)


@dataclass(frozen=True)
class _WorkItem:
    """Problem with its solve options."""

    problem: GraspProblem
    options: SolveOptions


def _compile(parcel: WorkerPayload[LazyCompiledProblem[_WorkItem]]) -> None:
    """Compile the problem in a worker."""
    parcel.unpack().compiled.cutting_planes.functions  # noqa: B018


def _run_start_in_worker(
    parcel: WorkerPayload[LazyCompiledProblem[_WorkItem]],
    index: int,
    candidates: Sequence[GraspCandidate],
    seed: int,
    deadline: Deadline,
) -> StartResult:
    """Run one start in a worker, unless it is too late to begin any but the first."""
    if deadline.is_requested() and index:
        return StartResult(StartRecord(index, Status.TIME_LIMIT, message=NOT_BEGUN))
    return run_start(parcel.unpack().compiled, index, seed, deadline, candidates=candidates)


def _run_known_grasp(compiled: CompiledProblem, item: tuple[int, KnownGrasp], deadline: Deadline) -> list[StartGrasp]:
    """Run the starts from one known grasp."""
    return run_warm_start(compiled, WarmStart.of(compiled, item[1]), item[0], deadline)


def _run_part(
    parcel: WorkerPayload[LazyCompiledProblem[_WorkItem]], work: Callable[[CompiledProblem, Item], Found], item: Item
) -> Found:
    """Run a part of the remaining work in a worker."""
    return work(parcel.unpack().compiled, item)


def _wait_for_results(futures: Sequence[Future[Found]]) -> list[Found]:
    """Wait for parts of the remaining work; none of them where a worker ends."""
    try:
        return [future.result() for future in futures]
    except (BrokenProcessPool, CancelledError, OSError, RuntimeError):
        return []


def _result(future: Future[StartResult], index: int) -> StartResult:
    try:
        return future.result()
    except (BrokenProcessPool, CancelledError, OSError, SystemExit, ImportError) as error:
        return failed(index, RuntimeError(f"the worker process ended: {type(error).__name__}: {error}"))
