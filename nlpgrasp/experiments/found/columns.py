"""Column definitions of an experiment's table."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

from nlpgrasp.experiments.found.record import NOT_DONE, SolveRecord

Cell: TypeAlias = str | int | float | None
Row: TypeAlias = dict[str, Cell]
"""What the table says of one solve, by the names of ``COLUMNS``."""


@dataclass(frozen=True)
class Entry:
    """One solve with its rank and file.

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
    """A column of an experiment's table.

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


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


COLUMNS = (
    Column("experiment", "name of the experiment", lambda e: e.experiment),
    Column("variation", "name of the variation", lambda e: e.record.variation),
    Column("seed", "of the solve", lambda e: e.record.seed),
    Column("status", "of the solution; failed or not_done where there is none", lambda e: _status(e.record)),
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


def row_of(entry: Entry) -> Row:
    """Return a solve as a row of the table."""
    return {column.name: column.value(entry) for column in COLUMNS}


def _status(record: SolveRecord) -> str:
    if record.status is None:
        return "not_done" if record.failure == NOT_DONE else "failed"
    return record.status.name.lower()
