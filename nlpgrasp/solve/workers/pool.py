"""Starts over the machine's cores, each result as it comes."""

from __future__ import annotations

import os
import pickle
import signal
import sys
import time
import uuid
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from typing import Any

import cloudpickle
from loky import get_reusable_executor
from loky.process_executor import BrokenProcessPool

from nlpgrasp.errors import InputError
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.solution.records import StartRecord, Status
from nlpgrasp.solve.after.look_back import Aftermath, look_back
from nlpgrasp.solve.options import SolveOptions
from nlpgrasp.solve.start.result import StartGrasp, StartResult
from nlpgrasp.solve.start.run import run_start
from nlpgrasp.solve.workbench.workbench import Workbench
from nlpgrasp.solve.workers.stop import Stop

NOT_BEGUN = "not begun"
GRACE = 10.0  # seconds in-flight starts get to finish after a stop
_benches: dict[str, Workbench] = {}


class Runner:
    """Runs the starts of one problem, and looks back at them, where the problem's programs are.

    loky's workers are fresh interpreters that never import the caller's main module: notebooks and scripts
    without a main guard work. A worker that dies costs the starts in flight, which are reported as failed.

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
        self._payload: tuple[list[str], bytes] | None = None
        self._token = uuid.uuid4().hex

    def starts(self, seed: int, stop: Stop) -> Iterator[StartResult]:
        """Yield each start's result as it is done, in any order."""
        if self.workers == 1:
            yield from self._here(seed, stop)
        else:
            yield from self._in_processes(seed, stop)

    def look_back(self, best: StartGrasp | None, results: Sequence[StartResult], seed: int, stop: Stop) -> Aftermath:
        """Return what is worth knowing after the starts; nothing where a worker ends over it."""
        if self._payload is None:
            return look_back(self._workbench(), best, results, seed, stop)
        executor = get_reusable_executor(max_workers=self.workers, timeout=300, initializer=_ignore_interrupt)
        seen = [] if best is not None else list(results)
        try:
            future = executor.submit(_look_back, self._token, self._payload, best, seen, seed, stop)
            found: Aftermath = future.result()
        except (BrokenProcessPool, CancelledError, OSError, RuntimeError):
            return Aftermath()
        return found

    def _workbench(self) -> Workbench:
        if self._bench is None:
            self._bench = Workbench(self.problem, self.options)
        return self._bench

    def _here(self, seed: int, stop: Stop) -> Iterator[StartResult]:
        """Run the starts in this process; once a stop is requested the running start finishes with what it has."""
        for index in range(self.count):
            if stop.requested():
                break
            yield run_start(self._workbench(), index, seed, stop)

    def _in_processes(self, seed: int, stop: Stop) -> Iterator[StartResult]:
        try:
            self._payload = (list(sys.path), cloudpickle.dumps((self.problem, self.options)))
        except (TypeError, ValueError, AttributeError, pickle.PicklingError) as error:
            reason = f"{type(error).__name__}: {error}"
            raise InputError("problem", reason, "parts that can be sent to worker processes, or workers=1") from None
        executor = get_reusable_executor(max_workers=self.workers, timeout=300, initializer=_ignore_interrupt)
        pending: dict[Future[Any], int] = {
            executor.submit(_work, self._token, self._payload, index, seed, stop): index for index in range(self.count)
        }
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
                    executor.shutdown(wait=True, kill_workers=True)
                    break


def _work(token: str, payload: tuple[list[str], bytes], index: int, seed: int, stop: Stop) -> StartResult | None:
    """Run one start in a worker."""
    if stop.requested():
        return None
    return run_start(_bench_of(token, payload), index, seed, stop)


def _look_back(
    token: str,
    payload: tuple[list[str], bytes],
    best: StartGrasp | None,
    results: list[StartResult],
    seed: int,
    stop: Stop,
) -> Aftermath:
    """Look back at the starts in a worker."""
    return look_back(_bench_of(token, payload), best, results, seed, stop)


def _bench_of(token: str, payload: tuple[list[str], bytes]) -> Workbench:
    """Return the problem's workbench in this worker, building it on the first call."""
    if token not in _benches:
        _benches.clear()
        problem, options = _loaded(payload)
        _benches[token] = Workbench(problem, options)
    return _benches[token]


def _loaded(payload: tuple[list[str], bytes]) -> tuple[GraspProblem, SolveOptions]:
    """Return problem and options, with the caller's import path: a script may have imported its neighbours."""
    path, pickled = payload
    sys.path.extend(entry for entry in path if entry not in sys.path)
    problem, options = cloudpickle.loads(pickled)
    return problem, options


def _result(future: Future[Any], index: int) -> StartResult:
    try:
        result = future.result()
    except (BrokenProcessPool, CancelledError, OSError, SystemExit, ImportError) as error:
        text = f"the worker process ended: {type(error).__name__}: {error}".splitlines()[0]
        return StartResult(StartRecord(index, Status.FAILED, message=text))
    if result is None:
        return StartResult(StartRecord(index, Status.TIME_LIMIT, message=NOT_BEGUN))
    return result  # type: ignore[no-any-return]


def cores() -> int:
    """Return the cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _ignore_interrupt() -> None:
    """Leave Ctrl-C to the parent, which tells the workers through the stop flag."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
