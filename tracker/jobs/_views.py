"""What persons show of the views that they were tracked in: before the run itself begins, or at its end."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import islice
from pathlib import Path

from tracker.alignment.adjustment import align
from tracker.alignment.moments import Tracked, chosen_moments, moments_of
from tracker.frame import Frame
from tracker.progress import Progress
from tracker.reading import Sequence as Recording
from tracker.recording.journal import FILE as JOURNAL
from tracker.result import load_result
from tracker.scene import Scene
from tracker.trajectory import Step

_LONGEST = 500
"""Frames of a run that are looked at again at its end: a long recording is not decoded once more for it."""


def told_of_views(steps: Sequence[Step], scene: Scene, interval_s: float, progress: Progress) -> tuple[str, ...]:
    """Views that are out of step, and cameras that are turned; see `tracker.alignment.ViewAlignment.findings`.

    Args:
        steps: frames that were tracked, with their images.
        scene: the persons with the bodies that they were tracked with.
        interval_s: from one frame to the next, seconds.
        progress: told that all is as it should be; findings are for the caller to tell.
    """
    frames = [Tracked(step.frame.index, step.frame.time_s, step.estimates) for step in steps]
    return _told(frames, (step.frame for step in steps), scene, interval_s, progress)


def told_by_result(folder: Path, sequence: Recording, progress: Progress) -> tuple[str, ...]:
    """The same of the first frames of a finished run; nothing of one that has kept no journal.

    Args:
        folder: the result.
        sequence: its recording.
        progress: as of `told_of_views`.
    """
    if not (folder / JOURNAL).is_file() or not (folder / "run.json").is_file():
        return ()
    result = load_result(folder)
    frames = [Tracked(one.index, one.time_s, one.estimates) for one in islice(result.replays, _LONGEST)]
    return _told(frames, sequence.frames(), result.scene, result.interval_s, progress)


def _told(
    frames: Sequence[Tracked], images: Iterable[Frame], scene: Scene, interval_s: float, progress: Progress
) -> tuple[str, ...]:
    found = align(moments_of(scene, frames, chosen_moments(scene, frames), images), interval_s)
    if found is None:
        return ()
    if not found.findings():
        beside_ms = 1000 * interval_s * float(abs(found.late_frames).max())
        progress(
            f"views: in step to {beside_ms:.0f} ms, cameras as calibrated to {found.turned_px.max():.1f} px, by the "
            f"persons in {found.n_moments} frames"
        )
    return found.findings()
