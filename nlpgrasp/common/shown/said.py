"""Warnings that name the user's own line."""

from __future__ import annotations

import sys
import warnings

PACKAGE = __name__.split(".")[0]
BETWEEN = (PACKAGE, "contextlib", "functools", "dataclasses")  # whose lines lie between the user's and the warning


def warn(text: str) -> None:
    """Warn, naming the line outside the package that asked for what the warning is about.

    Parameters
    ----------
    text : str
        A sentence.
    """
    warnings.warn(text, UserWarning, stacklevel=1 + _inside())


def _inside() -> int:
    """Return how many of the frames above the caller of ``warn``, that one included, are the package's."""
    frame, level = sys._getframe(2), 1
    while frame.f_back is not None and str(frame.f_globals.get("__name__", "")).split(".")[0] in BETWEEN:
        frame, level = frame.f_back, level + 1
    return level


def asked_by_user() -> bool:
    """Return whether the function that asks was called by a line outside the package."""
    return str(sys._getframe(2).f_globals.get("__name__", "")).split(".")[0] != PACKAGE
