"""Patience: limit of searches in vain, and the reason why no person was found."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from tracker.foundation.errors import GivenUpError
from tracker.foundation.progress import Progress


class Patience:
    """Cost of the search for the first pose of a recording so far, in all frames and stages of a run.

    It counts processor time, of all threads: a busy machine gives up no sooner.
    """

    def __init__(self) -> None:
        """Nothing was searched yet."""
        self._spent_s = 0.0
        self._vain: dict[tuple[int, ...], tuple[str, Sequence[object]]] = {}
        self._why = ""

    def why_not(self, frame: int, asked: Sequence[object]) -> str:
        """Why the same search was in vain before; empty if it was not made.

        Args:
            frame: number of the frame.
            asked: the objects of the search: the very same objects find the same.
        """
        return self._vain.get(_key(frame, asked), ("", ()))[0]

    def in_vain(self, frame: int, asked: Sequence[object], why: str) -> None:
        """Keeps the reason of a search in vain, in one line; see `why_not`."""
        self._why = why
        self._vain[_key(frame, asked)] = why, asked  # kept alive, or another object may have the same number

    @contextmanager
    def spending(self, limit_s: float, progress: Progress) -> Iterator[Progress]:
        """Counts the time of the block.

        Args:
            limit_s: processor time for all such blocks together, seconds.
            progress: gets the progress of the search.

        Yields:
            The progress for the block: it raises a `GivenUpError` once the time is over.
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
            f"nobody was found in {limit_s:g} s of processor time, {frames}{why}: begin where the person is well "
            "visible ([reading] start), give plates or a pose (initialization = "
            '{ use = "given", poses = "start.csv" }), or allow more by loss.start_within_s'
        )


def _key(frame: int, asked: Sequence[object]) -> tuple[int, ...]:
    return (frame, *map(id, asked))
