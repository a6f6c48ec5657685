"""Files that one process holds at a time."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO

from nlpgrasp.errors import InputError

WAIT, AGAIN = 60.0, 0.005  # seconds until it is given up, and between two tries

if sys.platform == "win32":

    def take(file: TextIO) -> bool:
        """Return True: two processes are not kept apart."""
        return True

else:
    import fcntl

    def take(file: TextIO) -> bool:
        """Lock a file until it is closed or this process ends, however it ends; return False where another holds it."""
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        return True


@contextmanager
def held(path: Path) -> Iterator[None]:
    """Hold a lock file, made where there is none, after those who hold it now; processes and threads alike.

    Raises
    ------
    InputError
        When its folder cannot be written, or somebody else holds it for a minute.
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
