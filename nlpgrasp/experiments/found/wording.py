"""Errors in one line that can be written and shown anywhere."""

from __future__ import annotations

from nlpgrasp.errors import NlpgraspError

LONGEST = 1000


def one_line(error: BaseException) -> str:
    """Return what an error says, never empty: one line of printable characters."""
    text = str(error)
    if not isinstance(error, NlpgraspError) or not text.strip():
        text = f"{type(error).__name__}: {text}" if text.strip() else type(error).__name__
    return plain(text)


def plain(text: str) -> str:
    """Return a text as one line of printable characters, cut where it is very long."""
    words = " ".join(text.split())
    return "".join(c if c.isprintable() else "?" for c in words)[:LONGEST]
