"""Synchronized video files, one a view, decoded frame by frame with PyAV."""

from __future__ import annotations

from pathlib import Path

import av
import numpy as np
import pydantic

from tracker.arrays import Image
from tracker.components import FilePath, PathPattern, PlatePattern, component
from tracker.errors import SequenceError
from tracker.reading._selection import OnMissing, chosen_names, chosen_rig, view_paths
from tracker.reading._sequence import (
    AbsentView,
    Footage,
    ImageStream,
    OpenSequence,
    OpenViews,
    opened,
    opened_uncalibrated,
    opened_views,
)

# Frames of a background clip that its median is taken over.
_PLATE_FRAMES = 25


@component
class VideoReading:
    """One video a view; `{view}` in a path stands for the camera's name in the rig."""

    path: PathPattern
    """Video files, for instance `videos/{view}.mp4`."""

    rig: FilePath | None = None
    """Calibration: a file or folder in any layout that `bodytrack rig convert` reads; none in a calibration job."""

    views: tuple[str, ...] = ()
    """Cameras to use, in this order; empty for all of the rig."""

    offsets: dict[str, int] = pydantic.Field(default_factory=dict)
    """Frame of a view's file that belongs to frame 0, where it is not 0."""

    background: PlatePattern | None = None
    """Clean plates: images or short clips, for instance `background/{view}.png`; "median": what most images of the
    recording show, in views where everybody walks about."""

    masks: PathPattern | None = None
    """Silhouettes that you bring, in place of plates or beside them, for instance `masks/{view}/{frame}.png`, numbered
    from 0 at the first frame of the file; what is not 0 is a person."""

    align_background: bool = False
    """Fit each plate to the first frame by its features and its light: for plates taken before the camera was turned
    or zoomed a little, or the pictures were cut otherwise. The camera must not have been carried elsewhere."""

    fps: float | None = pydantic.Field(default=None, gt=0)
    """Frames per second; None takes the files' own."""

    start: int = pydantic.Field(default=0, ge=0)
    """First frame."""

    stop: int | None = pydantic.Field(default=None, ge=1)
    """Frame after the last one; None for all."""

    stride: int = pydantic.Field(default=1, ge=1)
    """Deliver every so many frames."""

    downscale: int = pydantic.Field(default=1, ge=1, le=16)
    """Images are averaged over so many pixels in both directions; the rig follows."""

    on_missing: OnMissing = "error"
    """`skip` leaves a view out of the frames that it lacks or that cannot be decoded."""

    def open(self) -> OpenSequence:
        """Opens all views; see `tracker.reading.Reading.open`."""
        rig = chosen_rig(self.rig, self.views)
        return opened(self, self._footage(rig.names), rig)

    def open_uncalibrated(self) -> OpenViews:
        """Opens all views; see `tracker.reading.Reading.open_uncalibrated`."""
        return opened_uncalibrated(self, self._footage(chosen_names(self.views)))

    def _footage(self, names: tuple[str, ...]) -> Footage:
        paths = dict(zip(names, view_paths(self.path, names), strict=True))
        headers = opened_views(names, lambda name: _header(paths[name], name, self.on_missing), self.on_missing)
        rates = [(name, header[1]) for name, header in zip(names, headers, strict=True) if header]

        def views() -> tuple[ImageStream, ...]:
            files = zip(paths.values(), headers, strict=True)
            return tuple(VideoView(path) if header else AbsentView() for path, header in files)

        lengths = tuple(header[0] if header else 0 for header in headers)
        return Footage(names, self.fps or _common_fps(rates), lengths, views, plate_of_clip)


