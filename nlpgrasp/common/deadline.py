"""Deadlines, cancellation by Ctrl-C, and timing of stages."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import FrameType, TracebackType

GRACE = 1.0  # s, time left for a certificate after a stop request


@dataclass(frozen=True)
class Deadline:
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

    def should_stop(self) -> bool:
        """Return whether the deadline has passed or the user has interrupted the solve."""
        if self.deadline is not None and time.monotonic() >= self.deadline:
            return True
        return self.is_interrupted()

    def is_interrupted(self) -> bool:
        """Return whether the user has interrupted the solve."""
        return self.flag is not None and self.flag.exists()

    def certificate_deadline(self, grace: float = GRACE) -> float | None:
        """Return the deadline of a certificate, at least ``grace`` seconds from now.

        None if the solve has no deadline and was not interrupted.
        """
        now = time.monotonic()
        if self.should_stop():
            return now + grace
        return None if self.deadline is None else max(self.deadline, now + grace)


class InterruptHandler:
    """Context manager in which Ctrl-C ends a solve early, so that it still returns its result.

    Pressing it again has no effect; a stopped solve returns within seconds.
    """

    def __init__(self, deadline: Deadline) -> None:
        self._deadline = deadline
        self._previous: Callable[[int, FrameType | None], object] | int | None = None

    def __enter__(self) -> InterruptHandler:
        if threading.current_thread() is threading.main_thread():
            self._previous = signal.getsignal(signal.SIGINT)
            signal.signal(signal.SIGINT, self._handle)
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, tb: TracebackType | None) -> None:
        if self._previous is not None:
            signal.signal(signal.SIGINT, self._previous)

    def _handle(self, *_: object) -> None:
        if self._deadline.flag is not None:
            self._deadline.flag.touch()


class Stopwatch:
    """Stopwatch that adds up wall time by stage.

    Attributes
    ----------
    seconds : dict
        Of each stage, in the order of their first marks.
    """

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._last = time.perf_counter()

    def restart(self) -> None:
        """Restart the measurement, so that the time since the last mark counts for no stage."""
        self._last = time.perf_counter()

    def mark(self, stage: str) -> None:
        """Add the time since the last mark to a stage."""
        now = time.perf_counter()
        self.seconds[stage] = self.seconds.get(stage, 0.0) + now - self._last
        self._last = now

    def mark_with(self, parts: Mapping[str, float], rest: str) -> None:
        """Add known times to their stages, and the remaining time since the last mark to ``rest``."""
        now = time.perf_counter()
        for stage, seconds in {**parts, rest: max(0.0, now - self._last - sum(parts.values()))}.items():
            self.seconds[stage] = self.seconds.get(stage, 0.0) + seconds
        self._last = now
