"""Run of an experiment on local processes or a Dask cluster."""

from __future__ import annotations

import faulthandler
import json
import multiprocessing
import re
from collections.abc import Callable, Generator, Hashable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from contextlib import closing
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from loky.process_executor import BrokenProcessPool

from nlpgrasp.common.formatting import error_line
from nlpgrasp.common.validation import integer
from nlpgrasp.errors import InputError, MissingExtraError, NlpgraspError
from nlpgrasp.experiments.experiment import Experiment, SolveId
from nlpgrasp.experiments.experiment_result import ExperimentResult, read_records
from nlpgrasp.experiments.output_folder import OutputFolder, plan_of
from nlpgrasp.experiments.solve_job import JobFactory, Outcome, RunnableJob, run_job
from nlpgrasp.experiments.solve_record import SolveRecord
from nlpgrasp.experiments.warm_start_exchange import WarmStartExchange
from nlpgrasp.optimize.processes import cores, separate_processes
from nlpgrasp.problem.identity import ProblemIdentity
from nlpgrasp.solution.solution import GraspSolution

if TYPE_CHECKING:
    from distributed import Client
    from distributed import Future as ClusterFuture


IDLE_SECONDS = 30.0  # seconds after which idle workers end
POLL_SECONDS = 0.2  # seconds between checks for Ctrl-C, which an endless wait misses on some systems
ADDRESS = re.compile(r"([a-z]+://)?[^\s/]+:\d+")  # of a Dask scheduler
CONNECT_SECONDS = 10  # seconds: timeout for reaching a scheduler
QUEUED_PER_WORKER = 2  # queued solves per worker
LEAST_WINDOW = 4  # least number of queued solves
INTERRUPTED = "Interrupted: go on with --resume; in Python with resume=True, of ng.solve_many by calling it again."
RESUME_HINT = "What was written before is kept; go on with --resume."


NO_PROBLEM = "none"  # digest that no solution states

Progress = Callable[[SolveRecord], None]
Key = TypeVar("Key", bound=Hashable)  # of a job: a solve, or a unit of a data set


