"""Warnings that are attributed to the user's line of code, optionally once per process."""

from __future__ import annotations

import multiprocessing
import sys
import warnings

PACKAGE = __name__.split(".")[0]
SKIPPED = (PACKAGE, "contextlib", "functools", "dataclasses")  # modules whose frames are skipped


def warn(text: str) -> None:
    """Issue a warning attributed to the calling line outside the package.

    Parameters
    ----------
    text : str
        Warning text.
    """
    warnings.warn(text, UserWarning, stacklevel=1 + _package_frames())


def _package_frames() -> int:
    """Return the number of consecutive stack frames in the package, from the caller of ``warn`` upwards."""
    frame, count = sys._getframe(2), 1
    while frame.f_back is not None and str(frame.f_globals.get("__name__", "")).split(".")[0] in SKIPPED:
        frame, count = frame.f_back, count + 1
    return count


def is_called_by_user() -> bool:
    """Return whether the function that calls this one was called from outside the package."""
    return str(sys._getframe(2).f_globals.get("__name__", "")).split(".")[0] != PACKAGE


_issued: set[str] = set()


def warn_once(text: str) -> None:
    """Issue a warning once per process, and only in the main process.

    Parameters
    ----------
    text : str
        Warning text.
    """
    if text not in _issued and multiprocessing.parent_process() is None:
        _issued.add(text)
        warn(text)
