"""File locks between processes."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO

from nlpgrasp.errors import InputError

WAIT, AGAIN = 60.0, 0.005  # s, time-out and interval of attempts

if sys.platform == "win32":

    def take(file: TextIO) -> bool:
        """Return True without locking, which is not supported on Windows."""
        return True

else:
    import fcntl

    def take(file: TextIO) -> bool:
        """Lock a file until it is closed or the process ends; return False if another holds it."""
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        return True


@contextmanager
def held(path: Path) -> Iterator[None]:
    """Hold an exclusive lock file, created if needed, against other processes and threads.

    Raises
    ------
    InputError
        When its folder cannot be written, or another holds it for a minute.
    """
    try:
        file = path.open("a")
    except OSError as error:
        raise InputError(str(path.parent), error.strerror or "no lock", "a folder that can be written") from None
    with file:
        given_up = time.monotonic() + WAIT
        while not take(file):
            if time.monotonic() > given_up:
                raise InputError(str(path.parent), f"in use by another process for {WAIT:.0f} s", "a folder let go")
            time.sleep(AGAIN)
        yield
