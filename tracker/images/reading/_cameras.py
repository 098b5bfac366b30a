"""Cameras that film now: each read in a thread of its own, which keeps the newest images and drops the others."""

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
"""Newest images of a camera: those of one moment are found among them though cameras do not release together."""

_STRIDE_S = 0.2
"""Longest time from a frame to the next one while there are images between them. A start takes seconds: who has walked
on meanwhile was lost in the newest image, looked for anew, and so on: 7 of 469 frames were tracked in 19 s, and 59 so
(docs/cameras.md)."""

_BEHIND = 40
"""Older images of a camera, so far apart, that are kept, with the one before each: a run is eight seconds behind."""

_SILENT_S = 5.0
"""Time without an image after which a camera counts as gone."""

_STREAM_OPTIONS = {"rtsp_transport": "tcp", "fflags": "nobuffer"}
"""Of streams: lost packets are sent again, and nothing waits in a queue (FFmpeg's protocols and formats)."""


@dataclass(frozen=True)
class Source:
    """Where a view's images come from."""

    view: str
    place: int | str | Path
    """Number of a camera of this machine, address of a stream, or a film that is played at its own rate."""

    def images(self) -> Iterator[tuple[float | None, Image | Packed]]:
        """When each image is due, seconds from the first one, None for now; and the image.

        Raises:
            SequenceError: it cannot be opened, or ends where it should not.
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
    """Of the clock."""

    number: int
    """Of the image among all of its camera, from 1 on."""

    image: Image | Packed


class Camera(threading.Thread):
    """One view's newest images; whoever is slower than the camera misses some."""

    def __init__(self, source: Source, arrived: threading.Condition, together: threading.Barrier) -> None:
        """Not running yet.

        Args:
            source: of the images.
            arrived: notified of each image, and of the end.
            together: where cameras wait for each other before the first image.
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
        """Reads until it is stopped, or there is no more."""
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
                # a film tells of which moment an image is, even where this machine is too slow to play it
                self.newest.append(Arrived(time.monotonic() if due_s is None else begin_s + due_s, number, image))
                self._arrived.notify_all()

    def _keep(self, image: Arrived) -> None:
        """Keeps the first image of each `_STRIDE_S` of the clock, and the last one of the stretch before.

        One of them is of the moment of another camera's first one, whose clock runs a little otherwise.
        """
        if self._left is None or image.time_s // _STRIDE_S > self._left.time_s // _STRIDE_S:
            self.beside.extend([] if self._left is None else [self._left])
            self.earlier.append(image)
        self._left = image

    def after(self, time_s: float) -> list[Arrived]:
        """The images that a run may go on to from a time, in order."""
        return [one for one in (*self.earlier, *self.newest) if one.time_s > time_s]

    def nearest(self, moment_s: float, after_s: float) -> Arrived:
        """The image nearest to a moment of those that are kept of later than a time."""
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
    """Of the clock."""

    images: tuple[Image | Packed, ...]
    apart_s: float
    """From the first of them to the last."""

    n_before: int
    """Images that every view has had up to these, these included."""


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
        """The newest images of all views that were not taken yet, or those a step on towards them; None at films' end.

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
        """Whether images were taken before."""
        return min(self._taken) > float("-inf")

    @staticmethod
    def _is_new(camera: Camera, taken_s: float) -> bool:
        return bool(camera.newest) and camera.newest[-1].time_s > taken_s

    def _of_one_moment(self) -> Moment:
        """Of each view the image that arrived nearest to the newest one of the view that is last.

        Where that is more than a step on from those taken last, nearest to an image of this view a step on.
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
