"""The frames of a tracking run given to its recorders, and what is left when it ends, is stopped or fails."""

from __future__ import annotations

import contextlib
import logging
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType

from tracker.foundation.errors import TrackerError
from tracker.foundation.files import remove_unfinished
from tracker.foundation.progress import Progress, in_words
from tracker.results.recording import Recorder, Recording, RunContext
from tracker.running.jobs import ResultFolder
from tracker.running.jobs._stopping import Stop, stopping
from tracker.tracking.doubts import Doubts
from tracker.tracking.trajectory import Step

log = logging.getLogger("tracker")


@dataclass(frozen=True)
class TrackOutcome:
    """What a tracking job left."""

    folder: Path
    n_frames: int
    doubts: Doubts
    """Where to look before the result is used."""

    interrupted: bool = False
    files: tuple[Path, ...] = ()
    """What the recordings have left in the folder."""

    seconds: float = 0.0
    """How long the run took, with the start looked for, bodies fitted and the result smoothed."""

    stages_s: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    """How long the stages of tracking took in all frames, seconds."""


def recorded(
    recordings: Iterable[Recording],
    context: RunContext,
    steps: Iterable[Step],
    folder: ResultFolder,
    running: tuple[Progress, Stop],
    conclude: Callable[[], None],
) -> TrackOutcome:
    """Feeds every recorder; they are finished whatever happens, once there is more than was there before.

    Args:
        recordings: what to write.
        context: the run.
        steps: its frames, in order.
        folder: where results go; it is kept from the first frame on.
        running: told how far it is, and asked whether to stop.
        conclude: called after the last frame, before the recorders finish; not of an interrupted run.
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
                finishing.pop_all()  # what the interrupted run has left is more
    stages_s = MappingProxyType(pace.in_all)
    return TrackOutcome(context.folder, n_frames, doubts, interrupted, tuple(files), stages_s=stages_s)


@contextlib.contextmanager
def _tidied(folder: Path) -> Iterator[None]:
    """Removes what recorders began to write in place of other files and did not put there."""
    remove_unfinished(folder)
    try:
        yield
    finally:
        remove_unfinished(folder)


def _written(step: Step, recorders: Iterable[Recorder]) -> None:
    """Gives a frame to every recorder, its images unpacked once for all of them."""
    step = replace(step, frame=step.frame.unpacked())
    for recorder in recorders:
        recorder.write(step)


def _finish(recorder: Recorder, files: list[Path]) -> None:
    """Closes a recorder and puts its files before those of the recorders finished before it: the last ends first."""
    files[:0] = recorder.finish()


class _Pace:
    """Frames per second over the last second of a usual recording, and how long the other frames take at that pace."""

    def __init__(self, n_frames: int) -> None:
        self._recent: deque[float] = deque(maxlen=25)
        self._to_go = n_frames
        self.in_all = Counter[str]()
        """Seconds of each stage in all frames."""

    def after(self, step: Step, doubts: Doubts) -> str:
        """What is shown after a frame."""
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
