"""Set of grasps: a table with one row per start, and solutions that are built from rows on demand."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.common.files import file_name, write_bytes
from nlpgrasp.common.formatting import error_line
from nlpgrasp.common.robot_files import UrdfUnits
from nlpgrasp.common.types import Json
from nlpgrasp.common.user_warnings import warn
from nlpgrasp.common.validation import integer
from nlpgrasp.errors import InputError
from nlpgrasp.interop.base import ExportFormat, ExportOptions
from nlpgrasp.interop.benchmark_arrays import Arrays, arrays_of_grasps, hdf5_bytes, npz_bytes
from nlpgrasp.interop.registry import format_named
from nlpgrasp.interop.robot_poses import check_one_frame
from nlpgrasp.optimize.processes import cores, separate_processes, single_thread
from nlpgrasp.quality.grasp import GraspStack
from nlpgrasp.quality.measure_table import Columns
from nlpgrasp.sets.grasp_rows import (
    FLAGS,
    GRASP,
    GROUP,
    LABELS,
    NOT_REQUESTED,
    STATUSES,
    TEXT,
    VECTORS,
    WHOLE,
    Row,
    differing_label,
    parquet_bytes,
    read_rows,
    row_identity,
    simulation_labels,
)
from nlpgrasp.sets.grasp_unit import find_body, find_robot_file, simulate_grasp
from nlpgrasp.sets.row_checks import label_fault, repeated_grasps, start_faults
from nlpgrasp.sets.set_folder import FinishedUnits, SetFolder, SetPlan
from nlpgrasp.sets.stored_solution import COLUMNS as RECORD
from nlpgrasp.sets.stored_solution import unpack_solution
from nlpgrasp.simulation.robot_hand_scene import read_hand
from nlpgrasp.solution.kept_grasps import rank_by
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.solution.stored_drawing import draw_body_and_hand
from nlpgrasp.verify.verify import verify

if TYPE_CHECKING:
    import pandas as pd

IDLE_SECONDS = 30.0  # seconds after which idle workers end
CHUNK = 16  # rows whose grasps are verified in one call of a worker; divides ``GROUP``
NPZ = "npz"
ARRAY_FILES = {NPZ: npz_bytes, "hdf5": hdf5_bytes}  # formats with the labels of the set beside a hand's arrays
Result = TypeVar("Result")
MOST_LISTED = 5  # failed grasps listed in a verdict


@dataclass(frozen=True)
class SetVerification:
    """Outcome of verifying all grasps of a set.

    It is true if there are grasps, and no check that could be made failed. Labels that follow from a solution are
    compared with it, and rows with each other: no start is missing, repeated or moved, grasps of a finished problem are
    distinct. Labels of the simulation have to agree with each other; it is not run again.

    Parameters
    ----------
    verified, partly_verified : int
        Number of grasps whose checks were all made, or only some for missing sources; no check failed.
    failed : mapping of int to str
        Verdict of each other grasp, by its index.
    missing : tuple of str
        Names of the files (mesh, robot) that were not found.
    damaged : tuple of str
        What of the set could not be read, or is not there.
    faults : tuple of str
        Rows that contradict the set: missing, repeated or moved starts, labels without a grasp.
    simulated : int
        Number of grasps with labels of a simulation.
    """

    verified: int
    partly_verified: int
    failed: Mapping[int, str]
    missing: tuple[str, ...] = ()
    damaged: tuple[str, ...] = ()
    faults: tuple[str, ...] = ()
    simulated: int = 0

    @property
    def passed(self) -> bool:
        """Whether there are grasps and no check failed."""
        return not self.failed and not self.faults and self.verified + self.partly_verified > 0

    @property
    def complete(self) -> bool:
        """Whether the set passed, every check could be made, and every row could be read."""
        return self.passed and not self.partly_verified and not self.damaged

    def __bool__(self) -> bool:
        return self.passed

    def __str__(self) -> str:
        is_false = bool(self.failed or self.faults)
        verdict = "NOT verified" if is_false else "verified" if self.complete else "partly verified"
        counts = f"{self.verified} grasps verified, {self.partly_verified} partly, {len(self.failed)} not"
        lines = [f"{verdict}: {counts}" if self.passed or is_false else "nothing verified: no grasp to read"]
        lines += [f"  {fault}" for fault in self.faults[:MOST_LISTED]]
        lines += [f"  grasp {i}: {reason}" for i, reason in list(self.failed.items())[:MOST_LISTED]]
        lines += [
            f"  {name} not found: give its folder with --folder, in Python with folders=" for name in self.missing
        ]
        if self.simulated:
            lines.append(f"  {self.simulated} simulations were not run again: their labels agree with each other alone")
        return "\n".join([*lines, *(f"  {note}" for note in self.damaged)])


@dataclass(frozen=True)
class RowFile:
    """Parquet file that contains rows of one problem.

    Parameters
    ----------
    problem : str
        Name of the problem.
    digest : str
        Digest of the problem.
    file : Path
    """

    problem: str
    digest: str
    file: Path

    @property
    def unit(self) -> int | None:
        """Number of the unit whose rows it has; None for all rows of a finished problem."""
        stem, _, index = self.file.stem.rpartition("--")
        return int(index) if stem and index.isdigit() else None

    def labels(self, group: int | None = None) -> Any:
        """Return the label columns of one row group of the file, or of all rows."""
        return read_rows(self.file, LABELS, self.digest, str(self.file), group)

    def records(self, group: int) -> Any:
        """Return the stored solutions of one row group of the file."""
        return read_rows(self.file, RECORD, self.digest, str(self.file), group)

    def change_rows(self, entries: Mapping[int, Row]) -> None:
        """Replace entries of some rows, by number of the row, and write the file anew."""
        table = read_rows(self.file, (*LABELS, *RECORD), self.digest, str(self.file))
        rows = [row | entries.get(i, {}) for i, row in enumerate(table.to_pylist())]
        unit = "all" if self.unit is None else str(self.unit)
        write_bytes(self.file, parquet_bytes(rows, self.digest, unit))

    def solution(self, records: Any, row: int, problem: Json) -> GraspSolution:
        """Build the solution of a row from the records of the row group and the problem's JSON data."""
        record = records.slice(row % GROUP, 1).to_pylist()[0]
        return unpack_solution(record, problem, self.problem, f"{self.file.name}: row {row}")

    def proof(self, records: Any, row: int) -> bytes | None:
        """Return the proof of a row from the records of the row group, or None if it has none."""
        proof: bytes | None = records["proof"][row % GROUP].as_py()
        return proof


