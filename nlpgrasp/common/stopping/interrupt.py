"""Ctrl-C keeps what was found."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable
from types import FrameType, TracebackType

from nlpgrasp.common.stopping.stop import Stop


class Interrupt:
    """While active, Ctrl-C raises the stop flag instead of an exception: the solve winds down and returns.

    Pressing it again changes nothing; a solve that has been told to stop returns within seconds.
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
