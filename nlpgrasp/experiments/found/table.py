"""The tidy table of an experiment: one row a solve, one column a quantity."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from nlpgrasp.common.files import write_bytes, write_text
from nlpgrasp.errors import MissingExtraError

if TYPE_CHECKING:
    import pandas as pd

EXTRA = "tables"
Row: TypeAlias = dict[str, str | int | float | None]
"""What the table says of one solve, with the keys of ``COLUMNS``."""
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


def write_csv(rows: Sequence[Row], path: str | Path) -> Path:
    """Write rows as CSV (RFC 4180, UTF-8, numbers that read back exactly)."""
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, list(COLUMNS))
    writer.writeheader()
    writer.writerows(rows)
    return write_text(path, text.getvalue())


def write_parquet(rows: Sequence[Row], path: str | Path) -> Path:
    """Write rows as Parquet (extra ``tables``).

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
    """Return rows as a pandas frame (extra ``tables``).

    Raises
    ------
    MissingExtraError
        When pandas is not installed.
    """
    try:
        import pandas as pd
    except ImportError:
        raise MissingExtraError("a pandas frame", EXTRA) from None
    return pd.DataFrame(list(rows), columns=list(COLUMNS))
