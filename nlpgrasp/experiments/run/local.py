"""Solves over the cores of this machine, by joblib."""

from __future__ import annotations

import faulthandler
import multiprocessing
import os
import re
import signal
import threading
import time
import warnings
from collections.abc import Callable, Generator, Iterator, Sequence
from typing import Any

from joblib import Parallel, delayed
from joblib.externals.loky.process_executor import BrokenProcessPool

from nlpgrasp.errors import InputError
from nlpgrasp.experiments.ask.experiment import SolveId
from nlpgrasp.experiments.run.work import Job, Outcome, work

WATCH = 1.0  # seconds between looks at whether the parent is there
IDLE = 30  # seconds after which workers that have nothing to do end


def run_local(
    solves: Sequence[SolveId], pack: Callable[[SolveId], Job], workers: int
) -> Iterator[tuple[SolveId, Outcome]]:
    """Yield each solve with its outcome as it is done, in any order.

    No more solves are under way than there are workers. When a worker process ends, joblib's pool ends with it, and
    nothing says which of the solves under way ended it: each of them is done again, alone, and the one that ends its
    process again has failed.
    """
    if multiprocessing.current_process().daemon:  # joblib would stay in this process, which a crash would end
        raise InputError("workers", "a daemonic process, which can have none", "a call from another process")
    waiting = dict.fromkeys(solves)
    while waiting:
        suspects, _ = yield from _until_broken(waiting, pack, workers)
        for solve in suspects:
            again, how = yield from _until_broken({solve: None}, pack, 1)
            if again:
                yield solve, Outcome(failure=f"its process ended, twice{how}: a crash, or out of memory")
            del waiting[solve]


def _until_broken(
    waiting: dict[SolveId, None], pack: Callable[[SolveId], Job], workers: int
) -> Generator[tuple[SolveId, Outcome], None, tuple[list[SolveId], str]]:
    """Yield outcomes, taking their solves from those waiting, until all are done or a worker ends.

    Returns the solves that were under way then, which go on waiting, and in words how the worker ended.
    """
    under_way: dict[SolveId, None] = {}

    def tasks() -> Iterator[Any]:
        for solve in list(waiting):
            under_way[solve] = None
            yield delayed(_guarded)(pack(solve))

    # with one job joblib would stay in this process, which a crash would end: two processes then, one of them idle
    pool = Parallel(
        n_jobs=max(workers, 2),
        pre_dispatch=workers,
        batch_size=1,
        backend="loky",
        max_nbytes=None,
        return_as="generator_unordered",
        initializer=_prepare,
        initargs=(os.getpid(),),
        idle_worker_timeout=IDLE,
    )
    results = pool(tasks())
    try:
        for solve, outcome in results:
            del under_way[solve], waiting[solve]
            yield solve, outcome
    except BrokenProcessPool as error:
        codes = re.search(r"\{(.+?)\}", str(error))  # such as {SIGSEGV(-11)}
        return list(under_way), f" ({codes[1]})" if codes else ""
    finally:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # that solves under way are cancelled: it is meant
            results.close()
    return [], ""


def _guarded(job: Job) -> tuple[SolveId, Outcome]:
    """Do a job in a worker."""
    faulthandler.disable()  # a crash is reported by the parent, in one line
    return job.solve, work(job)


def _prepare(parent: int) -> None:
    """Prepare a worker: Ctrl-C is for the parent, and a worker whose parent is gone ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.dup2(2, 1)  # what scripts print is not for the parent's standard output

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(WATCH)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
