"""Table of an experiment in tidy form: one row per solve, one column per quantity."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from nlpgrasp.common.files import write_bytes, write_text
from nlpgrasp.errors import MissingExtraError
from nlpgrasp.experiments.found.columns import COLUMNS, Row

if TYPE_CHECKING:
    import pandas as pd

EXTRA = "tables"


def write_csv(rows: Sequence[Row], path: str | Path) -> Path:
    """Write rows as CSV (RFC 4180, UTF-8) with numbers at full precision."""
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, [column.name for column in COLUMNS])
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
    return pd.DataFrame(list(rows), columns=[column.name for column in COLUMNS])
