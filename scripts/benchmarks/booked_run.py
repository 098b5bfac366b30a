"""`bodytrack` in a process that books its CPU seconds, of all threads, to the stages of a whole run.

What a thread does beside the main one is booked to the stage that the main one is in.
"""

from __future__ import annotations

import functools
import importlib
import json
import resource
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

STAGES = {
    "tracker.running.jobs.track:TrackJob.open": "opening",
    "tracker.running.jobs.track:looked_at": "opening",
    "tracker.running.jobs.track:first_sought": "opening",
    "tracker.acquisition.body_fit:fit_to_views": "body, fit",
    "tracker.acquisition.body_fit:things_of": "body, things",
    "tracker.running.jobs.track:with_fitted_bodies": "body, tracked",
    "tracker.running.jobs.track:without_persons": "start",
    "tracker.running.jobs.track:behind_who_stays": "start",
    "tracker.tracking.sequence:_begun": "start",
    "tracker.running.jobs._record:_written": "writing",
    "tracker.running.jobs._record:_finish": "writing, end",
}
"""Function that the main thread calls -> stage; what it calls of these has its own. What is left is the pass."""

FILE = "booked.json"


class Book:
    """CPU seconds by stage, and the largest memory."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = defaultdict(float)
        self._open = ["importing"]
        self._since = 0.0

    def turn(self) -> None:
        """Books what was spent since the last turn to the stage that is open."""
        now = time.process_time()
        self.seconds[self._open[-1]] += now - self._since
        self._since = now

    def open(self, stage: str) -> None:
        """Books what follows to another stage, where nothing else is booked."""
        self.turn()
        self._open = [stage]

    def booked(self, function: Callable[..., Any], stage: str) -> Callable[..., Any]:
        """The function, its time booked to a stage."""

        @functools.wraps(function)
        def call(*args: Any, **kwargs: Any) -> Any:
            self.turn()
            self._open.append(stage)
            try:
                return function(*args, **kwargs)
            finally:
                self.turn()
                self._open.pop()

        return call


def main() -> None:
    """Runs the command line given, and leaves `booked.json` in the folder it is run in."""
    book = Book()
    for place, stage in STAGES.items():
        module, _, path = place.partition(":")
        *owners, name = path.split(".")
        owner: Any = functools.reduce(getattr, owners, importlib.import_module(module))
        if hasattr(owner, name):  # a checkout of another day may lack it
            setattr(owner, name, book.booked(getattr(owner, name), stage))
    book.open("pass")
    try:
        importlib.import_module("tracker.__main__").main()
    finally:
        book.turn()
        children = resource.getrusage(resource.RUSAGE_CHILDREN)
        book.seconds["children"] = children.ru_utime + children.ru_stime
        peak_gib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
        Path(FILE).write_text(json.dumps({"seconds": book.seconds, "peak_gib": peak_gib}), encoding="utf-8")


if __name__ == "__main__":
    main()
