"""Gives the frames of a tracking run to its recorders; the run's outcome when it ends, is stopped or fails."""

from __future__ import annotations

import contextlib
import logging
import shutil
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import takewhile
from pathlib import Path
from types import MappingProxyType

from tracker.bodies.scene import Scene
from tracker.cameras.frame import Frame
from tracker.foundation.configuration.tables import component_name
from tracker.foundation.errors import ConfigError, TrackerError
from tracker.foundation.files import remove_unfinished
from tracker.foundation.progress import Progress, in_words, silent
from tracker.images.reading import Sequence as ReadSequence
from tracker.results.alignment import ViewAlignment
from tracker.results.alignment.adjustment import align
from tracker.results.alignment.moments import Tracked, chosen_moments, moments_of
from tracker.results.recording import Recorder, Recording, RunContext
from tracker.results.recording.journal import FILE as JOURNAL
from tracker.results.result import load_result
from tracker.results.smoothed_result import FOLDER, Pictures, write_smoothed
from tracker.results.smoothing import Smoothing
from tracker.running.jobs import ResultFolder
from tracker.running.jobs._folder import Stop, stopping
from tracker.tracking.doubts import Doubts
from tracker.tracking.estimate import Estimate
from tracker.tracking.trajectory import Step

log = logging.getLogger("tracker")


@dataclass(frozen=True)
class TrackOutcome:
    """Outcome of a tracking job."""

    folder: Path
    n_frames: int
    doubts: Doubts
    """Warnings to check before the result is used."""

    interrupted: bool = False
    files: tuple[Path, ...] = ()
    """Files of the recordings in the folder."""

    keypoints: str = ""
    """Effect of keypoints, in a sentence; empty without keypoints."""

    seconds: float = 0.0
    """Time of the run, including the start, fitted bodies and smoothing."""

    remarks: tuple[str, ...] = ()
    """More lines for the end."""

    stages_s: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    """Times of the stages of tracking in all frames, seconds."""


def recorded(
    recordings: Iterable[Recording],
    context: RunContext,
    steps: Iterable[Step],
    folder: ResultFolder,
    running: tuple[Progress, Stop],
    conclude: Callable[[], None],
) -> TrackOutcome:
    """Feeds every recorder. They are finished, whatever happens, if there are more frames than before.

    Args:
        recordings: the recorders.
        context: the run.
        steps: its frames, in order.
        folder: place of the results; it is kept from the first frame on.
        running: gets the progress, and says whether to stop.
        conclude: called after the last frame, before the recorders finish; not after an interruption.
    """
    progress, stop = running
    doubts, n_frames, interrupted, pace = Doubts(), 0, False, _Pace(context.n_frames)
    files: list[Path] = []
    with stopping(stop), _tidied(context.folder), contextlib.ExitStack() as finishing:
        recorders: list[Recorder] = []
        for recording in recordings:
            recorders.append(recording.begin(context))
            finishing.callback(_finish, recorders[-1], files)
        finishing.callback(progress, "writing the results")
        try:
            progress("tracking", 0, context.n_frames)
            for n_frames, step in enumerate(steps, start=1):
                _written(step, recorders)
                folder.keep()
                doubts = doubts.after(step)
                _log_step(step)
                progress("tracking", n_frames, context.n_frames, pace.after(step, doubts))
                stop.patient = n_frames >= len(context.resumed)
                unfinished = step.provisional or n_frames < context.n_frames
                if stop.asked and unfinished and not step.ready:
                    raise KeyboardInterrupt
            conclude()
        except KeyboardInterrupt:
            if not folder.kept:
                raise
            interrupted = True
            log.warning("interrupted after %d frames", n_frames)
        except TrackerError as error:
            log.error("%s", error)
            raise
        finally:
            if n_frames < len(context.resumed):
                finishing.pop_all()  # the interrupted run has left more
    stages_s = MappingProxyType(pace.in_all)
    return TrackOutcome(context.folder, n_frames, doubts, interrupted, tuple(files), stages_s=stages_s)


@contextlib.contextmanager
def _tidied(folder: Path) -> Iterator[None]:
    """Removes new files of recorders that replace other files."""
    remove_unfinished(folder)
    try:
        yield
    finally:
        remove_unfinished(folder)


def _written(step: Step, recorders: Iterable[Recorder]) -> None:
    """Gives a frame to every recorder, with its images unpacked once."""
    step = replace(step, frame=step.frame.unpacked())
    for recorder in recorders:
        recorder.write(step)


def _finish(recorder: Recorder, files: list[Path]) -> None:
    """Finishes a recorder and puts its files before those of the recorders finished earlier: the last ends first."""
    files[:0] = recorder.finish()


class _Pace:
    """Frames per second over the last second of a usual recording, and the time left at that pace."""

    def __init__(self, n_frames: int) -> None:
        self._recent: deque[float] = deque(maxlen=25)
        self._to_go = n_frames
        self.in_all = Counter[str]()
        """Seconds of each stage in all frames."""

    def after(self, step: Step, doubts: Doubts) -> str:
        """Line about a frame."""
        self.in_all.update(step.seconds)
        self._recent.append(sum(step.seconds.values()))
        self._to_go -= 1
        frame_s = max(sum(self._recent), 1e-9) / len(self._recent)
        told = [f"{1 / frame_s:.1f} frames/s"]
        if self._to_go > 0:
            told.append(f"about {in_words(self._to_go * frame_s)} left")
        told += [f"{len(doubts.lost)} lost"] * bool(doubts.lost)
        told += [f"{len(doubts.doubtful)} doubtful"] * bool(doubts.doubtful)
        return ", ".join(told)


