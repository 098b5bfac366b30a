"""Ctrl-C and SIGTERM while frames are computed: the first one lets the frame and the report be finished."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator
from types import FrameType

_SIGNALS = signal.SIGINT, signal.SIGTERM


class Stop:
    """Whether a job has been asked to stop."""

    def __init__(self) -> None:
        self.asked = False
        self.patient = False
        """Whether there is something to be finished; without it, the first request ends the job."""

    def heard(self) -> bool:
        """Whether it was asked, for those who then end soon with what they have."""
        self.patient = True
        return self.asked

    def ask(self, number: int = 0, frame: FrameType | None = None) -> None:
        """Asks; whoever asks twice does not want to wait.

        Raises:
            KeyboardInterrupt: it was asked before, or nothing is to be finished.
        """
        if self.asked or not self.patient:
            raise KeyboardInterrupt
        self.asked = True


@contextlib.contextmanager
def stopping(stop: Stop | None = None) -> Iterator[Stop]:
    """Takes signals as a request to stop; in a thread of a program that has others, the program decides."""
    stop = stop or Stop()
    if threading.current_thread() is not threading.main_thread():
        yield stop
        return
    before = [(number, signal.signal(number, stop.ask)) for number in _SIGNALS]
    try:
        yield stop
    finally:
        for number, handler in before:
            signal.signal(number, handler)
