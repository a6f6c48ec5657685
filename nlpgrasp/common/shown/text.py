"""Text formatting for terminals and files: one-line errors, aligned columns."""

from __future__ import annotations

from collections.abc import Sequence

from nlpgrasp.errors import NlpgraspError

LONGEST = 1000  # most characters of a line
WIDEST = 60  # most characters of a column


def one_line(error: BaseException) -> str:
    """Return an error's message as one nonempty line of printable characters."""
    text = str(error)
    if not isinstance(error, NlpgraspError) or not text.strip():
        text = f"{type(error).__name__}: {text}" if text.strip() else type(error).__name__
    return plain(text)


def plain(text: str) -> str:
    """Return a text as one line of printable characters, truncated if very long."""
    words = " ".join(text.split())
    return "".join(c if c.isprintable() else "?" for c in words)[:LONGEST]


def capital(text: str) -> str:
    """Return a text with its first letter capitalised."""
    return f"{text[:1].upper()}{text[1:]}"


def columns(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Return lines with aligned columns; long entries are truncated, empty columns omitted."""
    table = [list(heads), *([_short(entry) for entry in row] for row in rows)]
    used = [i for i in range(len(heads)) if any(row[i] for row in table[1:])]
    widths = [max(len(row[i]) for row in table) for i in used]
    return ["  ".join(row[i].ljust(w) for i, w in zip(used, widths, strict=True)).rstrip() for row in table]


def _short(entry: str) -> str:
    return entry if len(entry) <= WIDEST else entry[: WIDEST - 3] + "..."
