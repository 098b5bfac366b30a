"""The viewer of a run: chooses the frame, and shows its status."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tracker.bodies.scene import Person, Scene
from tracker.foundation.errors import TrackerError
from tracker.foundation.progress import Progress
from tracker.images.reading.live import counts_of
from tracker.results.result import Result
from tracker.running.programs import Run
from tracker.running.viewing.images import Pictures, images_of
from tracker.running.viewing.stage import BLUE, ORANGE, PALE, RED, Stage
from tracker.tracking.doubt import in_words
from tracker.tracking.doubts import Judged, worst_first
from tracker.tracking.estimate import Estimate
from tracker.tracking.trajectory import Replay, Step

_COLOURS = {"lost": RED, "doubtful": ORANGE, "filled": PALE}
"""Colours of a status in the strip; all others are blue."""

_STRIP_PX = 360, 10
"""Width of the strip, and height for a person."""

_NOTHING = "-"
_EVERY_S = 0.04
"""Pause between two readings of the visitor's input."""


@dataclass(frozen=True)
class Shown:
    """A frame that can be shown."""

    index: int
    time_s: float
    estimates: tuple[Estimate, ...]


class Viewer:
    """The stage with its controls; frames may come meanwhile.

    Callbacks of the browser only note a wish; the thread that calls `draw` does the drawing.
    """

    def __init__(self, server: Any, scene: Scene, interval_s: float, n_frames: int) -> None:
        self._server, self._scene, self._interval_s = server, scene, interval_s
        self.pictures = Pictures(scene.rig, n_frames)
        self._stage = Stage(server, scene)
        self._frames: list[Shown] = []
        self._drawn: tuple[int, bool] | None = None
        self._played = 0.0
        self._lock = threading.Lock()
        gui = server.gui
        self._slider = gui.add_slider("frame", 0, max(n_frames - 1, 1), 1, 0)
        self._strip = gui.add_image(_strip([], scene), label="status")
        self._playing = gui.add_checkbox("play", False)
        self._following = gui.add_checkbox("follow the newest", False, visible=False)
        self._worst = gui.add_dropdown("worst frames", (_NOTHING,))
        self._told = gui.add_markdown("")
        self._worst.on_update(lambda _: self._jump())

    @property
    def n_frames(self) -> int:
        """Number of frames so far."""
        return len(self._frames)

    @property
    def shown(self) -> int | None:
        """Number of the frame shown."""
        return None if self._drawn is None else self._frames[self._drawn[0]].index

    def show_result(self, replays: Sequence[Replay]) -> None:
        """Takes all frames of a finished run."""
        self._frames = [Shown(replay.index, replay.time_s, replay.estimates) for replay in replays]
        self.tell_doubts()

    def follow(self) -> None:
        """Shows the newest frame, until the visitor chooses otherwise."""
        self._following.visible = self._following.value = True

    def add(self, step: Step) -> None:
        """Takes a frame of a running run, with its images, and the bodies of the tracking."""
        self._scene = step.scene
        self._frames.append(Shown(step.frame.index, step.frame.time_s, step.estimates))
        self.pictures.add(step.frame)
        if self.n_frames > self._slider.max:
            self._slider.max = 2 * self.n_frames
        if self._following.value:
            self._slider.value = self.n_frames - 1

    def tell_doubts(self) -> None:
        """Fills the strip and the list of the worst frames."""
        judged = [
            [Judged(str(one.verdict), len(one.ambiguous), one.account.explained) for one in frame.estimates]
            for frame in self._frames
        ]
        worst = worst_first([frame.time_s for frame in self._frames], judged)
        self._worst.options = (_NOTHING, *(self._line(t, k) for t, k in worst))
        self._strip.image = _strip(self._frames, self._scene)

    def seek(self, position: int) -> None:
        """Shows the frame at a position, counted from 0."""
        self._following.value = False
        self._slider.value = position

    def draw(self) -> None:
        """Draws the chosen frame, if it changed or its images have come."""
        with self._lock:
            if not self._frames:
                return
            if self._playing.value and time.monotonic() - self._played >= self._interval_s:
                self._slider.value = (self._slider.value + 1) % self.n_frames
                self._played = time.monotonic()
            position = min(int(self._slider.value), self.n_frames - 1)
            frame = self._frames[position]
            images = self.pictures.of(frame.index)
            if self._drawn == (position, images is not None):
                return
            with self._server.atomic():
                self._stage.embody(self._scene.persons)
                self._stage.show(frame.estimates)
                self._stage.show_images(images or (None,) * len(self._scene.rig))
                self._told.content = self._text(frame)
            self._drawn = position, images is not None

    def serve(self, seconds: float = float("inf")) -> None:
        """Draws for this time, seconds."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.draw()
            time.sleep(_EVERY_S)

    def _jump(self) -> None:
        """Goes to the frame of the chosen line; lines begin with their time."""
        if self._worst.value != _NOTHING:
            time_s = float(self._worst.value.split(" ")[0])
            times = np.array([frame.time_s for frame in self._frames])
            self.seek(int(np.abs(times - time_s).argmin()))

    def _line(self, t: int, k: int) -> str:
        frame, person = self._frames[t], self._scene.persons[k]
        estimate = frame.estimates[k]
        limbs = "".join(f", {limb.replace('_', ' ')}?" for limb in estimate.ambiguous if not estimate.lost)
        return f"{frame.time_s:.3f} s: {person.name} {estimate.verdict}{limbs}"

    def _text(self, frame: Shown) -> str:
        lines = [f"**{frame.time_s:.2f} s**, frame {frame.index}", ""]
        for person, estimate in zip(self._scene.persons, frame.estimates, strict=True):
            why = in_words(estimate.reasons)
            lines.append(f"- {person.name}: {estimate.verdict}" + (f"; {why}" if why else ""))
            lines += [] if estimate.lost else [f"  - {_sigmas(person, estimate)}"]
        if self.pictures.fault:
            lines += ["", f"no images: {self.pictures.fault}"]
        return "\n".join(lines)


def _sigmas(person: Person, estimate: Estimate) -> str:
    """Standard deviations of the joints: the median, and the worst joint."""
    body = person.body
    sigmas_mm = 1000 * body.landmark_sigmas(estimate.q, estimate.covariance)[list(body.reported)]
    if not np.isfinite(sigmas_mm).all():
        return "sigma of the joints: unknown"
    worst = body.landmark_names[body.reported[int(np.argmax(sigmas_mm))]].replace("_", " ")
    return f"sigma of the joints: {np.median(sigmas_mm):.0f} mm, of {worst} {sigmas_mm.max():.0f} mm"


def _strip(frames: Sequence[Shown], scene: Scene) -> NDArray[np.uint8]:
    """(P * height, width, 3) the statuses of all frames, a row a person, in colours."""
    width, height = _STRIP_PX
    rows = np.full((len(scene.persons), width, 3), 235, dtype=np.uint8)
    for k in range(len(scene.persons) if frames else 0):
        colours = np.array([_colour(frame.estimates[k]) for frame in frames], dtype=np.uint8)
        # a frame among many in doubt must be seen: the gravest of those in a column
        columns = np.arange(len(frames)) * width // len(frames)
        order = np.argsort([_GRAVE.index(tuple(colour)) for colour in colours.tolist()], kind="stable")[::-1]
        rows[k] = colours[np.minimum(np.arange(width) * len(frames) // width, len(frames) - 1)]
        rows[k, columns[order]] = colours[order]
    return np.repeat(rows, height, axis=0)


_GRAVE = [RED, ORANGE, PALE, BLUE]


def _colour(estimate: Estimate) -> tuple[int, int, int]:
    return _COLOURS.get(str(estimate.verdict), ORANGE if estimate.ambiguous else BLUE)


def view_result(result: Result, server: Any) -> tuple[Viewer, str]:
    """Shows a result, with its images if the recording is still there.

    Returns:
        The viewer, and why there are no images; empty if there are.
    """
    viewer = Viewer(server, result.scene, result.interval_s, len(result.replays))
    viewer.show_result(result.replays)
    try:
        viewer.pictures.read(images_of(result))
    except TrackerError as error:
        return viewer, str(error)
    return viewer, ""


_TOLD_EVERY = 25
"""Frames between two lists of the worst ones."""


class LiveRun:
    """A run in its own thread; it writes nothing."""

    def __init__(self, run: Run, server: Any, progress: Progress) -> None:
        """Begins to track.

        Args:
                    run: its inputs are opened here.
                    server: where it is shown.
            progress: told how far it is.

        Raises:
            TrackerError: an input cannot be used.
        """
        # of cameras that film now nobody knows how many frames will be tracked
        n_frames = 1 if counts_of(run.opened.sequence) else len(run)
        self.viewer = Viewer(server, run.scene, run.opened.sequence.interval_s, n_frames)
        self.viewer.follow()
        self._run, self._progress = run, progress
        self._stopped = threading.Event()
        self.fault: TrackerError | None = None
        self.done = threading.Event()
        self._thread = threading.Thread(target=self._track, daemon=True)
        self._thread.start()

    def _track(self) -> None:
        try:
            for n_done, step in enumerate(self._run, start=1):
                if self._stopped.is_set():
                    return
                self.viewer.add(step)
                self._progress("tracking", n_done, len(self._run))
                if n_done % _TOLD_EVERY == 0:
                    self.viewer.tell_doubts()
            self.viewer.tell_doubts()
        except TrackerError as error:
            self.fault = error
        finally:
            self.done.set()

    def close(self) -> None:
        """Ends with the present frame."""
        self._stopped.set()
        self._thread.join()
