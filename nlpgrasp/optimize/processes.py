"""Worker processes, pickled payloads for them, and a context for linear algebra on one thread."""

from __future__ import annotations

import atexit
import os
import signal
import sys
import threading
import time
import uuid
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Generic, ParamSpec, TypeVar, cast

import casadi as ca
import cloudpickle
from loky import ProcessPoolExecutor, get_reusable_executor
from threadpoolctl import OpenBLASController, register, threadpool_limits

P = ParamSpec("P")
T = TypeVar("T")
Item = TypeVar("Item")
IDLE = 300.0  # seconds after which idle workers end
WATCH = 1.0  # seconds between checks that the parent is alive
# loky renews a worker that has grown by hundreds of megabytes, which is wanted and costs no task
warnings.filterwarnings("ignore", "A worker was restarted while some jobs", UserWarning)
_unpacked: dict[str, object] = {}
"""Item of the last payload unpacked in this process, by its token; one at most."""
_idle_processes: list[Processes] = []
"""Worker processes of the last ``separate_processes``, for the next context of as many; one pool at most."""
# the OpenBLAS that CasADi brings for IPOPT, which threadpoolctl does not know by its name
CasadiOpenBLAS = type("CasadiOpenBLAS", (OpenBLASController,), {"filename_prefixes": ("libcasadi-tp-openblas",)})
register(CasadiOpenBLAS)


class Processes:
    """Pool of worker processes: the shared one that solves reuse, or a separate one.

    loky's workers are fresh interpreters that never import the caller's main module: notebooks and scripts
    without a main guard work. When one dies, all tasks under way fail with ``BrokenProcessPool``, and the next
    ``Processes`` are new ones.

    Parameters
    ----------
    count : int
    executor : loky.ProcessPoolExecutor, optional
        Executor of as many processes, in place of the shared one.
    """

    def __init__(self, count: int, executor: Executor | None = None) -> None:
        self.count = count
        self._executor: Executor = executor or get_reusable_executor(
            count, timeout=IDLE, initializer=_prepare_worker, initargs=(os.getpid(),)
        )

    def submit(self, task: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Submit a call of a function of some module to the workers, and return its future.

        Raises
        ------
        BrokenProcessPool
            When a worker has died.
        """
        future = self._executor.submit(task, *args, **kwargs)
        # where idle workers had ended, loky starts new ones after its manager thread has listed the workers it watches:
        # an empty task makes it list them again, or the end of a new worker would go unseen and its task never end
        self._executor.submit(_do_nothing)
        return future

    def end(self) -> None:
        """End all workers at once, busy ones included."""
        # loky's shutdown has one more argument than the standard library's
        shutdown: Callable[..., None] = self._executor.shutdown
        shutdown(wait=True, kill_workers=True)


@contextmanager
def separate_processes(count: int, idle: float) -> Iterator[Processes]:
    """Return a context with worker processes that solves in this process do not use.

    They are kept for the next context of as many processes; where a context ends by an error, they end with it.

    Parameters
    ----------
    count : int
    idle : float
        Seconds after which idle workers end.
    """
    processes = _idle_processes.pop() if _idle_processes else None
    if processes is not None and processes.count != count:
        processes.end()
        processes = None
    if processes is None:
        executor = ProcessPoolExecutor(count, timeout=idle, initializer=_prepare_worker, initargs=(os.getpid(),))
        processes = Processes(count, executor)
    try:
        yield processes
    except BaseException:
        processes.end()
        raise
    while _idle_processes:
        _idle_processes.pop().end()
    _idle_processes.append(processes)


@dataclass(frozen=True)
class WorkerPayload(Generic[Item]):
    """Pickled payload for worker processes, with the caller's import path.

    Parameters
    ----------
    token : str
        The same for all payloads of one item: a process unpacks it once, and keeps it until another is unpacked.
    path : tuple of str
        The caller's ``sys.path``.
    content : bytes
        The pickled item.
    """

    token: str
    path: tuple[str, ...]
    content: bytes

    @classmethod
    def of(cls, item: Item, token: str = "") -> WorkerPayload[Item]:
        """Return the payload of an item; errors of its parts are raised."""
        return cls(token or uuid.uuid4().hex, tuple(sys.path), bytes(cloudpickle.dumps(item)))

    def unpack(self) -> Item:
        """Return the unpickled item, which this process keeps."""
        if self.token not in _unpacked:
            _unpacked.clear()  # before the next item is built: each may hold a gigabyte
            sys.path.extend(entry for entry in self.path if entry not in sys.path)  # before the item's imports
            _unpacked[self.token] = cloudpickle.loads(self.content)
        return cast("Item", _unpacked[self.token])


def single_thread() -> threadpool_limits:
    """Return a context in which numpy, scipy and IPOPT compute on one thread."""
    ca.has_nlpsol("ipopt")  # loads IPOPT's library: one that is loaded later would not be limited
    return threadpool_limits(1)


def cores() -> int:
    """Return the number of cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _prepare_worker(parent: int) -> None:
    """Prepare a worker: it ignores Ctrl-C, which its parent handles, and ends when the parent is gone."""
    atexit.register(_unpacked.clear)  # before extension modules count the objects that are left
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.dup2(2, 1)  # prints of scripts go to standard error: standard output is the parent's

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(WATCH)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _do_nothing() -> None:
    """Do nothing: an empty task."""
