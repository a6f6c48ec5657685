"""Warnings that are said once."""

from __future__ import annotations

import multiprocessing

from nlpgrasp.common.shown.said import warn

_said: set[str] = set()


def say_once(text: str) -> None:
    """Warn, each thing once in a process; worker processes leave it to the one that began them.

    Parameters
    ----------
    text : str
        A sentence.
    """
    if text not in _said and multiprocessing.parent_process() is None:
        _said.add(text)
        warn(text)
