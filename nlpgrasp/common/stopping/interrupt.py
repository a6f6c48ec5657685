"""Ctrl-C handling that keeps intermediate results."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable
from types import FrameType, TracebackType

from nlpgrasp.common.stopping.stop import Stop


class Interrupt:
    """Context manager in which Ctrl-C sets the stop flag, so that a solve ends early and returns its result.

    Pressing it again has no effect; a stopped solve returns within seconds.
    """

    def __init__(self, stop: Stop) -> None:
        self.stop = stop
        self._previous: Callable[[int, FrameType | None], object] | int | None = None

    def __enter__(self) -> Interrupt:
        if threading.current_thread() is threading.main_thread():
            self._previous = signal.getsignal(signal.SIGINT)
            signal.signal(signal.SIGINT, self._handle)
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, tb: TracebackType | None) -> None:
        if self._previous is not None:
            signal.signal(signal.SIGINT, self._previous)

    def _handle(self, *_: object) -> None:
        if self.stop.flag is not None:
            self.stop.flag.touch()
