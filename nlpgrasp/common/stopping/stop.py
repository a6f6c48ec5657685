"""Stop condition: a deadline and a cancellation flag shared between processes."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

GRACE = 1.0  # s, time left for a certificate after a stop request


@dataclass(frozen=True)
class Stop:
    """Stop condition of a solve: deadline and cancellation flag.

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
        """Return whether the deadline has passed or the user has interrupted the solve."""
        if self.deadline is not None and time.monotonic() >= self.deadline:
            return True
        return self.interrupted()

    def interrupted(self) -> bool:
        """Return whether the user has interrupted the solve."""
        return self.flag is not None and self.flag.exists()

    def certificate_deadline(self, grace: float = GRACE) -> float | None:
        """Return a certificate's deadline, at least a grace period from now; None without deadline and stop request."""
        now = time.monotonic()
        if self.requested():
            return now + grace
        return None if self.deadline is None else max(self.deadline, now + grace)
