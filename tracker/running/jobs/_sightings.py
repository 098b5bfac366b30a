"""The sightings of a following, recorded frame by frame, with what it goes on from when it is interrupted."""

from __future__ import annotations

import time
from collections.abc import Iterable
from pathlib import Path

from tracker.foundation.progress import Progress
from tracker.points.following.points import Points
from tracker.points.following.record import append, shortened
from tracker.points.following.sequence import Counts, SavedState, save_state
from tracker.points.trajectories import PointFrame
from tracker.running.jobs import ResultFolder
from tracker.running.jobs._stopping import stopping

RECORD = "points.bin"
"""In the result folder."""


def begun(folder: Path, state: SavedState | None) -> Counts:
    """What has been followed so far: the record in the folder holds that and no more.

    Raises:
        SequenceError: the record is shorter than the state says.
    """
    record = folder / RECORD
    if state is None:
        record.touch()
        return Counts()
    shortened(record, state.n_bytes)
    return Counts(list(state.frames), list(state.times), state.seconds, warnings=list(state.warnings))


def record_sightings(
    steps: Iterable[tuple[PointFrame, Points]],
    folder: ResultFolder,
    counts: Counts,
    planned: tuple[int, int],
    progress: Progress,
) -> None:
    """Writes every frame as it comes, until the last one or until somebody asks to stop, which saves the state.

    Args:
        steps: the frames, each with the points that the following goes on with.
        folder: where the record is; it is kept from the first frame on.
        counts: what has been followed before; these frames are added.
        planned: frames of the recording, and those from one saved state to the next.
        progress: told how far it is.

    Raises:
        KeyboardInterrupt: somebody asked before there was a frame.
    """
    n_frames, saved_frames = planned
    record, begin, n_points = folder.path / RECORD, time.perf_counter(), 0
    seconds_before = counts.seconds
    with stopping() as stop:
        try:
            for k, (frame, points) in enumerate(steps):
                append(record, frame)
                counts.frames.append(frame.index)
                counts.times.append(frame.time_s)
                n_points += int(frame.alive.sum())
                counts.seconds = seconds_before + time.perf_counter() - begin
                if len(counts.frames) % saved_frames == 0:
                    save_state(folder.path, points, counts, record.stat().st_size)
                folder.keep()
                seconds = max(counts.seconds - seconds_before, 1e-9)
                rate = f"{int(frame.alive.sum())} points seen, {n_points / seconds:.0f} points/s"
                progress("following", len(counts.frames), n_frames, rate if k else "")
                stop.patient = True
                if stop.asked and len(counts.frames) < n_frames:
                    save_state(folder.path, points, counts, record.stat().st_size)
                    raise KeyboardInterrupt
        except KeyboardInterrupt:
            if not counts.frames:
                raise
            counts.interrupted = True
    counts.seconds = seconds_before + time.perf_counter() - begin