@dataclass(frozen=True, repr=False)
class GraspSet:
    """Set of distinct grasps in a folder, with one row per start.

    Parameters
    ----------
    path : Path
        Its folder.
    notes : tuple of str
        Damaged files that were left out, and other messages.
    """

    path: Path
    notes: tuple[str, ...] = ()
    _plan: SetPlan = field(kw_only=True)
    _files: tuple[RowFile, ...] = field(kw_only=True)
    _tables: tuple[Any, ...] = field(kw_only=True)
    _finished: frozenset[str] = field(kw_only=True)
    _cache: dict[tuple[Path, int], Any] = field(default_factory=dict, kw_only=True)

    @property
    def settings(self) -> Json:
        """Settings of the set: grasps per problem, seed and options."""
        return self._plan["settings"]

    @property
    def problems(self) -> tuple[str, ...]:
        """Names of the problems."""
        return tuple(self._plan["problems"])

    @property
    def complete(self) -> bool:
        """Whether every problem is finished, and its rows are read. Until then, grasps of one may be equivalent."""
        return len(self._finished) == len(self.problems)

    def __len__(self) -> int:
        return len(self._grasp_rows)

    def counts(self) -> dict[str, int]:
        """Return the number of rows of each status.

        ``"grasp"``; ``"duplicate"``, equivalent to the grasp of an earlier start; ``"touches"``, with a link inside
        something; ``"no grasp"``; ``"failed"``, by an error.
        """
        statuses = [status for table in self._tables for status in table["status"].to_pylist()]
        return {status: statuses.count(status) for status in STATUSES}

    @property
    def cpu_seconds(self) -> float:
        """CPU seconds of all starts and their simulations."""
        names = ("cpu_seconds", "simulation_cpu_seconds")
        return float(sum(sum(table[name].to_pylist()) for table in self._tables for name in names))

    def frame(self, failures: bool = False) -> pd.DataFrame | Columns:
        """Return the table of labels with one row per grasp, as a pandas frame or, without pandas, as ``Columns``.

        A value that does not apply is None or NaN, and its flag is false: ``has_pose``, ``has_pregrasp``,
        ``has_squeeze`` (also for ``friction_needed``), ``has_lift``, ``has_depth``, ``simulated`` (for ``slip`` and
        ``turn``). Rows without a grasp have none of them; their ``status`` is not "grasp".

        Parameters
        ----------
        failures : bool
            Return the rows without a grasp as well, whose ``status`` and ``reason`` say why.
        """
        rows = [row for table in self._tables for row in table.to_pylist() if failures or row["status"] == GRASP]
        columns = {name: _column(name, [row[name] for row in rows]) for name in LABELS}
        try:
            pandas = import_module("pandas")
        except ImportError:
            return Columns(columns)
        frame: pd.DataFrame = pandas.DataFrame({name: list(values) for name, values in columns.items()})
        return frame.astype({name: values.dtype for name, values in columns.items() if values.dtype != object})

    def solution(self, index: int) -> GraspSolution:
        """Return the solution of a grasp, built from its row and the stored problem.

        ``ng.verify`` accepts the solution.

        Values of constraints have single precision; all other numbers are those of the solve.

        Raises
        ------
        InputError
            On an index out of range, and on a damaged row.
        """
        index = integer("index", index, at_least=-len(self), at_most=len(self) - 1)
        file_index, row = self._grasp_rows[index]
        source = self._files[file_index]
        key = source.file, row // GROUP
        if key not in self._cache:
            self._cache.clear()
            self._cache[key] = (
                source.records(row // GROUP),
                SetFolder(self.path).read_problem(source.problem, source.digest),
            )
        records, problem = self._cache[key]
        return source.solution(records, row, problem)

    def proof(self, index: int) -> bytes | None:
        """Return the proof of a grasp's bounds on mu, the content of a proof file; None if the set has none.

        Raises
        ------
        InputError
            On an index out of range, and on a damaged row.
        """
        index = integer("index", index, at_least=-len(self), at_most=len(self) - 1)
        file_index, row = self._grasp_rows[index]
        source = self._files[file_index]
        return source.proof(source.records(row // GROUP), row)

    def __iter__(self) -> Iterator[GraspSolution]:
        return map(self.solution, range(len(self)))

    def of_problem(self, problem: str) -> GraspSolution:
        """Return all grasps of a problem as one solution, best first, in the form of ``ng.solve(keep=...)``.

        Raises
        ------
        InputError
            On a problem without grasps.
        """
        solutions = self._solutions_of(problem)
        return self._join(sorted(solutions, key=lambda solution: -solution.mu.lower))

    def stack(self, problem: str) -> GraspStack:
        """Return the grasps of a problem as one stack, with ids ``"start 3"``, for ``ng.measure`` and others.

        Raises
        ------
        InputError
            On a problem without grasps.
        """
        grasps = [solution.require_grasp() for solution in self._solutions_of(problem)]
        return GraspStack(
            np.stack([grasp.points for grasp in grasps]),
            np.stack([grasp.normals for grasp in grasps]),
            grasps[0].contacts,
            grasps[0].torque_origin,
            [f"start {self._label(i, 'start')}" for i in self._indices(problem)],
        )

    def _solutions_of(self, problem: str) -> list[GraspSolution]:
        """Return the solutions of a problem's grasps; raise an ``InputError`` if there are none."""
        solutions = [self.solution(i) for i in self._indices(problem)]
        if not solutions:
            raise InputError("problem", problem, "a problem of the set that has a grasp")
        return solutions

    def _join(self, solutions: Sequence[GraspSolution]) -> GraspSolution:
        """Return one solution that holds several grasps of a problem, the first as the answer, the others ranked."""
        answer = solutions[0]
        solver = {**answer.solver, "keep": len(solutions), "distinct": self.settings["distinct"]}
        starts = tuple(sorted((start for s in solutions for start in s.starts), key=lambda start: start.index))
        others = sorted((s.grasps[0] for s in solutions[1:]), key=rank_by(solver.get("options", {})))
        return replace(answer, others=tuple(others), starts=starts, solver=solver)

    def export(self, folder: str | Path, to: str = NPZ, options: ExportOptions | None = None) -> tuple[Path, ...]:
        """Write the grasps in the format of another tool.

        There is one file per problem, or one per grasp if the format holds a single grasp.

        Parameters
        ----------
        folder : str or Path
            Created if missing.
        to : str
            A format of ``nlpgrasp export``. ``"npz"`` and ``"hdf5"`` have the arrays of docs/interop.md, in the order
            of the rows, and the labels of simulation; without a hand contacts and labels alone.
        options : ExportOptions, optional
            Settings of the format.

        Raises
        ------
        InputError
            On an unknown format, a set without grasps, and what the format lacks.
        MissingExtraError
            For ``"hdf5"`` without the extra ``hdf5``.

        Warns
        -----
        UserWarning
            On each problem that is left out, as its rows are damaged or lack what the format holds, where others are
            written.
        """
        target, export_format = Path(folder), format_named(to)
        if not len(self):
            raise InputError("set", "no grasps", "a set with a grasp")
        try:
            target.mkdir(exist_ok=True)
        except OSError as error:
            raise InputError("folder", f"{target} ({error.strerror})", "a folder in one that exists") from None
        written, refused = list[Path](), list[InputError]()
        for problem in self.problems:
            try:
                if len(self._indices(problem)):
                    written += self._export_problem(problem, target, export_format, options or ExportOptions())
            except InputError as error:
                refused.append(error)
        for refusal in refused if written else ():
            warn(f"left out: {refusal}")
        if refused and not written:
            raise refused[0]
        return tuple(written)

    def verify(
        self,
        rtol: float = 0.01,
        folders: Iterable[str | Path] = (),
        workers: int | None = None,
        progress: Callable[[int], None] | None = None,
    ) -> SetVerification:
        """Verify every grasp in parallel, each like ``ng.verify(set.solution(i), proof=set.proof(i))``.

        Parameters
        ----------
        rtol : float
            Relative gap of new proofs, where the set has none.
        folders : iterable of str or Path
            Where meshes and robot files are searched for, beside the current folder.
        workers : int, optional
            Processes; one a core when left out.
        progress : callable, optional
            Called with the number of grasps that are done.
        """
        count = integer("workers", workers, at_least=1, at_most=1024) if workers is not None else cores()
        search = [str(Path(entry).absolute()) for entry in folders]
        chunks, checked = self._chunks(), 0
        faults, repeated = self._compare_rows()
        verified = partly = 0
        failed: dict[int, str] = {}
        missing: dict[str, None] = {}
        calls = [partial(_verify_rows, str(self.path), *self._rows_of(chunk), rtol, search) for chunk in chunks]
        for chunk, outcomes in zip(chunks, _run_calls(calls, count), strict=True):
            for index, outcome in zip(chunk, outcomes, strict=True):
                missing |= dict.fromkeys(outcome.missing)
                if not outcome.passed or index in repeated:
                    failed[index] = repeated[index] if outcome.passed else outcome.verdict
                    continue
                verified += outcome.complete
                partly += not outcome.complete
            checked += len(chunk)
            if progress is not None:
                progress(checked)
        damaged = (*self.notes, *self._missing_rows())
        simulated = sum(bool(self._label(i, "simulated")) for i in range(len(self)))
        return SetVerification(verified, partly, failed, tuple(missing), damaged, faults, simulated)

    def simulate(
        self,
        folders: Iterable[str | Path] = (),
        workers: int | None = None,
        progress: Callable[[int], None] | None = None,
    ) -> GraspSet:
        """Simulate all grasps of a set that was made with ``simulate=False``, and return the set with the outcomes.

        Outcomes are written while it runs; after an interruption a further call simulates the others. The set is then
        one that was made with ``simulate=True``. No other process may write to it meanwhile.

        Parameters
        ----------
        folders : iterable of str or Path
            Where the robot files of hands, and their bodies' meshes, are, after the current folder.
        workers : int, optional
            Processes; one a core when left out.
        progress : callable, optional
            Called with the number of grasps that are done.

        Raises
        ------
        InputError
            On a file that is not found, a body given by an expression, and damaged rows.
        MissingExtraError
            Without MuJoCo, for a hand with joints (extra ``sim``).
        """
        count = integer("workers", workers, at_least=1, at_most=1024) if workers is not None else cores()
        folder, search, done = SetFolder(self.path), [Path().absolute(), *(Path(f).absolute() for f in folders)], 0
        problems = {source.problem: source.digest for source in self._files}
        robots = {name: find_robot_file(folder.read_problem(name, digest), search) for name, digest in problems.items()}
        waiting = [[i for i in chunk if self._label(i, "verdict") == NOT_REQUESTED] for chunk in self._chunks()]
        chunks = [chunk for chunk in waiting if chunk]
        calls = []
        for source, rows in map(self._rows_of, chunks):
            calls.append(partial(_simulate_rows, str(self.path), source, rows, robots[source.problem], search))
        for chunk, outcomes in zip(chunks, _run_calls(calls, count), strict=True):
            source, rows = self._rows_of(chunk)
            source.change_rows(dict(zip(rows, outcomes, strict=True)))
            done += len(chunk)
            if progress is not None:
                progress(done)
        folder.state_simulated()
        return open_set(self.path, warns=False)

    def _compare_rows(self) -> tuple[tuple[str, ...], dict[int, str]]:
        """Return sentences on rows that contradict the set, and the verdicts of grasps that repeat another."""
        folder, faults, failed = SetFolder(self.path), list[str](), dict[int, str]()
        for name in dict.fromkeys(source.problem for source in self._files):
            pairs = [(s, t.to_pylist()) for s, t in zip(self._files, self._tables, strict=True) if s.problem == name]
            rows = [row for _, file_rows in pairs for row in file_rows]
            grasps, indices = [row for row in rows if row["status"] == GRASP], self._indices(name)
            try:
                problem = folder.read_problem(name, pairs[0][0].digest)
                found = [*start_faults({source.unit: rows for source, rows in pairs}, self.settings)]
                labelled = ((row, label_fault(row, problem)) for row in rows)
                found += [f"start {row['start']} states {fault}" for row, fault in labelled if fault]
                if name in self._finished:
                    for i, j in repeated_grasps(grasps, problem, float(self.settings["distinct"])):
                        failed[indices[j]] = f"NOT verified: not distinct from the grasp of start {grasps[i]['start']}"
            except InputError:  # said of each of its grasps
                continue
            except (TypeError, ValueError, KeyError) as error:
                found = [f"rows that cannot be compared ({error_line(error)})"]
            faults += [f"{name}: {fault}" for fault in found]
        return tuple(faults), failed

    def _missing_rows(self) -> Iterator[str]:
        """Yield sentences on problems whose rows are not all there, and on rows whose status hides a grasp."""
        unfinished = [name for name in self.problems if name not in self._finished]
        if unfinished:
            yield f"not all rows of {', '.join(unfinished[:MOST_LISTED])} are there: unfinished, lost or damaged"
        for source, table in zip(self._files, self._tables, strict=True):
            pairs = zip(table["status"].to_pylist(), table["mu_lower"].to_pylist(), strict=True)
            hidden = [row for row, (status, mu) in enumerate(pairs) if status != GRASP and mu is not None]
            if hidden:
                yield f"{source.file.name}: row {hidden[0]} holds a grasp, though its status is another"

    def __repr__(self) -> str:
        return f"GraspSet({str(self.path)!r}: {len(self)} grasps of {len(self.problems)} problems)"

    def __str__(self) -> str:
        counts, cost = self.counts(), self.cpu_seconds
        failures = ", ".join(f"{count} {status}" for status, count in counts.items() if count and status != GRASP)
        lines = [f"{len(self)} grasps of {len(self.problems)} problems in {self.path}"]
        if failures:
            lines.append(f"  starts without a grasp of their own: {failures}")
        wanted, starts = self.settings["grasps_per_problem"], self.settings["starts"]
        found = {problem: len(self._indices(problem)) for problem in self.problems if problem in self._finished}
        short = [f"{problem} ({count})" for problem, count in found.items() if count < wanted]
        if short:
            listed = ", ".join(short[:MOST_LISTED]) + (", ..." if len(short) > MOST_LISTED else "")
            lines.append(
                f"  fewer than the {wanted} wanted of {listed}: the {starts} starts of each found no more distinct"
                " ones; more starts, in another folder, may"
            )
        if len(self):
            lines.append(f"  {cost:.0f} CPU seconds, {cost / len(self):.2g} for each grasp")
        unfinished = len(self.problems) - len(self._finished)
        if unfinished:
            lines.append(f"  {unfinished} problems are unfinished: their grasps may still turn out equivalent")
        return "\n".join([*lines, *(f"  {note}" for note in self.notes)])

    @cached_property
    def _grasp_rows(self) -> list[tuple[int, int]]:
        """Index of the file, and of the row in that file, for each grasp."""
        statuses = [table["status"].to_pylist() for table in self._tables]
        return [(i, row) for i, column in enumerate(statuses) for row, status in enumerate(column) if status == GRASP]

    def _indices(self, problem: str) -> list[int]:
        """Return the indices of a problem's grasps."""
        return [i for i, (file_index, _) in enumerate(self._grasp_rows) if self._files[file_index].problem == problem]

    def _rows_of(self, chunk: Sequence[int]) -> tuple[RowFile, list[int]]:
        """Return the file of a chunk of grasps, and the numbers of their rows in it."""
        return self._files[self._grasp_rows[chunk[0]][0]], [self._grasp_rows[i][1] for i in chunk]

    def _chunks(self) -> list[list[int]]:
        """Return chunks of grasp indices, each verified in one call of a worker.

        The rows of a chunk are in one row group.
        """
        groups: dict[tuple[int, int], list[int]] = {}
        for index, (file_index, row) in enumerate(self._grasp_rows):
            groups.setdefault((file_index, row // CHUNK), []).append(index)
        return list(groups.values())

    def _export_problem(
        self, problem: str, target: Path, export_format: ExportFormat, options: ExportOptions
    ) -> list[Path]:
        """Write the grasps of a problem, and return the paths of the files."""
        indices = self._indices(problem)
        path = target / f"{file_name(problem)}{export_format.ending}"
        if export_format.name in ARRAY_FILES:
            return [write_bytes(path, ARRAY_FILES[export_format.name](self._arrays(indices, options)))]
        if export_format.has_all_grasps:
            solution = self._join([self._without_constraints(i) for i in indices])
            check_one_frame(path, export_format, options.frame)
            return [write_bytes(path, export_format.export(solution, options))]
        starts = [self._label(i, "start") for i in indices]
        paths = [target / f"{file_name(problem)}-{start}{export_format.ending}" for start in starts]
        for index, path in zip(indices, paths, strict=True):
            write_bytes(path, export_format.export(self._without_constraints(index), options))
        return paths

    def _arrays(self, indices: Sequence[int], options: ExportOptions) -> Arrays:
        """Return arrays and labels of a problem's grasps by name."""
        solutions = [self._without_constraints(i) for i in indices]
        arrays: dict[str, NDArray[np.generic]] = {
            "mu": np.array([[s.mu.lower, s.mu.upper] for s in solutions]),
            "contact_points": np.stack([s.require_grasp().points for s in solutions]),
            "contact_normals": np.stack([s.require_grasp().normals for s in solutions]),
        }
        if self._label(indices[0], "has_pose"):
            arrays |= arrays_of_grasps(self._join(solutions), options)
        names = ("start", "link_depth", "friction_needed", "way_in", "slip", "turn", "verdict", *FLAGS)
        labels = {name: _column(name, [self._label(i, name) for i in indices]) for name in names}
        text = {name: values.astype(str) for name, values in labels.items() if values.dtype == object}
        return arrays | labels | text

    def _without_constraints(self, index: int) -> GraspSolution:
        """Return the solution of a grasp without constraint values, which take most memory."""
        return replace(self.solution(index), constraints=())

    def _label(self, index: int, name: str) -> object:
        """Return one label of a grasp."""
        file_index, row = self._grasp_rows[index]
        return self._tables[file_index][name][row].as_py()


def _run_calls(calls: Sequence[Callable[[], Result]], workers: int) -> Iterator[Result]:
    """Yield the results of calls in order, made by worker processes if there are several."""
    if workers == 1 or len(calls) < 2:
        yield from (call() for call in calls)
        return
    with separate_processes(min(workers, len(calls)), IDLE_SECONDS) as processes:
        for future in [processes.submit(call) for call in calls]:
            yield future.result()


@dataclass(frozen=True)
class _VerifiedGrasp:
    """Outcome of verifying one grasp."""

    passed: bool
    complete: bool
    missing: tuple[str, ...]
    verdict: str


def _verify_rows(
    path: str, source: RowFile, rows: Sequence[int], rtol: float, folders: Sequence[str]
) -> list[_VerifiedGrasp]:
    """Verify the grasps in some rows of one row group, and return their outcomes."""
    try:
        folder, group = SetFolder(Path(path)), rows[0] // GROUP
        problem, seed = folder.read_problem(source.problem, source.digest), folder.read_plan()["settings"]["seed"]
        records, labels = source.records(group), source.labels(group)
    except InputError as error:
        return [_VerifiedGrasp(False, False, (), f"NOT verified: {error}")] * len(rows)
    identity, outcomes = row_identity(source.problem, seed, problem), list[_VerifiedGrasp]()
    for row in rows:
        try:
            solution = source.solution(records, row, problem)
            stated = labels.slice(row % GROUP, 1).to_pylist()[0]
            label = differing_label(stated, identity.labels_of(stated["start"], solution))
            if [start.index for start in solution.starts] != [stated["start"]]:
                raise InputError("start", stated["start"], "the start of the stored solution of the row")
            if label is not None:
                raise InputError(label, _shortened(stated[label]), "what follows from the stored solution of the row")
            result = verify(solution, rtol, folders, source.proof(records, row))
            outcomes.append(_VerifiedGrasp(result.passed, result.complete, result.missing, result.verdict))
        except InputError as error:
            outcomes.append(_VerifiedGrasp(False, False, (), f"NOT verified: {error}"))
    return outcomes


def _simulate_rows(
    path: str, source: RowFile, rows: Sequence[int], robot_file: Path | None, folders: Sequence[Path]
) -> list[Row]:
    """Simulate the grasps in some rows of one row group, and return the entries to change in each row."""
    problem = SetFolder(Path(path)).read_problem(source.problem, source.digest)
    records, robot, drawing, entries = source.records(rows[0] // GROUP), None, None, list[Row]()
    if robot_file is not None:
        robot = read_hand(robot_file, problem["hand"]["palm"], UrdfUnits.from_dict(problem["hand"]))
        drawing = draw_body_and_hand(find_body(problem, folders), None, {})
    with single_thread(), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # what is stated of a grasp is in its row
        for row in rows:
            solution = replace(source.solution(records, row, problem), drawing=drawing)
            start_time = time.process_time()
            hold, verdict = simulate_grasp(solution, robot_file, robot)
            seconds = time.process_time() - start_time if hold is not None else 0.0
            entries.append({**simulation_labels(hold, verdict), "simulation_cpu_seconds": seconds})
    return entries


def _shortened(value: object) -> str:
    """Return a value as text of at most 60 characters."""
    text = str(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def open_set(path: str | Path, *, warns: bool = True) -> GraspSet:
    """Open a set of grasps that ``ng.make_set`` wrote, also an unfinished one.

    Parameters
    ----------
    path : str or Path
        Its folder.
    warns : bool
        Whether to warn of damaged files.

    Raises
    ------
    InputError
        When it is no such folder, or one of another schema.
    MissingExtraError
        Without the extra ``tables``.

    Warns
    -----
    UserWarning
        On each damaged file: it is left out, and named in ``notes``.
    """
    folder = SetFolder.of(path)
    plan = folder.read_plan()
    files, tables, notes, finished = list[RowFile](), [], list[str](), folder.finished()
    merged = set[str]()
    for problem, digest in plan["problems"].items():
        known = len(notes)
        for source, labels in _read_problem_rows(folder, problem, digest, finished, notes):
            files.append(source)
            tables.append(labels)
        if finished.is_merged(problem) and len(notes) == known:
            merged.add(problem)
    for note in notes if warns else ():
        warn(f"{folder.path.name}: {note}")
    return GraspSet(
        folder.path, tuple(notes), _plan=plan, _files=tuple(files), _tables=tuple(tables), _finished=frozenset(merged)
    )


def _read_problem_rows(
    folder: SetFolder, problem: str, digest: str, finished: FinishedUnits, notes: list[str]
) -> list[tuple[RowFile, Any]]:
    """Return the row files of a problem with their labels.

    Files that cannot be read are named in ``notes``.
    """
    read, unreadable = list[tuple[RowFile, Any]](), list[str]()
    for source in (RowFile(problem, digest, file) for file in folder.row_files(problem, finished)):
        try:
            read.append((source, source.labels()))
        except InputError as error:
            unreadable.append(f"{source.file.name} was left out: {error.given}")
    if unreadable and not finished.is_merged(problem) and folder.merged_file(problem).is_file():
        return _read_problem_rows(folder, problem, digest, folder.finished(), notes)  # its units were merged meanwhile
    notes += unreadable
    return read


def _column(name: str, values: Sequence[object]) -> NDArray[np.generic]:
    """Return a label column as an array.

    Text and vectors are objects; missing numbers are NaN.
    """
    if name in FLAGS:
        return np.array(values, dtype=bool)
    if name in WHOLE:
        return np.array(values, dtype=np.int64)
    if name in TEXT:
        return np.array(["" if value is None else value for value in values], dtype=object)
    if name not in (*VECTORS, "faces"):
        return np.array([np.nan if value is None else value for value in values], dtype=np.float64)
    column = np.empty(len(values), dtype=object)
    column[:] = [np.array(value) if isinstance(value, list) else value for value in values]
    return column
