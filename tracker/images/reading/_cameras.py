"""Live cameras: each is read in its own thread, which keeps the newest images and drops the others."""

from __future__ import annotations

import contextlib
import threading
import time
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import av
import cv2
import numpy as np

from tracker.cameras.frame import Packed
from tracker.foundation.arrays import Image
from tracker.foundation.errors import SequenceError
from tracker.images.film import film_of, opened
from tracker.images.reading._video_view import FAULTS, Converter, Decoded

_KEPT = 8
"""Newest images of a camera: those of one moment are among them though cameras do not release together."""

_STRIDE_S = 0.2
"""Longest time from a frame to the next one while there are images between them. A start takes seconds: a person who
had walked on meanwhile was lost in the newest image, searched anew, and so on: 7 of 469 frames were tracked in 19 s,
with these steps 59 (docs/cameras.md)."""

_BEHIND = 40
"""Older kept images of a camera, this far apart, with the one before each: a run is up to eight seconds behind."""

_SILENT_S = 5.0
"""Time without an image after which a camera is gone."""

_STREAM_OPTIONS = {"rtsp_transport": "tcp", "fflags": "nobuffer"}
"""Of streams: lost packets are sent again, and nothing waits in a queue (FFmpeg's protocols and formats)."""


@dataclass(frozen=True)
class Source:
    """Source of a view's images."""

    view: str
    place: int | str | Path
    """Number of a camera of this machine, address of a stream, or a film that is played at its own rate."""

    def images(self) -> Iterator[tuple[float | None, Image | Packed]]:
        """Time at which each image is due, seconds from the first one, None for now; and the image.

        Raises:
            SequenceError: it cannot be opened, or ends too early.
        """
        if isinstance(self.place, int):
            yield from _of_a_device(self.place, self.view)
        elif isinstance(self.place, Path):
            yield from _of_a_film(self.place, self.view)
        else:
            yield from _of_a_stream(self.place, self.view)


def _of_a_device(number: int, view: str) -> Iterator[tuple[None, Image]]:
    device = cv2.VideoCapture(number)
    try:
        if not device.isOpened():
            raise SequenceError(f'view "{view}": no camera number {number} on this machine, or it is in use')
        device.set(cv2.CAP_PROP_BUFFERSIZE, 1)
        while True:
            there, image = device.read()
            if not there:
                raise SequenceError(f'view "{view}": camera {number} gives no images any more')
            yield None, np.asarray(image, dtype=np.uint8)
    finally:
        device.release()


def _of_a_stream(address: str, view: str) -> Iterator[tuple[None, Packed]]:
    try:
        with av.open(address, options=_STREAM_OPTIONS, timeout=_SILENT_S) as container:
            convert = Converter()
            for frame in container.decode(video=0):
                yield None, Decoded(frame, convert, Path(address))
    except FAULTS as error:
        raise SequenceError(f'view "{view}": {address}: no stream that can be read: {error}') from error
    raise SequenceError(f'view "{view}": {address}: the stream has ended')


def _of_a_film(path: Path, view: str) -> Iterator[tuple[float, Packed]]:
    if not path.is_file():
        raise SequenceError(f'view "{view}": no file {path}')
    first_s: float | None = None
    try:
        with opened(path) as container:
            convert = Converter()
            for frame in container.decode(container.streams.video[film_of(container)[0]]):
                first_s = float(frame.time or 0) if first_s is None else first_s
                yield float(frame.time or 0) - first_s, Decoded(frame, convert, path)
    except FAULTS as error:
        raise SequenceError(f'view "{view}": {path}: no film that can be read: {error}') from error


@dataclass(frozen=True)
class Arrived:
    """An image of a camera."""

    time_s: float
    """Time of the clock."""

    number: int
    """Number of the image among all of its camera, from 1 on."""

    image: Image | Packed


