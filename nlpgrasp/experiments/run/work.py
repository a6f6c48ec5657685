"""Execution of one solve of an experiment in a worker process."""

from __future__ import annotations

import threading
import uuid
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial

from nlpgrasp.common.shown.text import one_line
from nlpgrasp.errors import InputError
from nlpgrasp.experiments.ask.experiment import Experiment, SolveId
from nlpgrasp.experiments.ask.variation import Case
from nlpgrasp.experiments.run.resume import improved
from nlpgrasp.optimize.workers.parcel import LazyBench, Parcel
from nlpgrasp.pipeline.solve import check_json, solve_again
from nlpgrasp.solution.file import text_of
from nlpgrasp.solution.many.found import FoundGrasp
from nlpgrasp.solution.records import Status
from nlpgrasp.solution.solution import GraspSolution

_one_at_a_time = threading.Lock()  # IPOPT's linear solver is not thread-safe


@dataclass(frozen=True)
class HandedOn:
    """Finished solve with grasps of other variations as its warm starts.

    Parameters
    ----------
    own : GraspSolution
        Solution of the solve.
    offers : mapping of str to FoundGrasp
        Grasps of other variations, by their origin as text.
    improve : bool
        Whether to refine the best of them.
    turn : int
        Number of earlier exchanges.
    """

    own: GraspSolution
    offers: Mapping[str, FoundGrasp]
    improve: bool
    turn: int


@dataclass(frozen=True)
class Job:
    """One solve as data for a worker.

    Parameters
    ----------
    solve : SolveId
    parcel : Parcel
        Data of the variation: workers keep the programs of the last variation.
    handed : HandedOn, optional
        Grasps to compare with, for a finished solve.
    """

    solve: SolveId
    parcel: Parcel[LazyBench[Case]]
    handed: HandedOn | None = None

    @property
    def key(self) -> str:
        """Unique name of the job in the run."""
        turn = "" if self.handed is None else f"-handed{self.handed.turn}"
        return f"nlpgrasp-{self.parcel.token}-{self.solve.seed}{turn}"


@dataclass(frozen=True)
class Outcome:
    """Outcome of one solve.

    Parameters
    ----------
    text : str
        The solution file; empty if the solve failed, or warm starts did not change it.
    failure : str
        Why it failed, in one line.
    interrupted : bool
        Whether the user interrupted it, so that it counts as not done.
    """

    text: str = ""
    failure: str = ""
    interrupted: bool = False


class Packer:
    """Factory of jobs, created on demand: only one variation is serialised at a time.

    Parameters
    ----------
    experiment : Experiment
    compared : bool
        Whether variations, and then their starts, are compared by mu.
    """

    def __init__(self, experiment: Experiment, compared: bool = True) -> None:
        self.experiment, self._compared = experiment, compared
        self._run = uuid.uuid4().hex
        self._last: tuple[str, Parcel[LazyBench[Case]]] | None = None

    def __call__(self, solve: SolveId) -> Job:
        """Return the job of a solve.

        Raises
        ------
        InputError
            When the variation has parts that cannot be sent to another process.
        """
        name = solve.variation
        if self._last is None or self._last[0] != name:
            try:
                parcel = Parcel.of(
                    LazyBench(partial(_made, self.experiment.maker(name), self._compared)), f"{self._run} {name}"
                )
            except Exception as error:  # any error of the parts' own pickling
                reason = one_line(error)
                raise InputError(f"variation {name!r}", reason, "parts that can be sent to other processes") from None
            self._last = (name, parcel)
        return Job(solve, self._last[1])


def work(job: Job) -> Outcome:
    """Solve in this process; any error becomes the outcome's message and stops no other solve."""
    with _one_at_a_time:
        try:
            asked, handed = job.parcel.unpacked(), job.handed
            if handed is not None:
                starts, seed = asked.case.starts, job.solve.seed
                better = improved(asked.bench, starts, handed.own, seed, handed.offers, handed.improve)
                return Outcome() if better is None else Outcome(text_of(better.to_dict()))
            solution = solve_again(asked.bench, asked.case.starts, job.solve.seed, asked.case.keeping)
            if solution.status is Status.INTERRUPTED:
                return Outcome(interrupted=True)
            return Outcome(text_of(solution.to_dict()))
        except BaseException as error:  # even SystemExit ends this solve alone
            return Outcome(failure=one_line(error))


def _made(maker: Callable[[], Case], compared: bool) -> Case:
    """Return the created case with a solve's options; refuse one whose result cannot be written."""
    case = maker()
    check_json(case.problem.to_dict())
    options = case.options.narrow()
    return replace(case, options=replace(options, rank="mu") if compared else options)
