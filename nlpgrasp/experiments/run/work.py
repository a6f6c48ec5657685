"""One solve of an experiment, as a worker process does it."""

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
from nlpgrasp.solution.file import text_of
from nlpgrasp.solution.many.found import FoundGrasp
from nlpgrasp.solution.records import Status
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.solve.solve import check_json, solve_again
from nlpgrasp.solve.workers.parcel import LazyBench, Parcel

_one_at_a_time = threading.Lock()  # IPOPT's linear solver is not for threads


@dataclass(frozen=True)
class HandedOn:
    """Finished solve and grasps of other variations as its warm starts.

    Parameters
    ----------
    own : GraspSolution
        Of the solve.
    offers : mapping of str to FoundGrasp
        Grasps of other variations, by their origin in words.
    improve : bool
        Whether to refine the best of them.
    turn : int
        How often grasps were handed on before.
    """

    own: GraspSolution
    offers: Mapping[str, FoundGrasp]
    improve: bool
    turn: int


@dataclass(frozen=True)
class Job:
    """One solve, ready to be sent to a worker.

    Parameters
    ----------
    solve : SolveId
    parcel : Parcel
        Of the variation in this run: workers keep the programs of the variation they solved last.
    handed : HandedOn, optional
        Where the solve is done: the grasps to compare it with.
    """

    solve: SolveId
    parcel: Parcel[LazyBench[Case]]
    handed: HandedOn | None = None

    @property
    def key(self) -> str:
        """A name that no other job of the run has."""
        turn = "" if self.handed is None else f"-handed{self.handed.turn}"
        return f"nlpgrasp-{self.parcel.token}-{self.solve.seed}{turn}"


@dataclass(frozen=True)
class Outcome:
    """What came of one solve.

    Parameters
    ----------
    text : str
        The solution file; empty where the solve failed, and where grasps of others did not change it.
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
    compared : bool
        Whether variations are compared with each other, by mu: then their starts are too.
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
            except Exception as error:  # whatever the parts' own pickling raises
                reason = one_line(error)
                raise InputError(f"variation {name!r}", reason, "parts that can be sent to other processes") from None
            self._last = (name, parcel)
        return Job(solve, self._last[1])


def work(job: Job) -> Outcome:
    """Solve in this process. Whatever goes wrong is the outcome's message: one solve never costs another."""
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
        except BaseException as error:  # also what a script raises to end itself: it ends this solve alone
            return Outcome(failure=one_line(error))


def _made(maker: Callable[[], Case], compared: bool) -> Case:
    """Return the case that is made, with options as a solve takes them, refusing one whose result cannot be written."""
    case = maker()
    check_json(case.problem.to_dict())
    options = case.options.narrow()
    return replace(case, options=replace(options, rank="mu") if compared else options)
