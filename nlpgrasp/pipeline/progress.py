"""Progress messages of a solve: none, one line per start, or a user's callback."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable

from nlpgrasp.common.shown.words import measure_word
from nlpgrasp.errors import InputError
from nlpgrasp.quality import Bounds
from nlpgrasp.solution.records import StartRecord, Status

Progress = Callable[[StartRecord, Bounds], None]

WORDS = {
    Status.NO_GRASP: "no grasp",
    Status.TIME_LIMIT: "out of time",
    Status.LOCALLY_INFEASIBLE: "constraints not kept",
}


def told(progress: Progress | bool | None, starts: int) -> Progress | None:
    """Return the callback for finished starts, None without one.

    Parameters
    ----------
    progress : callable, bool or None
        A function as it is; True for lines on standard error; False or None for none.
    starts : int
        How many there are.

    Raises
    ------
    InputError
        On anything else.
    """
    if progress is None or progress is False:
        return None
    if progress is True:
        return Lines(starts)
    if not callable(progress):
        raise InputError("progress", progress, "True for a line a start, or a function of a StartRecord and Bounds")
    return progress


class Lines:
    """Writer of one line per finished start to standard error.

    Parameters
    ----------
    starts : int
        How many there are.
    """

    def __init__(self, starts: int) -> None:
        self._starts, self._done, self._begun = starts, 0, time.monotonic()

    def __call__(self, record: StartRecord, best: Bounds) -> None:
        """Write the line of a start: how it ended, the best certified bounds so far, seconds since the solve began."""
        self._done += 1
        ended = WORDS.get(record.status, record.status.name.lower())
        if record.status is Status.SOLVED:
            ended = f"{measure_word(best.kind)} in {record.mu}"
        so_far = f"best {best}" if best.lower > 0.0 else "no grasp yet"
        seconds = time.monotonic() - self._begun
        sys.stderr.write(f"start {self._done} of {self._starts}: {ended}; {so_far}; {seconds:.1f} s\n")
        sys.stderr.flush()