class VideoView(ImageStream):
    """Decodes one file forwards; reading an earlier frame than the last one is not possible."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._container = av.open(str(path))
        stream = self._container.streams.video[0]
        # AVI keeps no time stamps
        timed = "avi" not in self._container.format.name
        self._rate = float(stream.average_rate or 0) if timed else 0.0
        self._decoder = self._container.decode(stream)
        self._frame: av.VideoFrame | None = None
        self._number = -1

    def read(self, index: int) -> Image | None:
        """Image `index` of the file, None past its end."""
        while self._number < index:
            if not self._advance():
                return None
        if self._number > index or self._frame is None:
            raise SequenceError(
                f"{self._path}: frame {index} is lost, the file goes on with frame {self._number}: it is corrupt; "
                'set on_missing = "skip" to go on without it'
            )
        image: Image = self._frame.to_ndarray(format="bgr24").astype(np.uint8, copy=False)
        return image

    def _advance(self) -> bool:
        """Decodes the next frame there is; its time stamp tells whether others before it were lost."""
        try:
            frame = next(self._decoder)
        except StopIteration:
            return False
        except av.FFmpegError as error:
            raise SequenceError(
                f"{self._path}: frame {self._number + 1} cannot be decoded ({error.strerror}): the file is corrupt; "
                'set on_missing = "skip" to go on without it'
            ) from error
        before = None if self._frame is None else self._frame.time
        steps = 1 if before is None or frame.time is None else round((frame.time - before) * self._rate)
        self._frame = frame
        self._number += max(1, steps)
        return True


def open_clip(path: Path, name: str) -> tuple[int, float, VideoView]:
    """Number of frames, frames per second and decoder of one view's file.

    Args:
        path: the video.
        name: of the view, for messages.

    Raises:
        SequenceError: no such file, not a video, or a truncated one.
    """
    n_frames, fps = _header(path, name, "error")
    return n_frames, fps, VideoView(path)


def _header(path: Path, name: str, on_missing: OnMissing) -> tuple[int, float]:
    """Number of frames and frames per second; the packets are counted, for headers may lie.

    Raises:
        SequenceError: no such file, not a video, or, where nothing may be missing, a truncated one.
    """
    if not path.is_file():
        raise SequenceError(f'view "{name}": no file {path}')
    try:
        with av.open(str(path)) as container:
            if not container.streams.video:
                raise SequenceError(f'view "{name}": {path} has no video stream')
            stream = container.streams.video[0]
            fps = float(stream.average_rate or stream.guessed_rate or 0)
            n_told = stream.frames
            n_frames = sum(packet.size > 0 for packet in container.demux(stream))
    except av.FFmpegError as error:
        raise SequenceError(f'view "{name}": {path} is not a video that can be read: {error.strerror}') from error
    if n_frames == 0:
        raise SequenceError(f'view "{name}": {path} holds no frame')
    if on_missing == "error" and n_frames < n_told:
        raise SequenceError(
            f'view "{name}": {path} holds {n_frames} of the {n_told} frames that its header tells: it is truncated; '
            'copy it anew, or set on_missing = "skip"'
        )
    return n_frames, fps


def _common_fps(rates: list[tuple[str, float]]) -> float:
    lowest, highest = min(rate for _, rate in rates), max(rate for _, rate in rates)
    if highest - lowest > 0.01 * highest:
        table = ", ".join(f"{name} {rate:.2f}" for name, rate in rates)
        raise SequenceError(f"the views have different frame rates ({table} fps): give fps, or convert the files")
    if highest <= 0:
        raise SequenceError("the videos do not tell their frame rate: give fps")
    return rates[0][1]


def plate_of_clip(path: Path) -> Image:
    """Median (h, w, 3) over up to 25 frames spread over a clip.

    Raises:
        SequenceError: the clip cannot be read.
    """
    n_frames, _ = _header(path, path.stem, "skip")
    wanted = set(np.linspace(0, n_frames - 1, min(_PLATE_FRAMES, n_frames)).round().astype(int).tolist())
    view = VideoView(path)
    images = [image for image in (view.read(index) for index in sorted(wanted)) if image is not None]
    plate: Image = np.median(np.stack(images), axis=0).astype(np.uint8)
    return plate
