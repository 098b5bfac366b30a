"""Seconds spent in each stage of a frame."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager


class Clock:
    """Seconds spent in each stage of one frame."""

    def __init__(self, spent: Mapping[str, float] | None = None) -> None:
        """Begins with given seconds."""
        self.seconds: dict[str, float] = dict(spent or {})

    def move(self, stage: str, other: str, seconds: float) -> None:
        """Moves some of a stage's time to another one."""
        if seconds > 0:
            self.seconds[stage] -= seconds
            self.seconds[other] = self.seconds.get(other, 0.0) + seconds

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        """Adds the time of the block."""
        begin = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[stage] = self.seconds.get(stage, 0.0) + time.perf_counter() - begin
