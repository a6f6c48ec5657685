"""When to stop: a deadline, and a flag that reaches other processes."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

GRACE = 1.0  # seconds a certificate may still take once a stop was requested


@dataclass(frozen=True)
class Stop:
    """Asks a start to finish with what it has.

    Parameters
    ----------
    deadline : float or None
        ``time.monotonic()`` value.
    flag : Path or None
        A file that exists once the user has interrupted the solve.
    """

    deadline: float | None = None
    flag: Path | None = None

    def requested(self) -> bool:
        """Return whether to finish now."""
        if self.deadline is not None and time.monotonic() >= self.deadline:
            return True
        return self.interrupted()

    def interrupted(self) -> bool:
        """Return whether the user has interrupted the solve."""
        return self.flag is not None and self.flag.exists()

    def certificate_deadline(self, grace: float = GRACE) -> float | None:
        """Return when a certificate has to be done: so many seconds from now once a stop was requested."""
        now = time.monotonic()
        if self.requested():
            return now + grace
        return None if self.deadline is None else max(self.deadline, now + grace)
