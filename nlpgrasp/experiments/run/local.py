"""Solves over the cores of this machine."""

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
from nlpgrasp.solve.workers.processes import own_processes

IDLE = 30.0  # seconds after which workers that have nothing to do end
LOOK = 0.2  # seconds between looks at Ctrl-C, which a wait without end does not see everywhere


def run_local(
    solves: Sequence[SolveId], pack: Callable[[SolveId], Job], workers: int
) -> Generator[tuple[SolveId, Outcome], None, None]:
    """Yield each solve with its outcome as it is done, in any order.

    No more solves are under way than there are workers. When a worker process ends, all workers end with it, and
    nothing says which of the solves under way ended it: each of them is done again, alone, and the one that ends its
    process again has failed.
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
                del waiting[solve]  # else it was not begun: a worker ended before


def _until_broken(
    waiting: dict[SolveId, None], pack: Callable[[SolveId], Job], workers: int
) -> Generator[tuple[SolveId, Outcome], None, tuple[list[SolveId], str]]:
    """Yield outcomes, taking their solves from those waiting, until all are done or a worker ends.

    Returns the solves that were under way then, which go on waiting, and in words how the worker ended.
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
    """Do a job in a worker; a crash is reported by the parent, in one line."""
    faulthandler.disable()
    return work(job)
