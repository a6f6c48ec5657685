"""One solve of an experiment, as a worker process does it."""

from __future__ import annotations

import pickle
import sys
import threading
import uuid
from collections.abc import Callable
from dataclasses import dataclass

import cloudpickle

from nlpgrasp.common.shown.text import one_line
from nlpgrasp.errors import InputError
from nlpgrasp.experiments.ask.experiment import Experiment, SolveId
from nlpgrasp.experiments.ask.variation import Case
from nlpgrasp.solution.file import text_of
from nlpgrasp.solution.records import Status
from nlpgrasp.solve.solve import check_json, solve_again
from nlpgrasp.solve.workbench.workbench import Workbench

_benches: dict[str, tuple[Workbench, int]] = {}
_one_at_a_time = threading.Lock()  # IPOPT's linear solver is not for threads


@dataclass(frozen=True)
class Job:
    """One solve, ready to be sent to a worker.

    Parameters
    ----------
    solve : SolveId
    token : str
        Of the variation in this run: workers keep the programs of the variation they solved last.
    payload : bytes
        The caller's import path and what makes the case, pickled.
    """

    solve: SolveId
    token: str
    payload: bytes


@dataclass(frozen=True)
class Outcome:
    """What came of one solve.

    Parameters
    ----------
    text : str
        The solution file; empty where the solve failed.
    failure : str
        Why it failed, in one line.
    interrupted : bool
        Whether the user stopped it: it counts as not done.
    """

    text: str = ""
    failure: str = ""
    interrupted: bool = False


class Packer:
    """Makes jobs of an experiment's solves when their turn comes: only one variation is held as bytes.

    Parameters
    ----------
    experiment : Experiment
    """

    def __init__(self, experiment: Experiment) -> None:
        self.experiment = experiment
        self._run = uuid.uuid4().hex
        self._last: tuple[str, bytes] = ("", b"")

    def __call__(self, solve: SolveId) -> Job:
        """Return the job of a solve.

        Raises
        ------
        InputError
            When the variation has parts that cannot be sent to another process.
        """
        name = solve.variation
        if self._last[0] != name:
            try:
                payload = cloudpickle.dumps((list(sys.path), self.experiment.maker(name)))
            except Exception as error:  # whatever the parts' own pickling raises
                reason = one_line(error)
                raise InputError(f"variation {name!r}", reason, "parts that can be sent to other processes") from None
            self._last = (name, bytes(payload))
        return Job(solve, f"{self._run} {name}", self._last[1])


def work(job: Job) -> Outcome:
    """Solve in this process. Whatever goes wrong is the outcome's message: one solve never costs another."""
    with _one_at_a_time:
        try:
            bench, starts = _bench_of(job)
            solution = solve_again(bench, starts, job.solve.seed)
            if solution.status is Status.INTERRUPTED:
                return Outcome(interrupted=True)
            return Outcome(text_of(solution.to_dict()))
        except BaseException as error:  # also what a script raises to end itself: it ends this solve alone
            return Outcome(failure=one_line(error))


def _bench_of(job: Job) -> tuple[Workbench, int]:
    """Return the variation's workbench and number of starts, built on its first solve in this process."""
    if job.token not in _benches:
        _benches.clear()
        path, maker = pickle.loads(job.payload)  # noqa: S301  (made by this package, a moment ago)
        _extend_path(path)
        case = _made(maker)
        _benches[job.token] = Workbench(case.problem, case.options), case.starts
    return _benches[job.token]


def _made(maker: Callable[[], Case]) -> Case:
    case = maker()
    check_json(case.problem.to_dict())
    return case


def _extend_path(path: list[str]) -> None:
    """Add the caller's import path: a script may have imported its neighbours."""
    sys.path.extend(entry for entry in path if entry not in sys.path)
