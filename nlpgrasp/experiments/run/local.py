"""Execution of solves on local processes."""

from __future__ import annotations

import faulthandler
import multiprocessing
import re
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from itertools import islice

from loky.process_executor import BrokenProcessPool

from nlpgrasp.errors import InputError
from nlpgrasp.experiments.ask.experiment import SolveId
from nlpgrasp.experiments.run.work import Job, Outcome, work
from nlpgrasp.optimize.workers.processes import own_processes

IDLE = 30.0  # seconds after which idle workers end
LOOK = 0.2  # seconds between checks for Ctrl-C, which an endless wait misses on some systems


def run_local(
    solves: Sequence[SolveId], pack: Callable[[SolveId], Job], workers: int
) -> Generator[tuple[SolveId, Outcome], None, None]:
    """Yield each solve with its outcome when done, in any order.

    At most one solve per worker is active. When a worker process crashes, all workers end, and the guilty solve is
    unknown: each active solve is repeated alone, and one that crashes its process again has failed.
    """
    if multiprocessing.current_process().daemon:
        raise InputError("workers", "a daemonic process, which can have none", "a call from another process")
    waiting = dict.fromkeys(solves)
    while waiting:
        suspects, _ = yield from _until_broken(waiting, pack, workers)
        for solve in suspects:
            alone = {solve: None}
            again, how = yield from _until_broken(alone, pack, 1)
            if again:
                yield solve, Outcome(failure=f"its process ended, twice{how}: a crash, or out of memory")
            if again or not alone:
                del waiting[solve]  # else it was not started: a worker crashed before


def _until_broken(
    waiting: dict[SolveId, None], pack: Callable[[SolveId], Job], workers: int
) -> Generator[tuple[SolveId, Outcome], None, tuple[list[SolveId], str]]:
    """Yield outcomes of waiting solves until all are done or a worker crashes.

    Returns the solves that were active then, which stay waiting, and how the worker ended, as text.
    """
    left = iter(list(waiting))
    under_way: dict[Future[Outcome], SolveId] = {}
    try:
        with own_processes(workers, IDLE) as processes:
            while True:
                for solve in islice(left, workers - len(under_way)):
                    under_way[processes.submit(_quietly, pack(solve))] = solve
                if not under_way:
                    return [], ""
                done, _ = wait(under_way, timeout=LOOK, return_when=FIRST_COMPLETED)
                for future in sorted(done, key=lambda one: one.exception() is not None):
                    outcome = future.result()
                    solve = under_way.pop(future)
                    del waiting[solve]
                    yield solve, outcome
    except BrokenProcessPool as error:
        codes = re.search(r"\{(.+?)\}", str(error))  # such as {SIGSEGV(-11)}
        return list(under_way.values()), f" ({codes[1]})" if codes else ""


def _quietly(job: Job) -> Outcome:
    """Run a job in a worker; the parent reports a crash in one line."""
    faulthandler.disable()
    return work(job)
