"""What a run of cameras that film now cannot do, for its frames come but once."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from tracker.images.reading import Sequence
from tracker.images.reading.live import LiveCounts, counts_of
from tracker.tracking.cycle import Cycle

__all__ = ["LiveCounts", "counts_of", "is_live", "patiently", "settings_missing"]


def is_live(read: Any) -> bool:
    """Whether a reading, or what it opens, is of cameras that film now."""
    return bool(getattr(read, "live", False))


def settings_missing(job: Any) -> Iterator[str]:
    """Settings of a tracking job that look at frames twice, as they must be for cameras that film now."""
    if job.passes != 1:
        yield "passes = 1"
    if job.inspection:
        yield "inspection = false"
    fitted = [one.name for one in job.persons if one.is_fitted]
    if fitted:
        yield f'shape = "model" of {", ".join(fitted)}'
    if job.smoothing is not None:
        yield "no smoothing (`bodytrack result smooth` afterwards)"
    if job.keypoints is not None:
        yield "no keypoints"


def patiently(cycle: Cycle, sequence: Sequence) -> Cycle:
    """The cycle that waits for somebody to come before cameras that film now, however long that takes."""
    return replace(cycle, loss=replace(cycle.loss, start_within=sequence.n_frames))
