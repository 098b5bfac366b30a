"""Synchronized video files, one a view, decoded frame by frame with PyAV."""

from __future__ import annotations

import contextlib
import logging
from pathlib import Path
from typing import Literal

import numpy as np
import pydantic

from tracker.foundation.arrays import Image
from tracker.foundation.configuration.components import PathPattern, ViewPaths, component
from tracker.foundation.errors import SequenceError
from tracker.images.reading._footage import (
    LEAST_FPS,
    MOST_FPS,
    AbsentView,
    Footage,
    ImageStream,
    OnMissing,
    chosen_names,
    chosen_rig,
    opened_views,
    view_paths,
)
from tracker.images.reading._opening import Settings, opened, opened_uncalibrated
from tracker.images.reading._sequence import OpenSequence, OpenViews
from tracker.images.reading._stamps import common_rate, paired_by_stamps, told_of_rates
from tracker.images.reading._timeline import Offsets, at_one_pace
from tracker.images.reading._video_view import VideoView, timeline

log = logging.getLogger("tracker")

# Frames of a background clip that its median is taken over.
_PLATE_FRAMES = 25


@component
class VideoReading(Settings):
    """One video a view; `{view}` in a path stands for the camera's name in the rig."""

    path: ViewPaths
    """Video files, for instance `videos/{view}.mp4`; or a table, one file a view: `{ left = "videos/GX01.mp4", ... }`.
    """

    offsets: Offsets = pydantic.Field(default_factory=dict)
    """Frame of a view's file that belongs to frame 0, if it is not 0; for a view of which every second frame is used,
    see `fps`, it counts the used ones. If a camera has dropped frames: pairs of a frame and the offset from it on, `{
    left = [[0, 3], [120, 2]] }`."""

    in_step: Literal["auto", "long", "off"] = "auto"
    """"auto": times that Caliscope or FreeMoCap wrote beside its videos pair their images; the run also measures the
    delay of each view by the movements in its first 100 frames, and corrects it by `offsets`. "long": it measures 1000
    frames, in which clocks of other rates show. "off": views are paired as they are, and poses stay as tracked.
    Otherwise the run also brings views that the person shows to be late by parts of a frame to the first view's
    moment."""

    masks: PathPattern | None = None
    """Your own silhouettes, in place of plates or beside them, for instance `masks/{view}/{frame}.png`, numbered from 0
    at the first image of the file; dropped ones have no number. Pixels that are neither black nor transparent are a
    person.
    """

    fps: float | None = pydantic.Field(default=None, ge=LEAST_FPS, le=MOST_FPS, allow_inf_nan=False)
    """Frames per second; default: those of the files. Streams without a container (`.h264`, `.mjpeg`) have none. If
    views film at different rates, the lowest one takes every second, third, ... frame of those of twice, three times
    ... as many."""

    on_missing: OnMissing = "error"
    """`skip` leaves a view out of the frames that it lacks or that cannot be decoded."""

    def open(self) -> OpenSequence:
        """Opens all views; see `tracker.images.reading.Reading.open`."""
        rig = chosen_rig(self.rig, self.views)
        return opened(self, self._footage(rig.names, {camera.name: camera.size for camera in rig.cameras}), rig)

    def open_uncalibrated(self) -> OpenViews:
        """Opens all views; see `tracker.images.reading.Reading.open_uncalibrated`."""
        return opened_uncalibrated(self, self._footage(chosen_names(self.views), {}))

    def _footage(self, names: tuple[str, ...], sizes: dict[str, tuple[int, int]]) -> Footage:
        paths = dict(zip(names, view_paths(self.path, names), strict=True))
        whole = self.on_missing == "error"
        found = opened_views(names, lambda name: timeline(paths[name], name, whole, sizes.get(name)), self.on_missing)
        paced = at_one_pace(found if self.in_step == "off" else paired_by_stamps(paths, found))
        rates = {name: one for name, one in zip(names, paced, strict=True) if one}
        fps, every = common_rate(rates, self.fps)
        timelines = [None if one is None else one.thinned(every[name]) for name, one in zip(names, paced, strict=True)]
        for name, one in rates.items():
            for remark in (one.remark, *one.told):
                if remark:
                    log.warning('view "%s": %s: %s', name, paths[name], remark)
        for word in told_of_rates({name: one.thinned(every[name]) for name, one in rates.items()}, fps, self.fps):
            log.warning("%s", word)

        def views() -> tuple[ImageStream, ...]:
            files = zip(paths.values(), timelines, strict=True)
            return tuple(VideoView(path, one) if one else AbsentView() for path, one in files)

        lengths, places = zip(*((len(one), one.positions) if one else (0, None) for one in timelines), strict=True)
        return Footage(names, fps, lengths, views, plate_of_clip, positions=places)


def open_clip(path: Path, name: str) -> tuple[int, float, VideoView]:
    """Number of frames, frames per second (0 where it has no clock) and decoder of one view's file.

    Args:
        path: the video.
        name: of the view, for messages.

    Raises:
        SequenceError: no such file, not a video, or a truncated one.
    """
    found = timeline(path, name, whole=True)
    return len(found), found.fps, VideoView(path, found)


def plate_of_clip(path: Path) -> Image:
    """Median (h, w, 3) over up to 25 frames spread over a clip.

    Raises:
        SequenceError: the clip cannot be read.
    """
    found = timeline(path, path.stem, whole=False)
    there = [index for index, stamp in enumerate(found.stamps) if stamp is not None]
    wanted = np.linspace(0, len(there) - 1, min(_PLATE_FRAMES, len(there))).round().astype(int)
    view, images = VideoView(path, found), []
    for k in np.unique(wanted).tolist():
        with contextlib.suppress(SequenceError):  # a median does without it
            images.append(view.read(there[k]))
    shown = [image for image in images if image is not None]
    if not shown:
        raise SequenceError(f"{path}: no frame of it can be decoded")
    plate: Image = np.median(np.stack(shown), axis=0).astype(np.uint8)
    return plate
