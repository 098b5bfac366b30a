"""Live cameras, of this machine or of a network; images that come during the work on a frame are dropped."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import pydantic

from tracker.cameras.frame import Frame, Packed, Pictures, Views
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Image
from tracker.foundation.configuration.components import (
    NO_PLATES,
    RECORDED,
    FilePath,
    PlatePattern,
    ViewPaths,
    component,
)
from tracker.foundation.errors import ConfigError, SequenceError, nearest
from tracker.images.operations.appearance import smoothed
from tracker.images.plate import Plate
from tracker.images.reading._cameras import Cameras, Moment, Source
from tracker.images.reading._footage import LEAST_FPS, MOST_FPS, chosen_rig, view_paths
from tracker.images.reading._pictures import Downscale, brightened, check_size, downscaled
from tracker.images.reading._plates import load_plates
from tracker.images.reading.video import plate_of_clip

log = logging.getLogger("tracker")


@component
class LiveReading:
    """Live cameras: frames that come during the work on one are dropped and counted, never queued."""

    live: ClassVar[bool] = True
    """Each frame comes only once: a job can use it only once."""

    cameras: dict[str, int | str] = pydantic.Field(default_factory=dict)
    """View -> number of a camera of this machine (0, 1, ...), or address of a stream: `{ left = 0, right =
    "rtsp://192.168.0.7/live" }`."""

    path: ViewPaths | None = None
    """In place of cameras, for a rehearsal: films played at their own rate, for instance `{view}.mp4`."""

    rig: FilePath | None = None
    """Calibration: a file or folder in any layout that `bodytrack rig convert` reads."""

    views: tuple[str, ...] = ()
    """Cameras to use, in this order; empty for all of the rig."""

    fps: float = pydantic.Field(default=25.0, ge=LEAST_FPS, le=MOST_FPS, allow_inf_nan=False)
    """Frame rate of the cameras, Hz: it numbers the frames. Their times are those of arrival."""

    seconds: float = pydantic.Field(default=3600.0, gt=0, allow_inf_nan=False)
    """The run ends after so many seconds; Ctrl-C ends it before."""

    background: PlatePattern | None = None
    """Clean plates: images or short clips, for instance `background/{view}.png`. None: no plates."""

    downscale: Downscale | None = None
    """Images are averaged over so many pixels in both directions; the rig follows. 0.5 enlarges them twice. Default:
    in tracking the factor that shows persons some 300 px high, else 1."""

    gain: float = pydantic.Field(default=1.0, gt=0, le=10)
    """Factor for the grey levels of images and plates."""

    smoothing_px: float = pydantic.Field(default=0.0, ge=0, le=5)
    """Standard deviation of the Gaussian that smooths images and plates, px of the delivered images."""

    def open(self) -> LiveSequence:
        """Opens all views, and reads an image of each; see `tracker.images.reading.Reading.open`."""
        rig = chosen_rig(self.rig, self.views)
        sources = self._sources(rig)
        for camera, source in zip(rig.cameras, sources, strict=True):
            check_size(camera.name, _first_image(source), camera.size)
        factor = self.downscale or 1

        def delivered(image: Image) -> Image:
            return smoothed(downscaled(brightened(image, self.gain), factor), self.smoothing_px)

        plates: tuple[Plate | None, ...] = (None,) * len(rig)
        if self.background == RECORDED:
            raise SequenceError(f'background = "{RECORDED}": live cameras have shown nothing yet; bring plates')
        if self.background not in (None, NO_PLATES):
            plates = load_plates(rig, self.background, delivered, plate_of_clip)
        as_filmed = factor == 1 and self.gain == 1 and self.smoothing_px == 0
        small = rig if factor == 1 else rig.downscaled(factor)
        return LiveSequence(small, self.fps, self.seconds, plates, sources, None if as_filmed else delivered)

    def open_uncalibrated(self) -> Views:
        """Refuses: a calibration needs a recording; see `tracker.images.reading.Reading.open_uncalibrated`."""
        raise ConfigError('[reading] use = "live": cameras are calibrated from a recording, expected use = "video"')

    def _sources(self, rig: Rig) -> tuple[Source, ...]:
        """Source of the images of each view.

        Raises:
            ConfigError: no cameras, or films as well; or a camera that the rig lacks, or has and the configuration does
                not.
        """
        if (self.path is None) == (not self.cameras):
            raise ConfigError("[reading] live: expected cameras = { VIEW = NUMBER or ADDRESS, ... }, or path for films")
        if self.path is not None:
            places: dict[str, int | str | Path] = dict(zip(rig.names, view_paths(self.path, rig.names), strict=True))
        else:
            places = {**self.cameras}
        for name in places:
            if name not in rig.names:
                raise ConfigError(f'[reading] cameras: no camera "{name}" in the rig; {nearest(name, rig.names)}')
        if missing := [name for name in rig.names if name not in places]:
            raise ConfigError(f"[reading] cameras: {', '.join(missing)} missing; `views` names the used ones")
        return tuple(Source(name, places[name]) for name in rig.names)


def _first_image(source: Source) -> Image | Packed:
    images = source.images()
    found = next(images, None)
    images.close()  # type: ignore[attr-defined]  # a generator, whose camera others are to open
    if found is None:
        raise SequenceError(f'view "{source.view}": {source.place}: shows no image')
    return found[1]


@dataclass
class LiveCounts:
    """Counts of the frames of live cameras so far."""

    tracked: int = 0
    dropped: int = 0
    seconds: float = 0.0
    """Time from the first frame to the last."""

    apart_ms: float = 0.0
    """Longest time between the images of one frame."""

    latency_s: float = 0.0
    """Mean time from the arrival of a frame's images to its poses."""

    latest_s: float = 0.0
    """The same for the last frame."""

    done_frames: int = 0
    """Number of frames with poses."""

    begin_s: float = 0.0
    """Time of the first frame's arrival, by the clock."""

    def done(self, time_s: float) -> None:
        """Counts a frame whose poses are ready; its time, seconds from the first one."""
        self.latest_s = time.monotonic() - self.begin_s - time_s
        self.done_frames += 1
        self.latency_s += (self.latest_s - self.latency_s) / self.done_frames

    def told(self) -> str:
        """One line."""
        apart = f"images of one frame are up to {self.apart_ms:.0f} ms apart"
        return (
            f"live: {self.tracked} frames in {self.seconds:.1f} s, {self.dropped} dropped that came meanwhile "
            f"({100 * self.dropped / max(self.tracked + self.dropped, 1):.0f} %); poses came {self.latency_s:.1f} s "
            f"after their images on average, the last ones {self.latest_s:.1f} s; {apart}"
        )


