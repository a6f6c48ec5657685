"""Result of an experiment, and its table of solves."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, TypeAlias

from nlpgrasp.common.files import write_bytes, write_text
from nlpgrasp.common.formatting import columns, single_line
from nlpgrasp.errors import InputError, MissingExtraError
from nlpgrasp.experiments.experiment import SolveId
from nlpgrasp.experiments.output_folder import SOLVES, OutputFolder
from nlpgrasp.experiments.solve_record import NOT_DONE, NOTHING, SolveRecord, format_gap
from nlpgrasp.quality import Bounds
from nlpgrasp.solution.solution import GraspSolution

if TYPE_CHECKING:
    import pandas as pd

EXTRA = "tables"
OTHER_PROBLEM = "another problem, or other settings, functions or version"  # of a solution file
TABLE_NOTE = (
    "Intervals are of the grasps found, local optima: where few seeds agree with the best, more starts may find "
    "better. Gap: how much better than the best of them any grasp could be, at most, or how many times better; "
    "loose where the bound is too far above to say."
)
NOT_COMPARABLE = "They differ in task or force budget: their values of mu measure different things."


Cell: TypeAlias = str | int | float | None
Row: TypeAlias = dict[str, Cell]
"""Cells of one solve, by the names of ``COLUMNS``."""


@dataclass(frozen=True)
class ExperimentResult:
    """Result of an experiment: the solves of each variation.

    Parameters
    ----------
    name : str
        The experiment's.
    folder : Path
        Output folder with the solutions.
    variations : tuple of VariationResult
        In the experiment's order.
    notes : tuple of str
        Notes on files that could not be read or written.
    """

    name: str
    folder: Path
    variations: tuple[VariationResult, ...]
    notes: tuple[str, ...] = ()

    @classmethod
    def load(cls, folder: str | Path) -> ExperimentResult:
        """Read the result of an experiment from its output folder, also an unfinished one.

        Raises
        ------
        InputError
            When it is not the folder of an experiment.
        """
        output = OutputFolder(folder)
        plan = output.plan()
        solves = [SolveId(name, seed) for name in plan["variations"] for seed in plan["seeds"]]
        digests = {name: str(case["digest"]) for name, case in plan["variations"].items() if "digest" in case}
        records, notes = read_records(output, solves, digests)
        return cls.of(str(plan.get("name", "")), output, solves, records, notes)

    @classmethod
    def of(
        cls,
        name: str,
        output: OutputFolder,
        solves: Sequence[SolveId],
        records: dict[SolveId, SolveRecord],
        notes: Sequence[str],
    ) -> ExperimentResult:
        """Build the result from records of solves.

        Solves without a record are marked as not done.
        """
        by_variation: dict[str, list[SolveRecord]] = {}
        for solve in solves:
            record = records.get(solve) or SolveRecord(solve.variation, solve.seed, failure=NOT_DONE)
            by_variation.setdefault(solve.variation, []).append(record)
        variations = tuple(VariationResult(n, tuple(r)) for n, r in by_variation.items())
        return cls(name, output.path, variations, tuple(notes))

    def __getitem__(self, name: str) -> VariationResult:
        """Return a variation by name."""
        for variation in self.variations:
            if variation.name == name:
                return variation
        raise KeyError(name)

    @property
    def solves(self) -> tuple[SolveRecord, ...]:
        """Records of all solves, variation by variation."""
        return tuple(s for v in self.variations for s in v.solves)

    @property
    def failures(self) -> tuple[SolveRecord, ...]:
        """Records of the solves without a solution: failed or not done."""
        return tuple(s for s in self.solves if not s.done)

    @property
    def complete(self) -> bool:
        """Whether every solve has a solution."""
        return not self.failures

    @property
    def success(self) -> bool:
        """Whether any solve has a grasp."""
        return any(s.success for s in self.solves)

    @property
    def comparable(self) -> bool:
        """Whether all solves have the same task and kind of force budget, so that their mu can be compared."""
        return len({s.measured for s in self.solves if s.done}) <= 1

    def ranks(self) -> list[int]:
        """Return the rank of each variation: 1 plus the number of certainly better ones."""
        return rank_intervals([v.mu for v in self.variations])

    def ties(self) -> list[tuple[str, ...]]:
        """Return the ties of each variation: names of others with overlapping certified intervals."""
        names = [v.name for v in self.variations]
        is_success = [v.mu.upper > 0.0 for v in self.variations]
        overlaps = overlapping_intervals([v.mu for v in self.variations])
        return [tuple(names[j] for j in indices if is_success[j]) for indices in overlaps]

    def solution(self, variation: str, seed: int | None = None) -> GraspSolution:
        """Load the solution of a variation: that of a seed, or the best one.

        A solution without a grasp states the reason.

        Raises
        ------
        InputError
            When there is no such file.
        KeyError
            On an unknown variation.
        """
        results = self[variation]
        best = results.best or results.solves[0]
        return GraspSolution.load(
            OutputFolder(self.folder).solution_file(SolveId(variation, best.seed if seed is None else seed))
        )

    def rows(self) -> list[Row]:
        """Return the table as one mapping per solve, with column names as keys."""
        output, rows = OutputFolder(self.folder), []
        for variation, rank in zip(self.variations, self.ranks(), strict=True):
            for solve in variation.solves:
                file = f"{SOLVES}/{output.solution_file(SolveId(solve.variation, solve.seed)).name}"
                rows.append(row_of(Entry(self.name, solve, rank if variation.done else None, file)))
        return rows

    def frame(self) -> pd.DataFrame:
        """Return the table as a pandas frame (extra ``tables``).

        Raises
        ------
        MissingExtraError
            When pandas is not installed.
        """
        return frame(self.rows())

    def __str__(self) -> str:
        heads = ["rank", "variation", "mu certified in", "gap", "seeds", "seconds", "starts", "ties with", "active"]
        body = []
        for v, rank, ties in zip(self.variations, self.ranks(), self.ties(), strict=True):
            successes, starts = v.starts
            active = "; ".join(v.best.active) if v.best is not None else ""
            seconds = f"{v.seconds:.1f}" if v.done else ""
            rank_text, seeds = f"{rank}" if v.done else "", f"{v.agreeing}/{len(v.solves)}"
            cells = [v.found, v.gap_text, seeds, seconds, f"{successes}/{starts}"]
            body.append([rank_text, v.name, *cells, "; ".join(ties), active])
        lines = [f"{self.name}: {sum(v.done for v in self.variations)} of {len(self.solves)} solves done"]
        lines += [*columns(heads, body), TABLE_NOTE]
        if not self.comparable:
            lines.append(NOT_COMPARABLE)
        for v in self.variations:
            if v.best is not None and v.best.origin:
                lines.append(f"{v.name}: the grasp is that of {v.best.origin}")
            if v.best is not None and v.best.prices:
                lines.append(f"{v.name}: {'; '.join(str(p) for p in v.best.prices[:3])}")
        lines += [f"{s.variation}, seed {s.seed}: {s.failure}" for s in self.failures if s.failure != NOT_DONE]
        missing = sum(s.failure == NOT_DONE for s in self.failures)
        lines += [f"{missing} solves not done"] if missing else []
        return "\n".join([*lines, *self.notes])


@dataclass(frozen=True)
class VariationResult:
    """All solves of one variation.

    Parameters
    ----------
    name : str
        The variation's.
    solves : tuple of SolveRecord
        One per seed.
    """

    name: str
    solves: tuple[SolveRecord, ...]

    @property
    def best(self) -> SolveRecord | None:
        """Record of the solve with the best certified bounds, or ``None`` if no solve has a grasp."""
        return max((s for s in self.solves if s.success), key=lambda s: (s.mu.upper, s.mu.lower), default=None)

    @cached_property
    def mu(self) -> Bounds:
        """Certified bounds on the best mu of all solves; ``[0, 0]`` without a grasp."""
        bounds = [s.mu for s in self.solves if s.success]
        return Bounds(max(b.lower for b in bounds), max(b.upper for b in bounds)) if bounds else NOTHING

    @property
    def best_possible(self) -> float:
        """Certified upper bound on mu over all placements, the least of all solves; inf without a bound."""
        return min((s.best_possible for s in self.solves), default=math.inf)

    @property
    def gap(self) -> float:
        """Upper bound on the relative optimality gap of the best grasp; inf without a global bound."""
        return max(0.0, self.best_possible / self.mu.lower - 1.0) if self.mu.lower > 0.0 else math.inf

    @property
    def gap_text(self) -> str:
        """Text of the gap for tables; empty without a gap."""
        return format_gap(self.gap)

    @property
    def done(self) -> int:
        """Number of solves with a solution."""
        return sum(s.done for s in self.solves)

    @property
    def starts(self) -> tuple[int, int]:
        """Number of starts with a certified grasp, and number of all starts."""
        return sum(s.succeeded for s in self.solves), sum(len(s.starts) for s in self.solves)

    @property
    def found(self) -> str:
        """Text of the certified interval, or of the reason why there is none."""
        if self.best is not None:
            return str(self.mu)
        return "no grasp" if self.done else "not done" if self.failures[0].failure == NOT_DONE else "failed"

    @property
    def agreeing(self) -> int:
        """Number of solves whose certified interval overlaps the best one."""
        return sum(s.success and s.mu.upper >= self.mu.lower for s in self.solves)

    @property
    def seconds(self) -> float:
        """Median wall time of a solve, seconds."""
        return median([s.seconds for s in self.solves if s.done] or [0.0])

    @property
    def failures(self) -> tuple[SolveRecord, ...]:
        """Records of the solves without a solution."""
        return tuple(s for s in self.solves if not s.done)


def rank_intervals(bounds: Sequence[Bounds]) -> list[int]:
    """Return the rank of each interval: 1 plus the number of intervals wholly above it."""
    return [1 + sum(other.lower > interval.upper for other in bounds) for interval in bounds]


def overlapping_intervals(bounds: Sequence[Bounds]) -> list[tuple[int, ...]]:
    """Return the indices of the other intervals that each interval overlaps."""
    return [
        tuple(j for j, b in enumerate(bounds) if j != i and a.lower <= b.upper and b.lower <= a.upper)
        for i, a in enumerate(bounds)
    ]


@dataclass(frozen=True)
class Entry:
    """Entry of the table: one solve with rank and file.

    Parameters
    ----------
    experiment : str
    record : SolveRecord
    rank : int or None
        Rank of the variation; None if none of its solves are done.
    file : str
        File of the solution, in the output folder.
    """

    experiment: str
    record: SolveRecord
    rank: int | None
    file: str


@dataclass(frozen=True)
class Column:
    """Column of an experiment's table.

    Parameters
    ----------
    name : str
        Heading.
    meaning : str
        Description.
    value : callable
        Function of an entry that returns the cell.
    """

    name: str
    meaning: str
    value: Callable[[Entry], Cell]


COLUMNS = (
    Column("experiment", "name of the experiment", lambda e: e.experiment),
    Column("variation", "name of the variation", lambda e: e.record.variation),
    Column("seed", "of the solve", lambda e: e.record.seed),
    Column("status", "of the solution; failed or not_done where there is none", lambda e: _status_cell(e.record)),
    Column("kind", "mu or mu_tilde", lambda e: e.record.kind),
    Column("mu_lower", "certified, of the grasp found; 0 without one", lambda e: e.record.mu.lower),
    Column("mu_upper", "certified", lambda e: e.record.mu.upper),
    Column(
        "best_possible",
        "certified bound on mu over all placements; empty where there is none",
        lambda e: _finite(e.record.best_possible),
    ),
    Column("gap", "best_possible / mu_lower - 1; empty without a grasp or a bound", lambda e: _finite(e.record.gap)),
    Column("origin", "whose grasp it is; empty where the solve found it", lambda e: e.record.origin),
    Column(
        "rank",
        "of the variation: 1 plus the number of variations that are certainly better; empty where nothing is done",
        lambda e: e.rank,
    ),
    Column("contacts", "number of contacts", lambda e: e.record.contacts),
    Column("starts", "number of starts", lambda e: len(e.record.starts)),
    Column("starts_succeeded", "starts that found a certified grasp", lambda e: e.record.succeeded),
    Column("seconds", "wall time of the solve", lambda e: e.record.seconds),
    Column("iterations", "of IPOPT", lambda e: e.record.iterations),
    Column("active", "constraints at their limits, separated by semicolons", lambda e: "; ".join(e.record.active)),
    Column(
        "prices",
        "shadow prices, change of mu by a step of a limit, separated by semicolons",
        lambda e: "; ".join(map(str, e.record.prices)),
    ),
    Column(
        "measured",
        "digest of task and force budget: mu can be compared where it is the same",
        lambda e: e.record.measured,
    ),
    Column("failure", "why there is no solution", lambda e: e.record.failure),
    Column("file", "of the solution, in the output folder", lambda e: e.file if e.record.done else ""),
)


def _finite(value: float) -> float | None:
    """Return a number for a table, or ``None`` if it is not finite."""
    return value if math.isfinite(value) else None


def _status_cell(record: SolveRecord) -> str:
    """Return the table's text for the status of a solve."""
    if record.status is None:
        return "not_done" if record.failure == NOT_DONE else "failed"
    return record.status.name.lower()


