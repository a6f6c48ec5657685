"""Wall-clock time of a solve by stage."""

from __future__ import annotations

import time
from collections.abc import Mapping


class Clock:
    """Stopwatch that adds wall time to stages, from one mark to the next.

    Attributes
    ----------
    seconds : dict
        Of each stage, in the order of their first marks.
    """

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._last = time.perf_counter()

    def restart(self) -> None:
        """Count the time since the last mark to no stage."""
        self._last = time.perf_counter()

    def mark(self, stage: str) -> None:
        """Count the time since the last mark to a stage."""
        now = time.perf_counter()
        self.seconds[stage] = self.seconds.get(stage, 0.0) + now - self._last
        self._last = now

    def mark_with(self, parts: Mapping[str, float], rest: str) -> None:
        """Count the time since the last mark to stages that were timed elsewhere, and what is left to ``rest``."""
        now = time.perf_counter()
        for stage, seconds in {**parts, rest: max(0.0, now - self._last - sum(parts.values()))}.items():
            self.seconds[stage] = self.seconds.get(stage, 0.0) + seconds
        self._last = now