@dataclass(frozen=True)
class LiveSequence:
    """Opened cameras; see `tracker.images.reading.Sequence`. Each iteration delivers the frames of its own time."""

    live: ClassVar[bool] = True

    rig: Rig
    fps: float
    seconds: float
    plates: tuple[Plate | None, ...]
    sources: tuple[Source, ...]
    delivered: Callable[[Image], Image] | None
    """Makes the delivered image; None for an unchanged one."""

    counts: LiveCounts = field(default_factory=LiveCounts)
    """Counts of the last iteration."""

    @property
    def n_frames(self) -> int:
        """Largest number of frames, if none is dropped."""
        return max(1, round(self.seconds * self.fps))

    @property
    def interval_s(self) -> float:
        """Time from one frame of the cameras to the next, seconds."""
        return 1 / self.fps

    @property
    def known(self) -> tuple[Plate | None, ...]:
        """Background of persons in each view."""
        return self.plates

    @property
    def backdrops(self) -> tuple[Plate | None, ...]:
        """None: the most frequent colours are not known yet."""
        return (None,) * len(self.rig)

    @property
    def makes_plates(self) -> bool:
        """Never: nothing was shown yet."""
        return False

    def frames(self) -> Iterator[Frame]:
        """The newest images at each request, until the time is over; numbers leave out the dropped ones."""
        begin_s, last = None, -1
        with Cameras(self.sources) as cameras:
            while (moment := cameras.newest()) is not None:
                begin_s = self.counts.begin_s = moment.time_s if begin_s is None else begin_s
                time_s = moment.time_s - begin_s
                if time_s > self.seconds:
                    return
                last = max(last + 1, round(time_s * self.fps))
                self._count(time_s, moment)
                yield Frame(last, time_s, Pictures([self._made(image) for image in moment.images]))

    def _count(self, time_s: float, moment: Moment) -> None:
        counts = self.counts
        counts.tracked = 1 if time_s == 0 else counts.tracked + 1
        counts.dropped, counts.seconds = max(0, moment.n_before - counts.tracked), time_s
        counts.apart_ms = max(counts.apart_ms, 1000 * moment.apart_s)

    def _made(self, image: Image | Packed) -> Image | Packed:
        if self.delivered is None:
            return image
        return self.delivered(image.image() if isinstance(image, Packed) else image)


def counts_of(sequence: Any) -> LiveCounts | None:
    """Counts of the frames of live cameras; None for a recording."""
    return sequence.counts if isinstance(sequence, LiveSequence) else None
