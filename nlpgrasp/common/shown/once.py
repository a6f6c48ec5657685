"""Warnings issued once per process."""

from __future__ import annotations

import multiprocessing

from nlpgrasp.common.shown.said import warn

_said: set[str] = set()


def say_once(text: str) -> None:
    """Issue a warning once per process, and only in the main process.

    Parameters
    ----------
    text : str
        Warning text.
    """
    if text not in _said and multiprocessing.parent_process() is None:
        _said.add(text)
        warn(text)
