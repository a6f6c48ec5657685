"""Warnings that are said once."""

from __future__ import annotations

import multiprocessing
import warnings

_said: set[str] = set()


def say_once(text: str, stacklevel: int = 2) -> None:
    """Warn, each thing once in a process; worker processes leave it to the one that began them.

    Parameters
    ----------
    text : str
        A sentence.
    stacklevel : int
        Whose line the warning names: 2 for that of the function that calls this one.
    """
    if text not in _said and multiprocessing.parent_process() is None:
        _said.add(text)
        warnings.warn(text, UserWarning, stacklevel=stacklevel + 1)
