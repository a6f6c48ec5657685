"""Run of an experiment on local processes or a Dask cluster: missing solves are executed and stored as they finish."""

from __future__ import annotations

import faulthandler
import json
import multiprocessing
import re
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from contextlib import closing
from dataclasses import dataclass, field
from functools import partial
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

from loky.process_executor import BrokenProcessPool

from nlpgrasp.common.formatting import one_line
from nlpgrasp.common.validation import integer
from nlpgrasp.errors import InputError, MissingExtraError, NlpgraspError
from nlpgrasp.experiments.experiment import Experiment, SolveId
from nlpgrasp.experiments.experiment_result import ExperimentResult, read_records
from nlpgrasp.experiments.output_folder import OutputFolder, plan_of
from nlpgrasp.experiments.solve_job import Job, JobFactory, Outcome, work
from nlpgrasp.experiments.solve_record import SolveRecord
from nlpgrasp.experiments.warm_start_exchange import WarmStartExchange
from nlpgrasp.optimize.processes import cores, separate_processes
from nlpgrasp.solution.solution import GraspSolution

if TYPE_CHECKING:
    from distributed import Client
    from distributed import Future as ClusterFuture


IDLE = 30.0  # seconds after which idle workers end
LOOK = 0.2  # seconds between checks for Ctrl-C, which an endless wait misses on some systems
ADDRESS = re.compile(r"([a-z]+://)?[^\s/]+:\d+")  # of a Dask scheduler
REACHED = 10  # seconds: timeout for reaching a scheduler
AHEAD = 2  # queued solves per worker
LEAST_WINDOW = 4  # least number of queued solves
INTERRUPTED = "Interrupted: go on with --resume; in Python with resume=True, of ng.solve_many by calling it again."
GO_ON = "What was written before is kept; go on with --resume."


Progress = Callable[[SolveRecord], None]


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
    return run_solves(experiment, OutputFolder(out), resume, workers, scheduler, progress)


def run_solves(
    experiment: Experiment,
    place: OutputFolder,
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
    pack = JobFactory(experiment, compared)
    for name in experiment.names:
        pack(SolveId(name, 0))  # raises errors now rather than hours later
    client = None if scheduler is None else connect(scheduler)
    try:
        place.open(plan_of(experiment), resume)
        run = _Run(experiment, place, progress)
        do = partial(run_local, workers=workers or cores()) if client is None else partial(run_cluster, client=client)
        if run.collect(do(run.missing(), pack)) and compared:
            run._exchange_warm_starts(WarmStartExchange(experiment, place, pack, do))
        return run.result()
    finally:
        place.close()
        if client is not None:
            client.close()


@dataclass
class _Run:
    """State of a run."""

    experiment: Experiment
    place: OutputFolder
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
            except (_WriteError, ClusterLostError) as error:
                self.notes.append(f"Stopped: {error}. {GO_ON}")
        return False

    def _exchange_warm_starts(self, handing: WarmStartExchange) -> None:
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
                self.place.write_solution(solve, outcome.text)
            else:
                self.place.write_failure(solve, record.failure)
        except InputError as error:
            self._record(solve, SolveRecord(solve.variation, solve.seed, failure=f"not written: {error}"))
            raise _WriteError(str(error)) from None
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


class _WriteError(Exception):
    """Error on writing a result."""


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
        suspects, _ = yield from _outcomes_until_crash(waiting, pack, workers)
        for solve in suspects:
            alone = {solve: None}
            again, how = yield from _outcomes_until_crash(alone, pack, 1)
            if again:
                yield solve, Outcome(failure=f"its process ended, twice{how}: a crash, or out of memory")
            if again or not alone:
                del waiting[solve]  # else it was not started: a worker crashed before


def _outcomes_until_crash(
    waiting: dict[SolveId, None], pack: Callable[[SolveId], Job], workers: int
) -> Generator[tuple[SolveId, Outcome], None, tuple[list[SolveId], str]]:
    """Yield outcomes of waiting solves until all are done or a worker crashes.

    Returns the solves that were active then, which stay waiting, and how the worker ended, as text.
    """
    left = iter(list(waiting))
    under_way: dict[Future[Outcome], SolveId] = {}
    try:
        with separate_processes(workers, IDLE) as processes:
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


def run_cluster(
    solves: Sequence[SolveId], pack: Callable[[SolveId], Job], client: Client
) -> Generator[tuple[SolveId, Outcome], None, None]:
    """Yield each solve with its outcome when done, in any order.

    A few solves per worker are submitted at a time. Those of a terminated worker are repeated by others; a solve that
    terminates several workers has failed (Dask's ``allowed-failures``).
    """
    from distributed import as_completed

    waiting = iter(solves)
    under_way: dict[ClusterFuture, SolveId] = {}
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


class ClusterLostError(NlpgraspError):
    """Error on losing the scheduler during a run."""


def _outcome(future: ClusterFuture) -> Outcome:
    if future.status == "finished":
        result: Outcome = future.result()
        return result
    error = future.exception() if future.status == "error" else None
    if error is None:
        raise ClusterLostError("the cluster lost a solve")
    return Outcome(failure=one_line(error))
