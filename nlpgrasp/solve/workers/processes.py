"""The worker processes of this one: for starts of a solve, and for solves of an experiment."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable
from concurrent.futures import Executor, Future
from typing import ParamSpec, TypeVar

from loky import get_reusable_executor

P = ParamSpec("P")
T = TypeVar("T")
IDLE = 300.0  # seconds after which workers that have nothing to do end
WATCH = 1.0  # seconds between looks at whether the parent is there


class Processes:
    """Worker processes, kept from one use to the next.

    loky's workers are fresh interpreters that never import the caller's main module: notebooks and scripts
    without a main guard work. When one dies, all tasks under way fail with ``BrokenProcessPool``, and the next
    ``Processes`` are new ones.

    Parameters
    ----------
    count : int
    idle : float
        Seconds after which workers that have nothing to do end.
    """

    def __init__(self, count: int, idle: float = IDLE) -> None:
        self._executor: Executor = get_reusable_executor(
            count, timeout=idle, initializer=_prepare, initargs=(os.getpid(),)
        )

    def submit(self, task: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Return the future result of a function of some module, called in a worker.

        Raises
        ------
        BrokenProcessPool
            When a worker has died.
        """
        return self._executor.submit(task, *args, **kwargs)

    def end(self) -> None:
        """End all workers now, whatever they do."""
        shutdown: Callable[..., None] = (
            self._executor.shutdown
        )  # loky's has one more argument than the standard library's
        shutdown(wait=True, kill_workers=True)


def cores() -> int:
    """Return the cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _prepare(parent: int) -> None:
    """Prepare a worker: Ctrl-C is for the parent, which tells its workers, and a worker whose parent is gone ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.dup2(2, 1)  # what scripts print is not for the parent's standard output

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(WATCH)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
