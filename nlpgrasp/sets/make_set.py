"""Generation of a set of grasps by worker processes that run units of starts."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import islice
from math import ceil, inf
from pathlib import Path
from typing import Any

from nlpgrasp.analysis.jaw_diagnosis import with_usable_pads
from nlpgrasp.common.files import hold_lock
from nlpgrasp.common.formatting import error_line
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import integer, share
from nlpgrasp.errors import InputError
from nlpgrasp.experiments.experiment_run import ClusterLostError, connect, run_cluster, run_local
from nlpgrasp.experiments.solve_job import Outcome
from nlpgrasp.experiments.solve_many import ProblemFactory, check_named_problems
from nlpgrasp.optimize.compiled_problem import CompiledProblem
from nlpgrasp.optimize.options import SolveOptions, check_solve_arguments
from nlpgrasp.optimize.parallel_starts import LazyCompiledProblem
from nlpgrasp.optimize.processes import WorkerPayload, cores
from nlpgrasp.pipeline.solve import check_json
from nlpgrasp.problem.identity import ProblemIdentity, problem_identity
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.sets.grasp_rows import (
    ALWAYS_STATED,
    DUPLICATE,
    FAILED,
    GRASP,
    LABELS,
    Row,
    import_pyarrow,
    parquet_bytes,
    read_rows,
    row_identity,
)
from nlpgrasp.sets.grasp_set import GraspSet, open_set
from nlpgrasp.sets.grasp_unit import (
    UNIT,
    DistinctCandidates,
    KnownCandidate,
    UnitId,
    UnitJob,
    UnitProblem,
    find_robot_file,
)
from nlpgrasp.sets.set_folder import LOCK, SetFolder
from nlpgrasp.sets.stored_solution import COLUMNS as RECORD
from nlpgrasp.sets.stored_solution import unpack_solution

STARTS_PER_GRASP = 4  # most starts of a problem per requested grasp, by default
WAIT_SECONDS = 0.5  # seconds between readings of the folder while other processes run the last units
DEFAULT_OPTIONS = SolveOptions(global_bound=False, final_rtol=SolveOptions().rtol, rank="mu")
REFUSED = ("gap", "time_limit", "analyses", "extras", "workers", "edge_margin")  # options that keep their default
INTERRUPTED = "Interrupted: what is finished is kept; call ng.make_set again to go on."


@dataclass(frozen=True)
class SetProgress:
    """Progress of a set's generation, with rate and cost of this run.

    Parameters
    ----------
    grasps, wanted : int
        Number of distinct grasps so far, and of those requested. Grasps of a unit count once those of all earlier
        starts are known; the number never decreases.
    missing : int
        Number of grasps requested of unfinished problems.
    problems, finished : int
        Number of problems, and of those that are finished.
    starts, failures : int
        Starts of this run, and those of them without a grasp of their own.
    new : int
        Number of grasps found by this run.
    seconds, cpu_seconds : float
        Wall time of this run; CPU time of its finished starts.
    """

    grasps: int
    wanted: int
    missing: int
    problems: int
    finished: int
    starts: int
    failures: int
    new: int
    seconds: float
    cpu_seconds: float

    @property
    def per_second(self) -> float:
        """Number of grasps found per second of this run."""
        return self.new / self.seconds if self.seconds > 0.0 else 0.0

    @property
    def cpu_per_grasp(self) -> float:
        """CPU seconds per grasp found; inf before the first."""
        return self.cpu_seconds / self.new if self.new else inf

    @property
    def seconds_left(self) -> float:
        """Estimate of the remaining seconds at this rate; inf before the first grasp."""
        return self.missing / self.per_second if self.new else inf

    def __str__(self) -> str:
        text = f"{self.grasps} of {self.wanted} grasps, {self.finished} of {self.problems} problems"
        if self.new:
            text += f"; {60.0 * self.per_second:.3g} a minute, {self.cpu_per_grasp:.2g} CPU s each, "
            text += f"about {self.seconds_left / 60.0:.1f} min left"
        return f"{text}; {self.failures} of {self.starts} starts without a grasp" if self.failures else text


Progress = Callable[[SetProgress], None]


def make_set(
    problems: Mapping[str, GraspProblem | ProblemFactory] | Iterable[GraspProblem],
    grasps_per_problem: int,
    out: str | Path,
    *,
    simulate: bool = True,
    starts: int | None = None,
    seed: int = 0,
    distinct: float = 0.1,
    options: SolveOptions | None = None,
    proofs: bool = False,
    folders: Iterable[str | Path] = (),
    workers: int | None = None,
    scheduler: str | None = None,
    progress: Progress | None = None,
    retry_failed: bool = False,
) -> GraspSet:
    """Make a data set of distinct, certified grasps of many problems, by many starts in parallel.

    The grasps of a problem are results of its starts, in their order, each distinct from those before; they are refined
    and certified, not brought to the nearest local optimum as the answer of ``ng.solve`` is. Units of four starts are
    written to ``out`` when they are finished. A call with an existing folder goes on with it: the rows are those of an
    uninterrupted run, except for their cost. Several processes may work on one folder. Problems may be added. A problem
    that cannot be compared with the folder's, such as a task whose function reads a file, is solved anew.

    Parameters
    ----------
    problems : mapping of str to GraspProblem or callable, or iterable of GraspProblem
        As for ``ng.solve_many``.
    grasps_per_problem : int
        Number of distinct grasps of each problem.
    out : str or Path
        Folder of the set.
    simulate : bool
        Push and lift the object in MuJoCo, with the squeeze and without, for hands with joints (``ng.URDFHand``).
    starts : int, optional
        Most starts of a problem; four per requested grasp when left out.
    seed : int
        Of the random candidates of all starts.
    distinct : float
        As in ``ng.solve``.
    options : SolveOptions, optional
        Of the starts; without a gap, a time limit or analyses.
    proofs : bool
        Store a proof of each grasp's bounds on mu, which ``verify`` of the set checks in place of a new one; some
        40 kB a grasp. Rows of grasps without a proof, as for a task given by a function, have none.
    folders : iterable of str or Path
        Where the robot files of simulated hands are, after the current folder.
    workers : int, optional
        Processes on this machine; one a core when left out.
    scheduler : str, optional
        Address of a Dask scheduler, whose workers run the units instead (extra ``cluster``).
    progress : callable, optional
        Called with a ``SetProgress`` after each unit.
    retry_failed : bool
        Run the starts of an existing folder again that failed, such as those of a unit whose process died twice. Later
        starts whose rows depend on them run again too: the rows are those of a run without failures.

    Returns
    -------
    GraspSet
        Also after Ctrl-C; ``notes`` name what was damaged or left undone.

    Raises
    ------
    InputError
        Before anything runs: on arguments out of range, a problem that cannot be made or sent to workers, a robot file
        that is not found, and a folder of another set, version or problem.
    MissingExtraError
        Without the extras ``tables``, for simulation ``sim``, for a scheduler ``cluster``.
    """
    import_pyarrow()
    if not isinstance(retry_failed, bool):
        raise InputError("retry_failed", retry_failed, "True or False")
    run = _Run.of(
        problems, grasps_per_problem, out, simulate, starts, seed, distinct, options, proofs, folders, progress
    )
    if workers is not None:
        if scheduler is not None:
            raise InputError("workers", workers, "no number of workers with a scheduler: the cluster has its own")
        workers = integer("workers", workers, at_least=1, at_most=1024)
    client = None if scheduler is None else connect(scheduler)
    try:
        if retry_failed:
            run.discard_failures()
        if client is None:
            run.run(partial(run_local, workers=workers or cores()))
        else:
            run.run(partial(run_cluster, client=client))
    except KeyboardInterrupt:
        run.notes.append(INTERRUPTED)
    except ClusterLostError as error:
        run.notes.append(f"Stopped: {error}; call ng.make_set again to go on.")
    finally:
        run.folder.close()
        if client is not None:
            client.close()
    result = open_set(run.folder.path, warns=False)
    return replace(result, notes=(*run.notes, *(note for note in result.notes if note not in run.notes)))


@dataclass
class _ProblemState:
    """State of one problem in this run.

    Parameters
    ----------
    name : str
    make : callable
        Returns the problem.
    identity : ProblemIdentity
    robot_file : Path or None
        File of its hand, for simulation.
    """

    name: str
    make: ProblemFactory
    identity: ProblemIdentity
    robot_file: Path | None = None
    distinct: DistinctCandidates | None = None
    next_unit: int = 0  # the first unit whose grasps have not been compared with those of earlier starts
    pending: dict[int, int] = field(default_factory=dict)  # numbers of grasps of finished units from it on, by unit
    duplicates: dict[int, str] = field(default_factory=dict)  # reason by start, for grasps that proved equivalent
    grasps: int = 0  # of a finished problem
    is_finished: bool = False

    @property
    def digest(self) -> str:
        """Digest of the problem's identity."""
        return self.identity.digest

    @property
    def data(self) -> Json:
        """The problem as JSON data."""
        return self.identity.problem

    @property
    def distinct_count(self) -> int:
        """Number of grasps that have been compared and are distinct."""
        if self.is_finished:
            return self.grasps
        return 0 if self.distinct is None else len(self.distinct.known)