class Camera(threading.Thread):
    """One view's newest images; a slow reader misses some."""

    def __init__(self, source: Source, arrived: threading.Condition, together: threading.Barrier) -> None:
        """Not running yet.

        Args:
            source: of the images.
            arrived: event for each image, and for the end.
            together: barrier for the cameras before the first image.
        """
        super().__init__(daemon=True, name=f"camera {source.view}")
        self.newest: deque[Arrived] = deque(maxlen=_KEPT)
        self.earlier: deque[Arrived] = deque(maxlen=_BEHIND)
        self.beside: deque[Arrived] = deque(maxlen=_BEHIND)
        self._left: Arrived | None = None
        self.ended = False
        self.fault: SequenceError | None = None
        self._source, self._arrived, self._together = source, arrived, together
        self._stopped = threading.Event()

    def run(self) -> None:
        """Reads until it is stopped, or the source ends."""
        try:
            self._read()
        except SequenceError as error:
            self.fault = error
        finally:
            self._together.abort()
            with self._arrived:
                self.ended = True
                self._arrived.notify_all()

    def _read(self) -> None:
        begin_s: float | None = None
        for number, (due_s, image) in enumerate(self._source.images(), start=1):
            if begin_s is None:
                with contextlib.suppress(threading.BrokenBarrierError):  # another camera has none: it tells why
                    self._together.wait()
                begin_s = time.monotonic()
            if due_s is not None and self._stopped.wait(max(0.0, begin_s + due_s - time.monotonic())):
                return
            if self._stopped.is_set():
                return
            with self._arrived:
                if len(self.newest) == _KEPT:
                    self._keep(self.newest[0])
                # a film gives the moment of each image, even if this machine is too slow to play it
                self.newest.append(Arrived(time.monotonic() if due_s is None else begin_s + due_s, number, image))
                self._arrived.notify_all()

    def _keep(self, image: Arrived) -> None:
        """Keeps the first image of each `_STRIDE_S` of the clock, and the last one of the stretch before.

        One of them is of the moment of another camera's first one, although clocks differ a little.
        """
        if self._left is None or image.time_s // _STRIDE_S > self._left.time_s // _STRIDE_S:
            self.beside.extend([] if self._left is None else [self._left])
            self.earlier.append(image)
        self._left = image

    def after(self, time_s: float) -> list[Arrived]:
        """The images to which a run may go on from a time, in order."""
        return [one for one in (*self.earlier, *self.newest) if one.time_s > time_s]

    def nearest(self, moment_s: float, after_s: float) -> Arrived:
        """The kept image nearest to a moment, later than a time."""
        kept = (one for one in (*self.beside, *self.earlier, *self.newest) if one.time_s > after_s)
        return min(kept, key=lambda one: abs(one.time_s - moment_s))

    def stop(self) -> None:
        """Reads no more."""
        self._stopped.set()
        self._together.abort()


@dataclass(frozen=True)
class Moment:
    """Images of all views that arrived at about one time."""

    time_s: float
    """Time of the clock."""

    images: tuple[Image | Packed, ...]
    apart_s: float
    """Time from the first of them to the last."""

    n_before: int
    """Number of images of every view up to these, including them."""


class Cameras:
    """All views; used in a `with` block."""

    def __init__(self, sources: Sequence[Source]) -> None:
        """Nothing is opened yet."""
        self._arrived = threading.Condition()
        together = threading.Barrier(len(sources))
        self._cameras = [Camera(source, self._arrived, together) for source in sources]
        self._taken = [float("-inf")] * len(sources)

    def __enter__(self) -> Cameras:
        for camera in self._cameras:
            camera.start()
        return self

    def __exit__(self, *error: object) -> None:
        for camera in self._cameras:
            camera.stop()

    def newest(self) -> Moment | None:
        """The newest images of all views since the last call, or those one step on; None at films' end.

        Raises:
            SequenceError: a camera cannot be read, or is silent.
        """
        with self._arrived:
            if not self._arrived.wait_for(self._ready, _SILENT_S):
                silent = [
                    c.name for c, last in zip(self._cameras, self._taken, strict=True) if not self._is_new(c, last)
                ]
                raise SequenceError(f"{', '.join(silent)}: no image for {_SILENT_S:.0f} s; is it connected and on?")
            if (fault := next((camera.fault for camera in self._cameras if camera.fault), None)) is not None:
                raise fault
            if not all(map(self._is_new, self._cameras, self._taken)):
                return None
            return self._of_one_moment()

    def _ready(self) -> bool:
        fresh = list(map(self._is_new, self._cameras, self._taken))
        over = any(c.ended and (c.fault or not new) for c, new in zip(self._cameras, fresh, strict=True))
        return over or all(fresh)

    @property
    def _begun(self) -> bool:
        """Whether there was an earlier call."""
        return min(self._taken) > float("-inf")

    @staticmethod
    def _is_new(camera: Camera, taken_s: float) -> bool:
        return bool(camera.newest) and camera.newest[-1].time_s > taken_s

    def _of_one_moment(self) -> Moment:
        """For each view the image nearest in time to the newest one of the slowest view.

        If that is more than a step after the last one, the image of this view nearest to one step on.
        """
        fresh = [camera.after(taken_s) for camera, taken_s in zip(self._cameras, self._taken, strict=True)]
        last = min(fresh, key=lambda images: images[-1].time_s)
        moment_s = min(last[-1].time_s, max(self._taken) + _STRIDE_S) if self._begun else last[-1].time_s
        moment_s = min(last, key=lambda one: abs(one.time_s - moment_s)).time_s
        pairs = zip(self._cameras, self._taken, strict=True)
        chosen = [camera.nearest(moment_s, taken_s) for camera, taken_s in pairs]
        self._taken = [one.time_s for one in chosen]
        images = tuple(one.image for one in chosen)
        return Moment(moment_s, images, max(self._taken) - min(self._taken), min(one.number for one in chosen))
