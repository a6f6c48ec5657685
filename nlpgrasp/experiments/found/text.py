"""Columns of text."""

from __future__ import annotations

from collections.abc import Sequence

WIDEST = 60


def columns(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Return lines with aligned columns; long entries are cut short, empty columns left out."""
    table = [list(heads), *([_short(entry) for entry in row] for row in rows)]
    used = [i for i in range(len(heads)) if any(row[i] for row in table[1:])]
    widths = [max(len(row[i]) for row in table) for i in used]
    return ["  ".join(row[i].ljust(w) for i, w in zip(used, widths, strict=True)).rstrip() for row in table]


def _short(entry: str) -> str:
    return entry if len(entry) <= WIDEST else entry[: WIDEST - 3] + "..."
