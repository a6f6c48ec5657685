"""Starts over the machine's cores, each result as it comes."""

from __future__ import annotations

import os
import signal
import threading
import time
import uuid
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from typing import Any

import cloudpickle
from loky import get_reusable_executor
from loky.process_executor import BrokenProcessPool

from nlpgrasp.problem import GraspProblem
from nlpgrasp.solution import StartRecord, Status
from nlpgrasp.solve.options import SolveOptions
from nlpgrasp.solve.start import StartResult, run_start
from nlpgrasp.solve.stop import Stop
from nlpgrasp.solve.workbench import Workbench

GRACE = 10.0  # seconds in-flight starts get to finish after a stop
_benches: dict[str, Workbench] = {}


class StartsInterrupted(Exception):  # noqa: N818 - a signal between layers, not an error a user sees
    """The user interrupted; what was found before has been yielded."""


def run_starts(
    problem: GraspProblem, options: SolveOptions, starts: int, seed: int, stop: Stop
) -> Iterator[StartResult]:
    """Yield each start's result as it is done, in any order.

    loky's workers are fresh interpreters that never import the caller's main module: notebooks and scripts
    without a main guard work. A worker that dies costs the starts in flight, which are reported as failed.

    Raises
    ------
    StartsInterrupted
        After Ctrl-C, once the starts in flight have handed in what they had.
    """
    workers = min(options.workers or _cores(), starts)
    if workers == 1:
        yield from _here(problem, options, starts, seed, stop)
    else:
        yield from _in_processes(problem, options, starts, seed, stop, workers)


def _here(problem: GraspProblem, options: SolveOptions, starts: int, seed: int, stop: Stop) -> Iterator[StartResult]:
    """Run the starts in this process; Ctrl-C asks the running start to finish with what it has."""
    bench = Workbench(problem, options)
    with _Interrupt(stop) as interrupt:
        for index in range(starts):
            if stop.requested():
                break
            yield run_start(bench, index, seed, stop)
    if interrupt.caught:
        raise StartsInterrupted


def _in_processes(
    problem: GraspProblem, options: SolveOptions, starts: int, seed: int, stop: Stop, workers: int
) -> Iterator[StartResult]:
    payload = cloudpickle.dumps((problem, options))
    token = uuid.uuid4().hex
    executor = get_reusable_executor(max_workers=workers, timeout=300, initializer=_ignore_interrupt)
    with _Interrupt(stop) as interrupt:
        pending: dict[Future[Any], int] = {
            executor.submit(_work, token, payload, index, seed, stop): index for index in range(starts)
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
    if interrupt.caught:
        raise StartsInterrupted


def _work(token: str, payload: bytes, index: int, seed: int, stop: Stop) -> StartResult | None:
    """Run one start in a worker, building the problem's workbench on the first one it sees."""
    if stop.requested():
        return None
    if token not in _benches:
        _benches.clear()
        problem, options = cloudpickle.loads(payload)
        _benches[token] = Workbench(problem, options)
    return run_start(_benches[token], index, seed, stop)


def _result(future: Future[Any], index: int) -> StartResult:
    try:
        result = future.result()
    except (BrokenProcessPool, CancelledError, OSError) as error:
        text = f"the worker process ended: {type(error).__name__}"
        return StartResult(StartRecord(index, Status.FAILED, message=text))
    if result is None:
        return StartResult(StartRecord(index, Status.TIME_LIMIT, message="not begun"))
    return result  # type: ignore[no-any-return]


def _cores() -> int:
    """Return the cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _ignore_interrupt() -> None:
    """Leave Ctrl-C to the parent, which tells the workers through the stop flag."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


class _Interrupt:
    """While active, the first Ctrl-C raises the stop flag instead of an exception; the second one is as usual."""

    def __init__(self, stop: Stop) -> None:
        self.stop = stop
        self.caught = False
        self._previous: Any = None

    def __enter__(self) -> _Interrupt:
        if threading.current_thread() is threading.main_thread():
            self._previous = signal.getsignal(signal.SIGINT)
            signal.signal(signal.SIGINT, self._handle)
        return self

    def __exit__(self, *_: object) -> None:
        if self._previous is not None:
            signal.signal(signal.SIGINT, self._previous)

    def _handle(self, *_: object) -> None:
        if self.caught:
            signal.signal(signal.SIGINT, self._previous or signal.default_int_handler)
        self.caught = True
        if self.stop.flag is not None:
            self.stop.flag.touch()
