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
from typing import Generic, Protocol, TypeVar

from loky.process_executor import BrokenProcessPool

from nlpgrasp.common.deadline import Deadline
from nlpgrasp.errors import InputError
from nlpgrasp.global_bound.branch_and_bound import BranchAndBound
from nlpgrasp.optimize.candidate import GraspCandidate
from nlpgrasp.optimize.compiled_problem import CompiledProblem
from nlpgrasp.optimize.global_search import root_branch_and_bound
from nlpgrasp.optimize.options import SolveOptions
from nlpgrasp.optimize.processes import Processes, WorkerPayload, cores
from nlpgrasp.optimize.propose import BATCH
from nlpgrasp.optimize.start import failed_start, run_start
from nlpgrasp.optimize.start_result import StartGrasp, StartResult
from nlpgrasp.optimize.warm_starts import KnownGrasp, WarmStart, run_warm_start
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.solution.records import StartRecord, Status

NOT_BEGUN = "not begun"  # message of a start that was not run before a stop
WAITING = 4  # starts per worker that are under way or wait for one
GRACE = 10.0  # seconds for running starts to finish after a stop request
Item = TypeVar("Item")
Result = TypeVar("Result")
StartCandidates = Iterable[tuple[int, Sequence[GraspCandidate]]]
"""Indices of starts with the candidates of each."""


class StartRunner:
    """Runner of a problem's starts and analyses, in worker processes or the calling one.

    Worker processes hold the compiled programs. A worker that dies costs the starts in flight, which are reported as
    failed.

    Parameters
    ----------
    problem : GraspProblem
    options : SolveOptions
    starts : int
    compiled : CompiledProblem, optional
        The problem compiled already: the starts then run in this process.
    """

    def __init__(
        self, problem: GraspProblem, options: SolveOptions, starts: int, compiled: CompiledProblem | None = None
    ) -> None:
        self.problem, self.options, self.count = problem, options, starts
        self.workers = 1 if compiled is not None else min(options.workers or cores(), starts)
        self._programs = _ProblemPrograms(problem, options, compiled)

    @classmethod
    def with_kept_programs(cls, problem: GraspProblem, options: SolveOptions, starts: int) -> StartRunner:
        """Return a runner that reuses the kept programs if they are of the same problem and options."""
        last = _kept_programs.pop() if _kept_programs else None
        runner = cls(problem, options, starts)
        if last is not None and last.problem is problem and last.options == options:
            runner._programs = last
        return runner

    def keep_programs(self) -> None:
        """Keep the compiled programs for another solve of the same problem."""
        _kept_programs[:] = [self._programs]

    def branch_and_bound(self) -> BranchAndBound | None:
        """Return a copy of the branch and bound at its root nodes; None for problems that it does not cover.

        The root nodes are bounded once for all copies.
        """
        root = self._programs.root
        return None if root is None else root.copy()

    def prepare(self) -> None:
        """Begin to compile the problem in worker processes, where there are any."""
        if self.workers == 1:
            return
        payload, processes = self._programs.payload, Processes(self.workers)
        for _ in range(self.workers):
            processes.submit(_compile_in_worker, payload)

    def run_starts(
        self, candidates: StartCandidates, seed: int, deadline: Deadline, settled: int = BATCH
    ) -> Iterator[StartResult]:
        """Run starts from their indices and candidates, and yield each result as it completes.

        Of each batch of a hand's starts the first ``settled``, the best ones of the race, are polished to their local
        optimum. Others are a few percent below theirs, where a race ends; it follows where one of them is the answer.
        """
        if self.workers == 1:
            yield from self._run_in_process(candidates, seed, deadline, settled)
        else:
            yield from self._run_in_workers(candidates, seed, deadline, settled)

    def run_warm_starts(self, grasps: Sequence[KnownGrasp], first: int, deadline: Deadline) -> Iterator[StartResult]:
        """Yield two results for each known grasp, unchanged and refined, with indices from ``first`` on."""
        items = [(first + 2 * i, grasp) for i, grasp in enumerate(grasps)]
        for results in self.begin(partial(_run_known_grasp, deadline=deadline), items)():
            yield from results

    def run(self, work: Callable[[CompiledProblem, Item], Result], item: Item) -> Result | None:
        """Return the result of ``work`` on the compiled problem and an item; None if the worker dies.

        ``work`` is a function of some module.
        """
        return next(iter(self.begin(work, [item])()), None)

    def begin(
        self, work: Callable[[CompiledProblem, Item], Result], items: Sequence[Item]
    ) -> Callable[[], list[Result]]:
        """Begin ``work`` on the compiled problem and each item, and return a callable that waits for the results.

        ``work`` is a function of some module. There are no results if a worker dies. Without workers the work is done
        in the call.
        """
        if self.workers == 1 or not items:
            return lambda: [work(self.compiled, item) for item in items]
        payload, processes = self._programs.payload, Processes(self.workers)
        try:
            return partial(_wait_for_results, [processes.submit(_run_in_worker, payload, work, item) for item in items])
        except (BrokenProcessPool, OSError, RuntimeError):
            return list

    @property
    def compiled(self) -> CompiledProblem:
        """Compiled problem of this process, built on first use."""
        return self._programs.compiled

    def _run_in_process(
        self, candidates: StartCandidates, seed: int, deadline: Deadline, settled: int, rough: float = 0.1
    ) -> Iterator[StartResult]:
        """Yield the results of starts that run in this process, one after another.

        After a stop request no start is begun but that of index 0. The only start is the answer: with a hand as it is,
        else after a last step, before which its certificate need only have a relative gap of ``rough``.
        """
        rtol = None
        if self.count == 1:
            rtol = rough if self.compiled.follows_contacts else self.options.final_rtol
        for index, proposed in candidates:
            if deadline.should_stop() and index:
                break
            settles = index % BATCH < settled
            yield run_start(self.compiled, index, seed, deadline, candidates=proposed, rtol=rtol, settles=settles)

    def _run_in_workers(
        self, candidates: StartCandidates, seed: int, deadline: Deadline, settled: int
    ) -> Iterator[StartResult]:
        """Run starts in workers and yield their results; after a stop request they have ``GRACE`` seconds to end."""
        payload, processes = self._programs.payload, Processes(self.workers)
        waiting, pending, give_up = iter(candidates), dict[Future[StartResult], int](), None
        while True:
            for index, proposed in islice(waiting, max(0, WAITING * self.workers - len(pending))):
                work = index, proposed, seed, deadline, index % BATCH < settled
                try:
                    future = processes.submit(_run_start_in_worker, payload, *work)
                except BrokenProcessPool:  # a worker has died: the remaining starts run in new ones
                    processes = Processes(self.workers)
                    future = processes.submit(_run_start_in_worker, payload, *work)
                pending[future] = index
            if not pending:
                break
            completed, _ = wait(pending, timeout=0.2, return_when=FIRST_COMPLETED)
            for future in completed:
                yield _result_of(future, pending.pop(future))
            if deadline.should_stop() and pending:
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
    """Compiled problem that each process builds on first use, since compiled programs are not pickled.

    Parameters
    ----------
    make : callable
        Returns the problem with its options; called once in a process.
    """

    make: Callable[[], Case]

    @cached_property
    def problem_with_options(self) -> Case:
        """Problem and options, made in this process."""
        return self.make()

    @cached_property
    def compiled(self) -> CompiledProblem:
        """Compiled problem of this process, built on first use."""
        return CompiledProblem(self.problem_with_options.problem, self.problem_with_options.options)


