"""How far a piece of work is: the one way in which the library tells, for it never prints."""

from __future__ import annotations

import threading
from typing import Protocol

WARNING = "input: "
"""What a message begins with that stays to be read: something is wrong with the input."""


class Progress(Protocol):
    """Told how far a piece of work is."""

    def __call__(self, what: str, done: int = 0, total: int = 0, detail: str = "") -> None:
        """Takes note, and returns soon.

        Args:
            what: is being done, e.g. `tracking`; with nothing else it is a message.
            done: how much of it is done.
            total: how much there is; 0 where nothing is counted.
            detail: what is worth knowing meanwhile, e.g. `12.5 frames/s`.
        """


def within(progress: Progress, label: str) -> Progress:
    """A progress that says what it is a step of."""

    def labelled(what: str, done: int = 0, total: int = 0, detail: str = "") -> None:
        progress(f"{label}: {what}", done, total, detail)

    return labelled


class Tally:
    """Counts pieces of work as they are begun, by whatever thread, and tells `pose 5 of 12`."""

    def __init__(self, progress: Progress, piece: str, total: int = 0) -> None:
        """Nothing is begun.

        Args:
            progress: told of each piece.
            piece: what is counted.
            total: how many there are, as far as is known.
        """
        self._progress, self._piece, self._total = progress, piece, total
        self._begun, self._lock = 0, threading.Lock()

    def expect(self, n: int) -> None:
        """There are n more."""
        with self._lock:
            self._total += n

    def begin(self) -> None:
        """One more is begun."""
        with self._lock:
            self._begun += 1
            told = f"{self._piece} {self._begun} of {max(self._begun, self._total)}"
        self._progress(told)


def silent(what: str, done: int = 0, total: int = 0, detail: str = "") -> None:
    """Tells nobody."""