def _log_step(step: Step) -> None:
    for person, estimate in zip(step.scene.persons, step.estimates, strict=True):
        log.info(
            "frame %d %s %s %.2f px, %.0f %% explained, %.0f ms",
            step.frame.index,
            person.name,
            estimate.verdict,
            estimate.distance_px,
            100 * estimate.account.explained,
            1000 * sum(step.seconds.values()),
        )
    for person, found in zip(step.scene.persons, step.start_confidence, strict=False):
        log.info("frame %d %s start pose of confidence %.2f", step.frame.index, person.name, found)
    for v, fault in step.untrusted.items():
        log.info("frame %d: foreground of view %s not used: %s", step.frame.index, step.scene.rig.names[v], fault)
    if step.why_unfound:
        log.info("nobody was found: %s", step.why_unfound)
    if step.frame.missing:
        names = ", ".join(step.scene.rig.names[v] for v in step.frame.missing)
        log.warning("frame %d: without an image of %s", step.frame.index, names)


# Delays and turns of the views that the persons show: before the run itself begins, or at its end.

_LONGEST = 500
"""Frames kept for a comparison of the views at the end: a long recording is not decoded again for it."""


_COVERED = 0.5
"""Share of a run's frames that the comparison must span, so that views may be called in step."""


def compared_views(steps: Sequence[Step], scene: Scene, interval_s: float, progress: Progress) -> ViewAlignment | None:
    """Delays and turns of the views; None if the persons do not show them.

    Args:
        steps: frames that were tracked, with their images.
        scene: the persons with the bodies that they were tracked with.
        interval_s: from one frame to the next, seconds.
        progress: told that all is in order; the caller reports other findings.
    """
    frames = [Tracked(step.frame.index, step.frame.time_s, step.estimates) for step in steps]
    return _compared(frames, (step.frame for step in steps), scene, interval_s, progress)


def compared_by_known(
    known: Mapping[int, Sequence[Estimate]], frames: Iterable[Frame], scene: Scene, interval_s: float
) -> ViewAlignment | None:
    """As `compared_views`, for frames whose poses an interrupted run has kept.

    Args:
        known: frame -> the poses of all persons.
        frames: of the recording, from the first one on.
        scene: the persons with the bodies that they were tracked with.
        interval_s: from one frame to the next, seconds.
    """
    until = takewhile(lambda frame: frame.index <= max(known), frames)
    seen = [frame for frame in until if frame.index in known]
    tracked = [Tracked(frame.index, frame.time_s, tuple(known[frame.index])) for frame in seen]
    return _compared(tracked, seen, scene, interval_s, silent)


class Tracks:
    """The poses of a run's first frames, for the same comparison at its end."""

    def __init__(self) -> None:
        self._frames: list[Tracked] = []

    def kept(self, steps: Iterable[Step]) -> Iterator[Step]:
        """The frames of a run as they come."""
        for step in steps:
            if len(self._frames) < _LONGEST:
                self._frames.append(Tracked(step.frame.index, step.frame.time_s, step.estimates))
            yield step

    def told(self, scene: Scene, sequence: ReadSequence, progress: Progress) -> tuple[str, ...]:
        """Result of `compared_views`.

        Args:
            scene: the persons as they were tracked.
            sequence: the recording, whose fastest frames are read again.
            progress: as of `compared_views`.
        """
        found = _compared(self._frames, sequence.frames(), scene, sequence.interval_s, progress)
        return () if found is None else found.findings()


def _compared(
    frames: Sequence[Tracked], images: Iterable[Frame], scene: Scene, interval_s: float, progress: Progress
) -> ViewAlignment | None:
    moments = moments_of(scene, frames, chosen_moments(scene, frames), images)
    found = align(moments, interval_s)
    if found is not None and not found.findings():
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
    return found


# The smooth result of a tracking job, beside the raw one.

_SHOWN = "report", "overlay"


def check_smoothing(smoothing: Smoothing, interval_s: float, recordings: Iterable[Recording]) -> None:
    """Fails before the first frame if smoothing would fail after the last one.

    Args:
        smoothing: as configured.
        interval_s: from one frame to the next, seconds.
        recordings: as configured; smoothing needs some of them.

    Raises:
        ConfigError: the raw result lacks a recording that smoothing needs, or see
            `tracker.results.smoothing.Smoothing.check`.
    """
    smoothing.check(interval_s)
    uses = {component_name(type(recording)) for recording in recordings}
    if missing := {"journal", "run_json"} - uses:
        raise ConfigError(f"smoothing needs the recordings journal and run_json; add {', '.join(sorted(missing))}")


def smoothed(outcome: TrackOutcome, smoothing: Smoothing, pictures: Pictures) -> TrackOutcome:
    """The outcome with the smoothed result beside the raw one; it replaces that of an interrupted run.

    It has a report and an overlay if the raw one has, except after an interruption, because nobody waits for them. A
    run that was interrupted in its first window has none yet: a window is kept when it has been tracked back.
    """
    shutil.rmtree(outcome.folder / FOLDER, ignore_errors=True)
    if outcome.interrupted and not (outcome.folder / JOURNAL).stat().st_size:
        log.warning("not smoothed: no frame is kept before its window has been tracked back")
        return outcome
    shown = [one for one in pictures.recordings if component_name(type(one)) in _SHOWN]
    drawn = None if outcome.interrupted or not shown else replace(pictures, recordings=tuple(shown))
    folder = write_smoothed(load_result(outcome.folder), smoothing, pictures=drawn)
    return replace(outcome, files=(*outcome.files, folder))
