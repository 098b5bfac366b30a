"""A record of any length, looked at in windows of frames, so that memory does not grow with it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from tracker.foundation.arrays import Array, Integers
from tracker.points.following.record import Rows, between, trajectories_of
from tracker.points.trajectories import PointTrajectories

MOST_SIGHTINGS = 150_000
"""Sightings that are held at a time: as trajectories with all that is computed of them about 0.5 GB."""

# Shorter windows would be margins above all.
_LEAST_FRAMES = 32


@dataclass(frozen=True)
class Window:
    """Some frames of a record."""

    trajectories: PointTrajectories
    """Of these frames and of some before and after."""

    inner: slice
    """These frames among them."""


def windows(
    rows: Rows,
    frames: Integers,
    times: Array,
    margin: int,
    changed: Callable[[Rows], Rows] = lambda rows: rows,
    most_sightings: int = MOST_SIGHTINGS,
) -> Iterator[Window]:
    """Cuts a record into windows that follow one another.

    Args:
        rows: sightings in the order of the frames.
        frames: (T,) all frame numbers.
        times: (T,) seconds.
        margin: frames before and after that each window has, too.
        changed: what is done to the sightings first.
        most_sightings: held at a time, about.
    """
    n_frames = len(frames)
    size = max(_LEAST_FRAMES, int(most_sightings * n_frames / max(len(rows), 1)))
    for begin in range(0, n_frames, size):
        end = min(begin + size, n_frames)
        first, last = max(0, begin - margin), min(n_frames, end + margin)
        own = changed(between(rows, int(frames[first]), int(frames[last - 1]) + 1))
        trajectories = trajectories_of(own, frames[first:last], times[first:last])
        yield Window(trajectories, slice(begin - first, end - first))
