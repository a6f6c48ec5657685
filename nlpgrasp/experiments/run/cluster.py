"""Execution of solves on a Dask cluster (extra ``cluster``)."""

from __future__ import annotations

import re
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import CancelledError
from typing import TYPE_CHECKING

from nlpgrasp.common.shown.text import one_line
from nlpgrasp.errors import InputError, MissingExtraError, NlpgraspError
from nlpgrasp.experiments.ask.experiment import SolveId
from nlpgrasp.experiments.run.work import Job, Outcome, work

if TYPE_CHECKING:
    from distributed import Client, Future

ADDRESS = re.compile(r"([a-z]+://)?[^\s/]+:\d+")
REACHED = 10  # seconds: timeout for reaching a scheduler
AHEAD = 2  # queued solves per worker
LEAST_WINDOW = 4


def connect(address: str) -> Client:
    """Return a client of a Dask scheduler.

    Raises
    ------
    MissingExtraError
        Without the extra ``cluster``.
    InputError
        When no scheduler answers at the address.
    """
    try:
        from distributed import Client
    except ImportError:
        raise MissingExtraError("a Dask scheduler", "cluster") from None
    allowed = "the address of a running Dask scheduler, such as tcp://host:8786"
    if not isinstance(address, str) or not ADDRESS.fullmatch(address):
        raise InputError("scheduler", address, allowed)
    try:
        return Client(address, timeout=REACHED, set_as_default=False)
    except Exception as error:  # every kind of address has its own errors
        raise InputError("scheduler", f"{address} ({type(error).__name__}: nobody answers)", allowed) from None


def run_cluster(
    solves: Sequence[SolveId], pack: Callable[[SolveId], Job], client: Client
) -> Generator[tuple[SolveId, Outcome], None, None]:
    """Yield each solve with its outcome when done, in any order.

    A few solves per worker are submitted at a time. Those of a terminated worker are repeated by others; a solve that
    terminates several workers has failed (Dask's ``allowed-failures``).
    """
    from distributed import as_completed

    waiting = iter(solves)
    under_way: dict[Future, SolveId] = {}
    done = as_completed(loop=client.loop)

    def submit() -> None:
        while len(under_way) < _window(client):
            solve = next(waiting, None)
            if solve is None:
                return
            job = pack(solve)
            future = client.submit(work, job, pure=False, key=job.key)
            under_way[future] = solve
            done.add(future)

    try:
        submit()
        for future in done:
            solve = under_way.pop(future)
            yield solve, _outcome(future)
            submit()
    except (OSError, RuntimeError, KeyError, CancelledError) as error:  # errors of distributed without a scheduler
        raise ClusterLostError(f"the cluster was lost ({type(error).__name__})") from None


def _window(client: Client) -> int:
    """Return the number of solves that may be submitted, for the cluster's current size."""
    return max(LEAST_WINDOW, AHEAD * len(client.scheduler_info(n_workers=-1)["workers"]))


class ClusterLostError(NlpgraspError):
    """Error on losing the scheduler during a run."""


def _outcome(future: Future) -> Outcome:
    if future.status == "finished":
        result: Outcome = future.result()
        return result
    error = future.exception() if future.status == "error" else None
    if error is None:
        raise ClusterLostError("the cluster lost a solve")
    return Outcome(failure=one_line(error))