def row_of(entry: Entry) -> Row:
    """Return a solve as a row of the table."""
    return {column.name: column.value(entry) for column in COLUMNS}


def write_csv(rows: Sequence[Row], path: str | Path) -> Path:
    """Write table rows as CSV (RFC 4180, UTF-8) with numbers at full precision."""
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, [column.name for column in COLUMNS])
    writer.writeheader()
    writer.writerows(rows)
    return write_text(path, text.getvalue())


def write_parquet(rows: Sequence[Row], path: str | Path) -> Path:
    """Write table rows as Parquet (extra ``tables``).

    Raises
    ------
    MissingExtraError
        When pyarrow is not installed.
    """
    try:
        import pyarrow as pa
        from pyarrow import parquet
    except ImportError:
        raise MissingExtraError("a Parquet table", EXTRA) from None
    sink = pa.BufferOutputStream()
    parquet.write_table(pa.Table.from_pylist(list(rows)), sink)
    return write_bytes(path, sink.getvalue().to_pybytes())


def frame(rows: Sequence[Row]) -> pd.DataFrame:
    """Return table rows as a pandas frame (extra ``tables``).

    Raises
    ------
    MissingExtraError
        When pandas is not installed.
    """
    try:
        import pandas as pd
    except ImportError:
        raise MissingExtraError("a pandas frame", EXTRA) from None
    return pd.DataFrame(list(rows), columns=[column.name for column in COLUMNS])


