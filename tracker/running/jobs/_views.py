"""What persons show of the views that they were tracked in: before the run itself begins, or at its end."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import takewhile

from tracker.bodies.scene import Scene
from tracker.cameras.frame import Frame
from tracker.foundation.progress import Progress, silent
from tracker.images.reading import Sequence as Recording
from tracker.results.alignment.adjustment import align
from tracker.results.alignment.moments import Tracked, chosen_moments, moments_of
from tracker.tracking.estimate import Estimate
from tracker.tracking.trajectory import Step

_LONGEST = 500
"""Frames of a run that are looked at again at its end: a long recording is not decoded once more for it."""


_COVERED = 0.5
"""Share of a run's frames that those compared have to reach over, for views to be called in step."""


def told_of_views(steps: Sequence[Step], scene: Scene, interval_s: float, progress: Progress) -> tuple[str, ...]:
    """Views that are out of step, and cameras that are turned; see `tracker.results.alignment.ViewAlignment.findings`.

    Args:
        steps: frames that were tracked, with their images.
        scene: the persons with the bodies that they were tracked with.
        interval_s: from one frame to the next, seconds.
        progress: told that all is as it should be; findings are for the caller to tell.
    """
    frames = [Tracked(step.frame.index, step.frame.time_s, step.estimates) for step in steps]
    return _told(frames, (step.frame for step in steps), scene, interval_s, progress)


def told_of_known(
    known: Mapping[int, Sequence[Estimate]], frames: Iterable[Frame], scene: Scene, interval_s: float
) -> tuple[str, ...]:
    """As `told_of_views`, of frames whose poses an interrupted run has kept.

    Args:
        known: frame -> the poses of all persons.
        frames: of the recording, from the first one on.
        scene: the persons with the bodies that they were tracked with.
        interval_s: from one frame to the next, seconds.
    """
    until = takewhile(lambda frame: frame.index <= max(known), frames)
    seen = [frame for frame in until if frame.index in known]
    tracked = [Tracked(frame.index, frame.time_s, tuple(known[frame.index])) for frame in seen]
    return _told(tracked, seen, scene, interval_s, silent)


class Tracks:
    """The poses of the first frames of a run, of which the same is asked at its end."""

    def __init__(self) -> None:
        self._frames: list[Tracked] = []

    def kept(self, steps: Iterable[Step]) -> Iterator[Step]:
        """The frames of a run as they come."""
        for step in steps:
            if len(self._frames) < _LONGEST:
                self._frames.append(Tracked(step.frame.index, step.frame.time_s, step.estimates))
            yield step

    def told(self, scene: Scene, sequence: Recording, progress: Progress) -> tuple[str, ...]:
        """See `told_of_views`.

        Args:
            scene: the persons as they were tracked.
            sequence: the recording, of which the fastest frames are read again.
            progress: as of `told_of_views`.
        """
        return _told(self._frames, sequence.frames(), scene, sequence.interval_s, progress)


def _told(
    frames: Sequence[Tracked], images: Iterable[Frame], scene: Scene, interval_s: float, progress: Progress
) -> tuple[str, ...]:
    moments = moments_of(scene, frames, chosen_moments(scene, frames), images)
    found = align(moments, interval_s)
    if found is None:
        return ()
    if not found.findings():
        beside_ms = 1000 * interval_s * float(abs(found.late_frames).max())
        first, last = moments[0].frame.index, moments[-1].frame.index
        turned = f"cameras as calibrated to {found.turned_px.max():.1f} px"
        if last - first < _COVERED * (frames[-1].index - frames[0].index):
            # a delay that grows shows where poses fit at all: 17 of 50 frames of a view at double speed, to 8 ms
            told = f"persons move enough, without doubt, in {found.n_moments} frames from {first} to {last} alone"
            progress(f"views: {turned}; {told}: too few to tell whether views are in step all along")
        else:
            told = f"by the persons in {found.n_moments} frames from {first} to {last}: of others that says nothing"
            progress(f"views: in step to {beside_ms:.0f} ms, {turned}, {told}")
    return found.findings()
