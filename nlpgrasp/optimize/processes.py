"""Worker processes with single-threaded linear algebra, and the payload that is pickled for them."""

from __future__ import annotations

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
_unpacked: dict[str, object] = {}  # in this process: the item of the last parcel
_kept: list[Processes] = []  # those of the last context that had its own; at most one, and nobody's while it is here
# the OpenBLAS that CasADi brings for IPOPT, which threadpoolctl does not know by its name
CasadiOpenBLAS = type("CasadiOpenBLAS", (OpenBLASController,), {"filename_prefixes": ("libcasadi-tp-openblas",)})
register(CasadiOpenBLAS)


class Processes:
    """Pool of worker processes: shared by all solves of a thread and reused, or a separate one.

    loky's workers are fresh interpreters that never import the caller's main module: notebooks and scripts
    without a main guard work. When one dies, all tasks under way fail with ``BrokenProcessPool``, and the next
    ``Processes`` are new ones.

    Parameters
    ----------
    count : int
    own : loky.ProcessPoolExecutor, optional
        Of as many processes, in place of the shared ones.
    """

    def __init__(self, count: int, own: Executor | None = None) -> None:
        self.count = count
        self._executor: Executor = own or get_reusable_executor(
            count, timeout=IDLE, initializer=_prepare, initargs=(os.getpid(),)
        )

    def submit(self, task: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Return the future result of a function of some module, called in a worker.

        Raises
        ------
        BrokenProcessPool
            When a worker has died.
        """
        future = self._executor.submit(task, *args, **kwargs)
        # where idle workers had ended, loky starts new ones only after its watch has looked at who there is: an empty
        # task makes it look again, or the end of a new worker would go unseen and its task would never be done
        self._executor.submit(_do_nothing)
        return future

    def end(self) -> None:
        """End all workers now, whatever they do."""
        # loky's has one more argument than the standard library's
        shutdown: Callable[..., None] = self._executor.shutdown
        shutdown(wait=True, kill_workers=True)


@contextmanager
def separate_processes(count: int, idle: float) -> Iterator[Processes]:
    """Return a context with worker processes that nothing else in this process uses: solves meanwhile have others.

    They are kept for the next context that asks for as many; where a context ends by an error, they end with it.

    Parameters
    ----------
    count : int
    idle : float
        Seconds after which workers that have nothing to do end.
    """
    kept = _kept.pop() if _kept else None
    if kept is not None and kept.count != count:
        kept.end()
        kept = None
    if kept is None:
        own = ProcessPoolExecutor(count, timeout=idle, initializer=_prepare, initargs=(os.getpid(),))
        kept = Processes(count, own)
    try:
        yield kept
    except BaseException:
        kept.end()
        raise
    while _kept:
        _kept.pop().end()
    _kept.append(kept)


@dataclass(frozen=True)
class WorkerPayload(Generic[Item]):
    """Pickled payload for worker processes, with the caller's import path.

    Parameters
    ----------
    token : str
        The same for all parcels of one item: a process unpacks it once, and keeps it until another comes.
    path : tuple of str
        The caller's ``sys.path``.
    content : bytes
        The item.
    """

    token: str
    path: tuple[str, ...]
    content: bytes

    @classmethod
    def of(cls, item: Item, token: str = "") -> WorkerPayload[Item]:
        """Pickle an item; errors of its parts are raised."""
        return cls(token or uuid.uuid4().hex, tuple(sys.path), bytes(cloudpickle.dumps(item)))

    def unpack(self) -> Item:
        """Return the item in this process."""
        if self.token not in _unpacked:
            _unpacked.clear()  # before the next one is built: each may hold a gigabyte
            sys.path.extend(entry for entry in self.path if entry not in sys.path)  # before its modules are imported
            _unpacked[self.token] = cloudpickle.loads(self.content)
        return cast("Item", _unpacked[self.token])


def single_thread() -> threadpool_limits:
    """Return a context in which numpy, scipy and IPOPT compute on one thread."""
    ca.has_nlpsol("ipopt")  # loads it: a library that is loaded later would not be limited
    return threadpool_limits(1)


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


def _do_nothing() -> None:
    """Do nothing, in a worker."""