@dataclass
class _Run:
    """Run of the missing units of a set.

    Parameters
    ----------
    folder : SetFolder
    states : mapping of str to _ProblemState
        By name of the problem.
    wanted : int
        Number of grasps of each problem.
    most_units : int
        Largest number of units of a problem.
    settings : mapping
        As the plan states them.
    options : SolveOptions
    progress : callable or None
    """

    folder: SetFolder
    states: Mapping[str, _ProblemState]
    wanted: int
    most_units: int
    settings: Json
    options: SolveOptions
    progress: Progress | None
    notes: list[str] = field(default_factory=list)
    start_time: float = field(default_factory=time.monotonic)
    starts: int = 0
    failures: int = 0
    cpu_seconds: float = 0.0
    earlier_grasps: int = 0  # number of grasps of earlier runs
    grasps: int = 0  # largest number of distinct grasps reported
    payload: tuple[str, WorkerPayload[LazyCompiledProblem[UnitProblem]]] | None = None  # of the latest job's problem

    @classmethod
    def of(
        cls,
        problems: object,
        grasps_per_problem: int,
        out: object,
        simulate: bool,
        starts: int | None,
        seed: int,
        distinct: float,
        options: SolveOptions | None,
        proofs: bool,
        folders: Iterable[str | Path],
        progress: Progress | None,
    ) -> _Run:
        """Check the arguments, open the folder, and return the run."""
        wanted = integer("grasps_per_problem", grasps_per_problem, at_least=1, at_most=10**6)
        most_starts = STARTS_PER_GRASP * wanted if starts is None else starts
        most_starts, seed, _ = check_solve_arguments(most_starts, seed, options)
        if not isinstance(simulate, bool):
            raise InputError("simulate", simulate, "True or False")
        if not isinstance(proofs, bool):
            raise InputError("proofs", proofs, "True or False")
        if progress is not None and not callable(progress):
            raise InputError("progress", progress, "a function of a SetProgress")
        settings = {
            "grasps_per_problem": wanted,
            "starts": most_starts,
            "unit": UNIT,
            "seed": seed,
            "distinct": share("distinct", distinct),
            "simulate": simulate,
            "options": check_options(options).to_dict(),
            "proofs": proofs,
        }
        states = {name: _initial_state(name, source) for name, source in check_named_problems(problems).items()}
        search = [Path(), *map(Path, folders)]
        for state in states.values() if simulate else ():
            state.robot_file = find_robot_file(state.data, search)
        folder = SetFolder.of(out)
        notes = folder.open(settings, {name: state.identity for name, state in states.items()})
        folder.remove_partial_files()
        most_units = ceil(most_starts / UNIT)
        return cls(folder, states, wanted, most_units, settings, check_options(options).narrow(), progress, notes)

    def run(self, run_units: Callable[..., Any]) -> None:
        """Run units, and wait for those that other processes run, until all problems are finished."""
        self._read_folder()
        self.earlier_grasps = self.grasps = sum(state.distinct_count for state in self.states.values())
        while units := self._missing_units():
            is_idle = True
            with closing(run_units(units, self._job)) as outcomes:
                for unit, outcome in outcomes:
                    is_idle = False
                    self._store(unit, outcome)
            self._read_folder()
            if is_idle:
                time.sleep(WAIT_SECONDS)

    def discard_failures(self) -> None:
        """Discard units with failed starts, and later ones whose rows depend on them, so that they run again."""
        for state in self.states.values():
            with hold_lock(self.folder.path / LOCK):
                self._discard_failures(state)

    def _discard_failures(self, state: _ProblemState) -> None:
        """Discard a problem's units with failed starts; a finished problem is taken apart into the other units.

        Later units depend on them where grasps were compared with earlier ones, or starts were left out.
        """
        units: dict[int, list[Row]] = {}
        for file in self.folder.row_files(state.name, self.folder.finished()):
            with suppress(InputError):  # a damaged file is set aside when it is read again
                for row in read_rows(file, (*LABELS, *RECORD), state.digest, file.name).to_pylist():
                    units.setdefault(row["start"] // UNIT, []).append(row)
        statuses = {index: [row["status"] for row in rows] for index, rows in units.items()}
        failed = [index for index in statuses if FAILED in statuses[index]]
        if not failed:
            return
        for index, rows in units.items():
            is_whole = len(rows) == len(self._starts_of(index))
            if index < min(failed) or (is_whole and not {FAILED, DUPLICATE} & {*statuses[index]}):
                self.folder.write_unit(UnitId(state.name, index), parquet_bytes(rows, state.digest, str(index)))
            else:
                self.folder.unit_file(UnitId(state.name, index)).unlink(missing_ok=True)
        self.folder.merged_file(state.name).unlink(missing_ok=True)

    def _missing_units(self) -> list[UnitId]:
        """Return the units to run next.

        They suffice if each of their starts ends with a distinct grasp.
        """
        units: list[UnitId] = []
        for state in self.states.values():
            if state.is_finished:
                continue
            missing = (i for i in range(state.next_unit, self.most_units) if i not in state.pending)
            found = state.distinct_count + sum(state.pending.values())
            needed = max(ceil((self.wanted - found) / UNIT), 1)
            units += [UnitId(state.name, index) for index in islice(missing, needed)]
        return units

    def _job(self, unit: UnitId) -> UnitJob | None:
        """Return the job of a unit, or ``None`` if the unit is finished or another process runs it."""
        state = self.states[unit.problem]
        if state.is_finished or unit.index < state.next_unit or not self.folder.claim(unit):
            return None
        if self.payload is None or self.payload[0] != state.name:
            unit_problem = state.name, state.digest, state.make, self.options, self.settings, state.robot_file
            make = partial(_make_unit, *unit_problem)
            try:
                self.payload = state.name, WorkerPayload.of(LazyCompiledProblem(make))
            except Exception as error:  # any error of the parts' own pickling
                allowed = "parts that can be sent to other processes"
                raise InputError(f"problem {state.name!r}", error_line(error), allowed) from None
        known = () if state.distinct is None else tuple(state.distinct.known)
        wanted = self.wanted - len(known) if unit.index == state.next_unit else None
        return UnitJob(unit, self.payload[1], self._starts_of(unit.index), known, wanted)

    def _starts_of(self, unit_index: int) -> range:
        """Return the indices of the starts of a unit."""
        return range(UNIT * unit_index, min(UNIT * (unit_index + 1), int(self.settings["starts"])))

    def _store(self, unit: UnitId, outcome: Outcome) -> None:
        """Write the rows of a unit, or rows that state the failure if the worker failed."""
        state, content = self.states[unit.problem], outcome.content
        if not content:
            identity = row_identity(state.name, int(self.settings["seed"]), state.data)
            failures = [
                identity.row_without_grasp(start, FAILED, outcome.failure) for start in self._starts_of(unit.index)
            ]
            content = parquet_bytes(failures, state.digest, str(unit.index))
        rows = read_rows(content, ALWAYS_STATED, state.digest, str(unit)).to_pylist()
        self.starts += len(rows)
        self.failures += sum(row["status"] != GRASP for row in rows)
        self.cpu_seconds += sum(row["cpu_seconds"] + row["simulation_cpu_seconds"] for row in rows)
        if state.is_finished or self.folder.merged_file(state.name).is_file():
            self.folder.release(unit)  # it proved unnecessary meanwhile
        else:
            self.folder.write_unit(unit, content)
            state.pending[unit.index] = sum(row["status"] == GRASP for row in rows)
            self._compare_units(state)
        self._report()

    def _read_folder(self) -> None:
        """Read from the folder the finished problems, and the units of earlier runs and other processes."""
        finished = self.folder.finished()
        for state in self.states.values():
            if not state.is_finished and finished.is_merged(state.name):
                self._finish(state)
            elif not state.is_finished:
                for index in finished.unit_indices(state.name):
                    if index >= state.next_unit and index not in state.pending:
                        rows = self._read_unit(state, index, ("status",))
                        if rows is not None:
                            state.pending[index] = rows["status"].to_pylist().count(GRASP)
                self._compare_units(state)

    def _compare_units(self, state: _ProblemState) -> None:
        """Compare the grasps of finished units with those of earlier starts, and merge a finished problem."""
        while not state.is_finished and state.next_unit in state.pending:
            index = state.next_unit
            table = self._read_unit(state, index, ("start", "status", *RECORD))
            del state.pending[index]
            if table is None:
                return
            state.next_unit += 1
            for row in table.to_pylist():
                if row["status"] == GRASP:
                    self._add_or_reject(state, row)
                if state.distinct_count == self.wanted:
                    self._merge(state, row["start"])
                    return
            if state.next_unit == self.most_units:
                self._merge(state, UNIT * self.most_units)

    def _add_or_reject(self, state: _ProblemState, row: Mapping[str, Any]) -> None:
        """Add the grasp of a row to the distinct grasps, or record that it is equivalent to one of them."""
        if state.distinct is None:
            compiled = CompiledProblem(state.make(), self.options)
            state.distinct = DistinctCandidates(compiled, float(self.settings["distinct"]))
        start = int(row["start"])
        solution = unpack_solution(row, state.data, state.name, f"{state.name}, start {start}")
        entry = KnownCandidate.of(start, solution)
        if reason := state.distinct.describe_equivalent(entry):
            state.duplicates[start] = reason
        else:
            state.distinct.add(entry)

    def _merge(self, state: _ProblemState, last_start: int) -> None:
        """Write the rows of a finished problem as one file, up to the last start that is needed."""
        pa = import_pyarrow("pyarrow")
        tables = [self._read_unit(state, index, (*LABELS, *RECORD)) for index in range(state.next_unit)]
        if any(table is None for table in tables):
            state.next_unit, state.distinct, state.duplicates = 0, None, {}  # a file was damaged meanwhile
            return
        table = pa.concat_tables(tables)
        table = table.filter(import_pyarrow("pyarrow.compute").less_equal(table["start"], last_start))
        table = _relabel(table, state.duplicates)
        self.folder.write_merged(state.name, parquet_bytes(table, state.digest, "all"))
        self._finish(state)

    def _finish(self, state: _ProblemState) -> None:
        """Mark a problem as finished, and discard its working data and unit files."""
        file = self.folder.merged_file(state.name)
        try:
            rows = read_rows(file, (*LABELS, *RECORD), state.digest, file.name)  # all of them, to notice any damage
        except InputError as error:
            self._set_aside(file, error)
            return
        state.is_finished, state.grasps = True, rows["status"].to_pylist().count(GRASP)
        state.distinct, state.pending, state.duplicates = None, {}, {}
        self.folder.remove_units(state.name)

    def _read_unit(self, state: _ProblemState, unit_index: int, columns: Sequence[str]) -> Any:
        """Read columns of a unit's rows; return ``None`` for a damaged file, which is renamed."""
        file = self.folder.unit_file(UnitId(state.name, unit_index))
        try:
            return read_rows(file, columns, state.digest, file.name)
        except InputError as error:
            if not self.folder.merged_file(state.name).is_file():  # else another process has merged it
                self._set_aside(file, error)
            return None

    def _set_aside(self, file: Path, error: InputError) -> None:
        """Rename a damaged file so that its starts are run again, and record a note."""
        self.notes.append(f"{file.name} is run again: {error.given}; renamed to {self.folder.set_aside(file)}")

    def _report(self) -> None:
        """Call the progress callback, if any."""
        if self.progress is None:
            return
        states = self.states.values()
        self.grasps = max(self.grasps, sum(state.distinct_count for state in states))
        self.progress(
            SetProgress(
                self.grasps,
                self.wanted * len(states),
                sum(self.wanted - state.distinct_count for state in states if not state.is_finished),
                len(states),
                sum(state.is_finished for state in states),
                self.starts,
                self.failures,
                self.grasps - self.earlier_grasps,
                time.monotonic() - self.start_time,
                self.cpu_seconds,
            )
        )


def check_options(options: SolveOptions | None) -> SolveOptions:
    """Return the validated solver options for a set.

    Raises
    ------
    InputError
        On options whose results depend on time, or that a set does not have.
    """
    if options is None:
        return DEFAULT_OPTIONS
    default = SolveOptions()
    changed = [name for name in REFUSED if getattr(options, name) != getattr(default, name)]
    if changed:
        raise InputError(f"options.{changed[0]}", getattr(options, changed[0]), "its default for a set of grasps")
    return replace(options, global_bound=False, rank=DEFAULT_OPTIONS.rank)


def _initial_state(name: str, source: GraspProblem | ProblemFactory) -> _ProblemState:
    """Return the initial state of a problem, with the JSON data of the problem built once.

    Raises
    ------
    InputError
        When the problem cannot be built, or its data are no JSON data.
    """
    make = partial(_return, source) if isinstance(source, GraspProblem) else source
    try:
        problem = make()
    except Exception as error:  # whatever the user's function raises
        raise InputError(f"problems[{name!r}]", error_line(error), "a function that returns a GraspProblem") from error
    if not isinstance(problem, GraspProblem):
        raise InputError(f"problems[{name!r}]", problem, "a GraspProblem, or a function that returns one")
    identity = problem_identity(with_usable_pads(problem))
    check_json(identity.problem)
    return _ProblemState(name, partial(_make_with_usable_pads, make), identity)


def _return(problem: GraspProblem) -> GraspProblem:
    """Return the given problem; with ``partial``, a picklable problem function.

    A lambda could not be sent to a worker.
    """
    return problem


def _make_with_usable_pads(make: ProblemFactory) -> GraspProblem:
    """Build a problem, with the default pads of a gripper along an approach that can be used."""
    return with_usable_pads(make())


def _make_unit(
    name: str, digest: str, make: ProblemFactory, options: SolveOptions, settings: Json, robot_file: Path | None
) -> UnitProblem:
    """Build the problem of a unit in a worker."""
    seed, distinct = int(settings["seed"]), float(settings["distinct"])
    simulate, proofs = bool(settings["simulate"]), bool(settings["proofs"])
    return UnitProblem(name, digest, make(), options, seed, distinct, robot_file, simulate, proofs)


def _relabel(table: Any, duplicates: Mapping[int, str]) -> Any:
    """Return the table of grasps with given starts marked as duplicates and their grasp data removed."""
    if not duplicates:
        return table
    pa, starts = import_pyarrow("pyarrow"), table["start"].to_pylist()
    is_kept = pa.array([start not in duplicates for start in starts])
    for i, name in enumerate(table.column_names):
        if name == "status":
            replaced = pa.scalar(DUPLICATE)
        elif name == "reason":
            replaced = pa.array([duplicates.get(start, "") for start in starts])
        elif name in ALWAYS_STATED:
            continue
        else:
            kind = table.schema.field(name).type
            replaced = pa.scalar(False if pa.types.is_boolean(kind) else None, kind)
        column = import_pyarrow("pyarrow.compute").if_else(is_kept, table[name], replaced)
        table = table.set_column(i, name, column)
    return table
