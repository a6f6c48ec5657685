"""The tidy table of an experiment: one row a solve, one column a quantity."""

from __future__ import annotations

import csv
import io
from pathlib import Path
from typing import TYPE_CHECKING, Any

from nlpgrasp.common.files import write_bytes, write_text
from nlpgrasp.errors import MissingExtraError
from nlpgrasp.experiments.ask.experiment import SolveId
from nlpgrasp.experiments.found.variation_result import NOT_DONE
from nlpgrasp.experiments.run.folder import SOLVES, Folder

if TYPE_CHECKING:
    import pandas as pd

    from nlpgrasp.experiments.found.result import ExperimentResult

EXTRA = "tables"
COLUMNS: dict[str, str] = {
    "experiment": "name of the experiment",
    "variation": "name of the variation",
    "seed": "of the solve",
    "status": "of the solution; failed or not_done where there is none",
    "kind": "mu or mu_tilde",
    "mu_lower": "certified, of the grasp found; 0 without one",
    "mu_upper": "certified",
    "rank": "of the variation: 1 plus the number of variations that are certainly better; empty where nothing is done",
    "contacts": "number of contacts",
    "starts": "number of starts",
    "starts_succeeded": "starts that found a certified grasp",
    "seconds": "wall time of the solve",
    "iterations": "of IPOPT",
    "active": "constraints at their limits, separated by semicolons",
    "prices": "shadow prices, change of mu by a step of a limit, separated by semicolons",
    "measured": "digest of task and force budget: mu can be compared where it is the same",
    "failure": "why there is no solution",
    "file": "of the solution, in the output folder",
}


def rows(result: ExperimentResult) -> list[dict[str, Any]]:
    """Return one mapping a solve, with the keys of ``COLUMNS``."""
    place = Folder(result.folder)
    table = []
    for variation, rank in zip(result.variations, result.ranks(), strict=True):
        for solve in variation.solves:
            missing = "not_done" if solve.failure == NOT_DONE else "failed"
            file = f"{SOLVES}/{place.file(SolveId(solve.variation, solve.seed)).name}"
            values = (
                result.name,
                solve.variation,
                solve.seed,
                missing if solve.status is None else solve.status.name.lower(),
                solve.kind,
                solve.mu.lower,
                solve.mu.upper,
                rank if variation.done else None,
                solve.contacts,
                len(solve.starts),
                solve.succeeded,
                solve.seconds,
                solve.iterations,
                "; ".join(solve.active),
                "; ".join(str(p) for p in solve.prices),
                solve.measured,
                solve.failure,
                file if solve.done else "",
            )
            table.append(dict(zip(COLUMNS, values, strict=True)))
    return table


def write_csv(result: ExperimentResult, path: str | Path) -> Path:
    """Write the table as CSV (RFC 4180, UTF-8, numbers that read back exactly)."""
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, list(COLUMNS))
    writer.writeheader()
    writer.writerows(rows(result))
    return write_text(path, text.getvalue())


def write_parquet(result: ExperimentResult, path: str | Path) -> Path:
    """Write the table as Parquet (extra ``tables``).

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
    parquet.write_table(pa.Table.from_pylist(rows(result)), sink)
    return write_bytes(path, sink.getvalue().to_pybytes())


def frame(result: ExperimentResult) -> pd.DataFrame:
    """Return the table as a pandas frame (extra ``tables``).

    Raises
    ------
    MissingExtraError
        When pandas is not installed.
    """
    try:
        import pandas as pd
    except ImportError:
        raise MissingExtraError("a pandas frame", EXTRA) from None
    return pd.DataFrame(rows(result), columns=list(COLUMNS))