def run_experiment(
    experiment: Experiment,
    out: str | Path,
    *,
    resume: bool = False,
    workers: int | None = None,
    scheduler: str | None = None,
    progress: Progress | None = None,
) -> ExperimentResult:
    """Solve every variation with every seed, and write each solution to a file in ``out`` as soon as it is done.

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
        Run only missing solves: those not run, failed, with an unreadable file, or of another problem: after a change
        of an expression, a function or the package's version, and where a function cannot be compared, which
        ``notes`` say. Variations and seeds may have been added. A variation that is a function is called for that.
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
    folder: OutputFolder,
    resume: bool,
    workers: int | None,
    scheduler: str | None,
    progress: Progress | None,
    is_compared: bool = True,
) -> ExperimentResult:
    """Run the missing solves of an experiment in a folder.

    If ``is_compared``, grasps are then exchanged between variations as warm starts.

    Raises
    ------
    InputError, MissingExtraError
        As ``run_experiment``.
    """
    if workers is not None:
        if scheduler is not None:
            raise InputError("workers", workers, "no number of workers with a scheduler: the cluster has its own")
        workers = integer("workers", workers, at_least=1, at_most=1024)
    identities = {name: experiment.case(name).identity() for name in experiment.names if not experiment.deferred(name)}
    factory = JobFactory(experiment, {name: identity.digest for name, identity in identities.items()}, is_compared)
    for name in experiment.names:
        factory(SolveId(name, 0))  # raises errors now rather than hours later
    client = None if scheduler is None else connect(scheduler)
    try:
        folder.open(plan_of(experiment, factory.digests), resume)
        run = _Run(experiment, folder, progress, identities)
        run_jobs = partial(run_local, workers=workers or cores())
        if client is not None:
            run_jobs = partial(run_cluster, client=client)
        if run.collect(run_jobs(run.missing(), factory)) and is_compared:
            run.exchange_warm_starts(WarmStartExchange(experiment, folder, factory, run_jobs))
        return run.result()
    finally:
        folder.close()
        if client is not None:
            client.close()


@dataclass
class _Run:
    """Run of an experiment, with records and notes so far."""

    experiment: Experiment
    folder: OutputFolder
    progress: Progress | None
    identities: dict[str, ProblemIdentity]
    records: dict[SolveId, SolveRecord] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    def missing(self) -> list[SolveId]:
        """Read the results of earlier runs, and return the solves that are missing or of another problem."""
        self.folder.remove_partial_files()
        digests = {name: self._digest_of_earlier(name) for name in self._names_with_solutions()}
        records, notes = read_records(self.folder, self.experiment.solves, digests)
        self.notes += [f"{note}; solved anew" for note in notes]
        solved = {solve: record for solve, record in records.items() if record.done}
        for solve, record in solved.items():
            self._add_record(solve, record)
        return [solve for solve in self.experiment.solves if solve not in solved]

    def _names_with_solutions(self) -> Iterator[str]:
        """Yield the names of the variations that have a solution file."""
        for name in self.experiment.names:
            if any(self.folder.solution_file(SolveId(name, seed)).exists() for seed in self.experiment.seeds):
                yield name

    def _digest_of_earlier(self, name: str) -> str:
        """Return the digest that earlier solutions of a variation have to state; note why none can be of its problem.

        The problem of a variation that is a function is made for that.
        """
        try:
            identity = self.identities.get(name) or self.experiment.case(name).identity()
        except Exception as error:  # of the user's function: its solves state the same
            self.notes.append(f"{name}: {error_line(error)}")
            return NO_PROBLEM
        if identity.obstacle:
            self.notes.append(f"{name}: {identity.advice}")
        return identity.digest

    def collect(self, outcomes: Generator[tuple[SolveId, Outcome], None, None]) -> bool:
        """Store each outcome when it arrives, and return whether all have arrived.

        It stops early when the user interrupts, writing fails or the scheduler is lost, which becomes a note.
        """
        with closing(outcomes):
            try:
                for solve, outcome in outcomes:
                    self._store(solve, outcome)
                return True
            except KeyboardInterrupt:
                self.notes.append(INTERRUPTED)
            except (_WriteError, ClusterLostError) as error:
                self.notes.append(f"Stopped: {error}. {RESUME_HINT}")
        return False

    def exchange_warm_starts(self, exchange: WarmStartExchange) -> None:
        """Exchange grasps between the variations as warm starts.

        After an error the solves' own results remain.
        """
        try:
            self.records |= exchange.exchange(self.records)
        except KeyboardInterrupt:
            self.notes.append(INTERRUPTED)
        except (InputError, OSError, ClusterLostError) as error:
            self.notes.append(f"Grasps were not handed on between variations: {error_line(error)}. {RESUME_HINT}")
        self.notes += exchange.notes

    def result(self) -> ExperimentResult:
        """Return the experiment's result so far."""
        name = str(self.experiment.name)
        return ExperimentResult.of(name, self.folder, self.experiment.solves, self.records, self.notes)

    def _store(self, solve: SolveId, outcome: Outcome) -> None:
        if outcome.interrupted:
            return
        record = self._read_outcome(solve, outcome)
        try:
            if record.done:
                self.folder.write_solution(solve, outcome.text)
            else:
                self.folder.write_failure(solve, record.failure)
        except InputError as error:
            self._add_record(solve, SolveRecord(solve.variation, solve.seed, failure=f"not written: {error}"))
            raise _WriteError(str(error)) from None
        self._add_record(solve, record)

    def _read_outcome(self, solve: SolveId, outcome: Outcome) -> SolveRecord:
        """Return the record of an outcome.

        An outcome for another problem than earlier solves of the variation is a failure.
        """
        failure = outcome.failure
        if outcome.text:
            try:
                solution = GraspSolution.from_dict(json.loads(outcome.text), str(solve))
                record = SolveRecord.of(solve.variation, solve.seed, solution)
            except InputError as error:
                return SolveRecord(solve.variation, solve.seed, failure=error_line(error))
            digests = {r.problem for s, r in self.records.items() if s.variation == solve.variation and r.done}
            if digests <= {record.problem}:
                return record
            failure = "its function makes another problem than in an earlier run: use a new folder"
        return SolveRecord(solve.variation, solve.seed, failure=failure)

    def _add_record(self, solve: SolveId, record: SolveRecord) -> None:
        self.records[solve] = record
        if self.progress is not None:
            self.progress(record)


class _WriteError(Exception):
    """Error raised when a result cannot be written."""


