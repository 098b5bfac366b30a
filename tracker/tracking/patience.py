"""Patience: how long somebody is looked for in vain, and what kept him from being found."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from tracker.foundation.errors import GivenUpError
from tracker.foundation.progress import Progress


class Patience:
    """What looking for the first pose of a recording has cost so far, in all frames and stages of a run.

    Processor time is counted, of all threads: a machine that has other work to do gives up no sooner.
    """

    def __init__(self) -> None:
        """Nothing was looked for yet."""
        self._spent_s = 0.0
        self._vain: dict[tuple[int, ...], tuple[str, Sequence[object]]] = {}
        self._why = ""

    def why_not(self, frame: int, asked: Sequence[object]) -> str:
        """Why the same search was in vain before; empty if it was not made.

        Args:
            frame: the number of the frame looked at.
            asked: whom and what was asked: the very same objects find the same.
        """
        return self._vain.get(_key(frame, asked), ("", ()))[0]

    def in_vain(self, frame: int, asked: Sequence[object], why: str) -> None:
        """Keeps why a search was in vain, in one line; see `why_not`."""
        self._why = why
        self._vain[_key(frame, asked)] = why, asked  # kept alive, or another object may have the same number

    @contextmanager
    def spending(self, limit_s: float, progress: Progress) -> Iterator[Progress]:
        """Counts what is spent in the block.

        Args:
            limit_s: processor time that all such blocks may take together, seconds.
            progress: told how far the search is.

        Yields:
            The progress to tell in the block: it raises a `GivenUpError` once the time is spent.
        """
        begin = time.process_time()

        def watched(what: str, done: int = 0, total: int = 0, detail: str = "") -> None:
            if self._spent_s + time.process_time() - begin > limit_s:
                raise GivenUpError(self._told(limit_s))
            progress(what, done, total, detail)

        try:
            yield watched
        finally:
            self._spent_s += time.process_time() - begin

    def _told(self, limit_s: float) -> str:
        frames = f"{len(self._vain)} frame{'s' * (len(self._vain) != 1)} searched to the end"
        why = f"; the last reason: {self._why}" if self._why else ""
        return (
            f"nobody was found in {limit_s:g} s of processor time, {frames}{why}: begin where the person is seen well "
            '([reading] start), give plates or a pose (initialization = { use = "given", poses = "start.csv" }), or '
            "allow more by loss.start_within_s"
        )


def _key(frame: int, asked: Sequence[object]) -> tuple[int, ...]:
    return (frame, *map(id, asked))
