"""Run of an experiment: missing solves are executed and stored as they finish."""

from __future__ import annotations

import json
from collections.abc import Callable, Generator
from contextlib import closing
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from nlpgrasp.common.shown.text import one_line
from nlpgrasp.common.validation import integer
from nlpgrasp.errors import InputError
from nlpgrasp.experiments.ask.experiment import Experiment, SolveId
from nlpgrasp.experiments.found.record import SolveRecord
from nlpgrasp.experiments.found.result import ExperimentResult
from nlpgrasp.experiments.found.stored import read_records
from nlpgrasp.experiments.run.cluster import ClusterLostError, connect, run_cluster
from nlpgrasp.experiments.run.folder import Folder
from nlpgrasp.experiments.run.hand_on import Handing
from nlpgrasp.experiments.run.local import run_local
from nlpgrasp.experiments.run.plan import plan_of
from nlpgrasp.experiments.run.work import Outcome, Packer
from nlpgrasp.optimize.workers.processes import cores
from nlpgrasp.solution.solution import GraspSolution

Progress = Callable[[SolveRecord], None]
INTERRUPTED = "Interrupted: go on with --resume; in Python with resume=True, of ng.solve_many by calling it again."
GO_ON = "What was written before is kept; go on with --resume."


def run_experiment(
    experiment: Experiment,
    out: str | Path,
    *,
    resume: bool = False,
    workers: int | None = None,
    scheduler: str | None = None,
    progress: Progress | None = None,
) -> ExperimentResult:
    """Solve every variation with every seed, and write each finished solve to a file in ``out`` at once.

    Then each grasp is certified under every other variation that it fits, and replaces a worse one there, so that no
    grasp of the table contradicts its ranking (docs/experiments.md).

    The same experiment gives the same grasps with any number of workers, on this machine or on a cluster.

    Parameters
    ----------
    experiment : Experiment
        Base problem, variations and seeds.
    out : str or Path
        Folder for the results: new or empty, or with ``resume`` the one of an earlier run of this experiment.
    resume : bool
        Run only missing solves: those not run, failed, or with an unreadable file. Variations and seeds may have been
        added. A variation that is a function is compared by its results then and now, solve by solve.
    workers : int, optional
        Processes on this machine; one a core when left out.
    scheduler : str, optional
        Address of a Dask scheduler, whose workers solve instead (extra ``cluster``).
    progress : callable, optional
        Called with the record of each solve: first those of earlier runs, then each when done.

    Returns
    -------
    ExperimentResult
        Also after Ctrl-C and with failures: it lists them. What cannot be written ends the run and is listed.

    Raises
    ------
    InputError
        Before anything runs: an output folder that is in use, of another experiment or not to be written, a
        scheduler that does not answer, variations that cannot be sent to workers.
    MissingExtraError
        For a scheduler without the extra ``cluster``.
    """
    if not isinstance(experiment, Experiment):
        raise InputError("experiment", experiment, "an ng.Experiment")
    if not isinstance(resume, bool):
        raise InputError("resume", resume, "True or False")
    if progress is not None and not callable(progress):
        raise InputError("progress", progress, "a function of a SolveRecord")
    return run_solves(experiment, Folder(out), resume, workers, scheduler, progress)


def run_solves(
    experiment: Experiment,
    place: Folder,
    resume: bool,
    workers: int | None,
    scheduler: str | None,
    progress: Progress | None,
    compared: bool = True,
) -> ExperimentResult:
    """Run the missing solves of an experiment in a folder; exchange grasps between ``compared`` variations.

    Raises
    ------
    InputError, MissingExtraError
        As ``run_experiment``.
    """
    if workers is not None:
        if scheduler is not None:
            raise InputError("workers", workers, "no number of workers with a scheduler: the cluster has its own")
        workers = integer("workers", workers, at_least=1, at_most=1024)
    pack = Packer(experiment, compared)
    for name in experiment.names:
        pack(SolveId(name, 0))  # raises errors now rather than hours later
    client = None if scheduler is None else connect(scheduler)
    try:
        place.open(plan_of(experiment), resume)
        run = _Run(experiment, place, progress)
        do = partial(run_local, workers=workers or cores()) if client is None else partial(run_cluster, client=client)
        if run.collect(do(run.missing(), pack)) and compared:
            run.hand_on(Handing(experiment, place, pack, do))
        return run.result()
    finally:
        place.close()
        if client is not None:
            client.close()


@dataclass
class _Run:
    """State of a run."""

    experiment: Experiment
    place: Folder
    progress: Progress | None
    records: dict[SolveId, SolveRecord] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    def missing(self) -> list[SolveId]:
        """Read the results of earlier runs; return the remaining solves."""
        self.place.sweep()
        known, self.notes = read_records(self.place, self.experiment.solves, self.place.plan())
        done = {solve: record for solve, record in known.items() if record.done}
        for solve, record in done.items():
            self._record(solve, record)
        return [solve for solve in self.experiment.solves if solve not in done]

    def collect(self, outcomes: Generator[tuple[SolveId, Outcome], None, None]) -> bool:
        """Store each outcome as it arrives, until all are there, the user interrupts, or writing fails.

        Returns whether all are there.
        """
        with closing(outcomes):
            try:
                for solve, outcome in outcomes:
                    self._keep(solve, outcome)
                return True
            except KeyboardInterrupt:
                self.notes.append(INTERRUPTED)
            except (_NotWrittenError, ClusterLostError) as error:
                self.notes.append(f"Stopped: {error}. {GO_ON}")
        return False

    def hand_on(self, handing: Handing) -> None:
        """Exchange grasps between the variations; after an error the solves' own results remain."""
        try:
            self.records |= handing.done(self.records)
        except KeyboardInterrupt:
            self.notes.append(INTERRUPTED)
        except (InputError, OSError, ClusterLostError) as error:
            self.notes.append(f"Grasps were not handed on between variations: {one_line(error)}. {GO_ON}")
        self.notes += handing.notes

    def result(self) -> ExperimentResult:
        """Return the result so far."""
        name = str(self.experiment.name)
        return ExperimentResult.of(name, self.place, self.experiment.solves, self.records, self.notes)

    def _keep(self, solve: SolveId, outcome: Outcome) -> None:
        if outcome.interrupted:
            return
        record = self._read(solve, outcome)
        try:
            if record.done:
                self.place.keep(solve, outcome.text)
            else:
                self.place.keep_failure(solve, record.failure)
        except InputError as error:
            self._record(solve, SolveRecord(solve.variation, solve.seed, failure=f"not written: {error}"))
            raise _NotWrittenError(str(error)) from None
        self._record(solve, record)

    def _read(self, solve: SolveId, outcome: Outcome) -> SolveRecord:
        """Return the record of an outcome; one of another problem than its variation's is a failure."""
        failure = outcome.failure
        if outcome.text:
            try:
                solution = GraspSolution.from_dict(json.loads(outcome.text), str(solve))
                record = SolveRecord.of(solve.variation, solve.seed, solution)
            except InputError as error:
                return SolveRecord(solve.variation, solve.seed, failure=one_line(error))
            others = {r.asked for s, r in self.records.items() if s.variation == solve.variation and r.done}
            if others <= {record.asked}:
                return record
            failure = "its function makes another problem than in an earlier run: use a new folder"
        return SolveRecord(solve.variation, solve.seed, failure=failure)

    def _record(self, solve: SolveId, record: SolveRecord) -> None:
        self.records[solve] = record
        if self.progress is not None:
            self.progress(record)


class _NotWrittenError(Exception):
    """Error on writing a result."""