@dataclass(frozen=True)
class _ProblemAndOptions:
    """Problem with its solve options."""

    problem: GraspProblem
    options: SolveOptions


_Payload = WorkerPayload[LazyCompiledProblem[_ProblemAndOptions]]


class _ProblemPrograms:
    """Compiled programs of a problem, and the payload from which each worker compiles its own.

    Parameters
    ----------
    problem : GraspProblem
    options : SolveOptions
    compiled : CompiledProblem, optional
        The problem compiled already.
    """

    def __init__(self, problem: GraspProblem, options: SolveOptions, compiled: CompiledProblem | None = None) -> None:
        self.problem, self.options = problem, options
        if compiled is not None:
            self.compiled = compiled

    @cached_property
    def compiled(self) -> CompiledProblem:
        """Compiled problem of this process."""
        return CompiledProblem(self.problem, self.options)

    @cached_property
    def root(self) -> BranchAndBound | None:
        """Branch and bound with its root nodes bounded, without an incumbent; None if the problem is not covered."""
        return root_branch_and_bound(self.problem, self.options)

    @cached_property
    def payload(self) -> _Payload:
        """Pickled problem for workers; raises an ``InputError`` if a part of it cannot be pickled."""
        try:
            return WorkerPayload.of(LazyCompiledProblem(partial(_ProblemAndOptions, self.problem, self.options)))
        except (TypeError, ValueError, AttributeError, pickle.PicklingError) as error:
            reason = f"{type(error).__name__}: {error}"
            raise InputError("problem", reason, "parts that can be sent to worker processes, or workers=1") from None


_kept_programs: list[_ProblemPrograms] = []
"""The last solve's, for a second solve of its problem object; one at most, as each may hold a hundred megabytes."""


def _compile_in_worker(payload: _Payload) -> None:
    """Compile the problem in a worker."""
    payload.unpack().compiled.cutting_planes.functions  # noqa: B018


def _run_start_in_worker(
    payload: _Payload, index: int, candidates: Sequence[GraspCandidate], seed: int, deadline: Deadline, settles: bool
) -> StartResult:
    """Return the result of one start; after a stop request only the first start is still run."""
    if deadline.should_stop() and index:
        return StartResult(StartRecord(index, Status.TIME_LIMIT, message=NOT_BEGUN))
    return run_start(payload.unpack().compiled, index, seed, deadline, candidates=candidates, settles=settles)


def _run_known_grasp(compiled: CompiledProblem, item: tuple[int, KnownGrasp], deadline: Deadline) -> list[StartGrasp]:
    """Return the results of the starts from one known grasp.

    ``item`` is the index of the first of these starts, and the grasp.
    """
    index, grasp = item
    return run_warm_start(compiled, WarmStart.of(compiled, grasp), index, deadline)


def _run_in_worker(payload: _Payload, work: Callable[[CompiledProblem, Item], Result], item: Item) -> Result:
    """Return the result of ``work`` on the compiled problem and an item, in a worker."""
    return work(payload.unpack().compiled, item)


def _wait_for_results(futures: Sequence[Future[Result]]) -> list[Result]:
    """Return the results of all futures; an empty list if a worker dies."""
    try:
        return [future.result() for future in futures]
    except (BrokenProcessPool, CancelledError, OSError, RuntimeError):
        return []


def _result_of(future: Future[StartResult], index: int) -> StartResult:
    """Return the result of a start; a failed one if its worker died."""
    try:
        return future.result()
    except (BrokenProcessPool, CancelledError, OSError, SystemExit, ImportError) as error:
        return failed_start(index, RuntimeError(f"the worker process ended: {type(error).__name__}: {error}"))
