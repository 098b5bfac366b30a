"""How far a piece of work is: the one way in which the library tells, for it never prints."""

from __future__ import annotations

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


def silent(what: str, done: int = 0, total: int = 0, detail: str = "") -> None:
    """Tells nobody."""