def _read_record(output: OutputFolder, solve: SolveId) -> SolveRecord | None:
    """Read the record of a solve from its solution file, or return ``None`` without a file."""
    solution = output.load(solve)
    if solution is None:
        return None
    return replace(SolveRecord.of(solve.variation, solve.seed, solution), earlier=True)


def read_records(
    output: OutputFolder, solves: Sequence[SolveId], digests: Mapping[str, str]
) -> tuple[dict[SolveId, SolveRecord], list[str]]:
    """Read the records of all solves that have files, and return them with a note on each unusable file.

    All solves of a variation have to belong to the problem of its digest; without one, to one and the same problem.
    """
    expected = dict(digests)
    records: dict[SolveId, SolveRecord] = {}
    notes = []
    for solve in solves:
        try:
            record = _read_record(output, solve)
            if record is not None and record.problem != expected.setdefault(solve.variation, record.problem):
                raise InputError(str(output.solution_file(solve)), OTHER_PROBLEM, "the problem of its variation")
        except InputError as error:
            notes.append(f"{solve}: not used, {single_line(str(error))}")
            record = SolveRecord(solve.variation, solve.seed, failure="its file cannot be used")
        if record is not None:
            records[solve] = record
        elif (reason := output.failure(solve)) is not None:
            records[solve] = SolveRecord(solve.variation, solve.seed, failure=reason)
    return records, notes