def run_local(
    solves: Sequence[Key], factory: Callable[[Key], RunnableJob | None], workers: int
) -> Generator[tuple[Key, Outcome], None, None]:
    """Run jobs in local worker processes, and yield key and outcome of each when it is done.

    The order of outcomes is arbitrary.

    ``solves`` are the keys. The factory returns the job of a key when a worker is free; None leaves it out. At most one
    job per worker is active. When a worker process crashes, all workers end, and the job that crashed it is unknown:
    each active job is repeated alone, and one that crashes its process again has failed.
    """
    if multiprocessing.current_process().daemon:
        raise InputError("workers", "a daemonic process, which can have none", "a call from another process")
    waiting = dict.fromkeys(solves)
    while waiting:
        active, _ = yield from _outcomes_until_crash(waiting, factory, workers)
        for solve in active:
            remaining = {solve: None}
            crashed, ending = yield from _outcomes_until_crash(remaining, factory, 1)
            if crashed:
                yield solve, Outcome(failure=f"its process ended, twice{ending}: a crash, or out of memory")
            if crashed or not remaining:
                del waiting[solve]  # else it was not started: a worker crashed before


def _outcomes_until_crash(
    waiting: dict[Key, None], factory: Callable[[Key], RunnableJob | None], workers: int
) -> Generator[tuple[Key, Outcome], None, tuple[list[Key], str]]:
    """Yield outcomes of waiting jobs until all are done or a worker crashes.

    Returns the solves that were active then, which stay waiting, and how the worker ended, as text.
    """
    remaining = iter(list(waiting))
    active: dict[Future[Outcome], Key] = {}
    try:
        with separate_processes(workers, IDLE_SECONDS) as processes:
            while True:
                while len(active) < workers and (solve := next(remaining, None)) is not None:
                    job = factory(solve)
                    if job is None:
                        del waiting[solve]
                    else:
                        active[processes.submit(_run_job_quietly, job)] = solve
                if not active:
                    return [], ""
                finished, _ = wait(active, timeout=POLL_SECONDS, return_when=FIRST_COMPLETED)
                for future in sorted(finished, key=lambda future: future.exception() is not None):
                    outcome = future.result()
                    solve = active.pop(future)
                    del waiting[solve]
                    yield solve, outcome
    except BrokenProcessPool as error:
        codes = re.search(r"\{(.+?)\}", str(error))  # such as {SIGSEGV(-11)}
        return list(active.values()), f" ({codes[1]})" if codes else ""


def _run_job_quietly(job: RunnableJob) -> Outcome:
    """Run a job in a worker without the fault handler's output.

    The parent process reports a crash in one line.
    """
    faulthandler.disable()
    return run_job(job)


def run_cluster(
    solves: Sequence[Key], factory: Callable[[Key], RunnableJob | None], client: Client
) -> Generator[tuple[Key, Outcome], None, None]:
    """Run jobs on a Dask cluster, and yield key and outcome of each when it is done.

    The order of outcomes is arbitrary.

    A few solves per worker are submitted at a time. Those of a terminated worker are repeated by others; a solve that
    terminates several workers has failed (Dask's ``allowed-failures``).

    Raises
    ------
    ClusterLostError
        When the scheduler is lost.
    """
    from distributed import as_completed

    waiting = iter(solves)
    active: dict[ClusterFuture, Key] = {}
    completed = as_completed(loop=client.loop)

    def submit() -> None:
        while len(active) < _most_submitted(client):
            solve = next(waiting, None)
            if solve is None:
                return
            job = factory(solve)
            if job is None:
                continue
            future = client.submit(run_job, job, pure=False, key=job.key)
            active[future] = solve
            completed.add(future)

    try:
        submit()
        for future in completed:
            solve = active.pop(future)
            yield solve, _future_outcome(future)
            submit()
    except (OSError, RuntimeError, KeyError, CancelledError) as error:  # errors of distributed without a scheduler
        raise ClusterLostError(f"the cluster was lost ({type(error).__name__})") from None


def _most_submitted(client: Client) -> int:
    """Return the number of jobs that may be in the cluster at once, for its current size."""
    return max(LEAST_WINDOW, QUEUED_PER_WORKER * len(client.scheduler_info(n_workers=-1)["workers"]))


def connect(address: str) -> Client:
    """Connect to a Dask scheduler, and return the client.

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
        return Client(address, timeout=CONNECT_SECONDS, set_as_default=False)
    except Exception as error:  # every kind of address has its own errors
        raise InputError("scheduler", f"{address} ({type(error).__name__}: nobody answers)", allowed) from None


class ClusterLostError(NlpgraspError):
    """Error raised when the scheduler is lost during a run."""


def _future_outcome(future: ClusterFuture) -> Outcome:
    """Return the outcome of a finished job of the cluster."""
    if future.status == "finished":
        result: Outcome = future.result()
        return result
    error = future.exception() if future.status == "error" else None
    if error is None:
        raise ClusterLostError("the cluster lost a solve")
    return Outcome(failure=error_line(error))
