"""One video file, decoded forwards."""

from __future__ import annotations

import itertools
import threading
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import av
import numpy as np
from av.container import InputContainer
from av.video.reformatter import VideoReformatter

from tracker.foundation.arrays import Image
from tracker.foundation.errors import SequenceError
from tracker.images.film import film_of, has_clock, hinted_fps, opened, told_of_pictures
from tracker.images.reading._footage import ImageStream
from tracker.images.reading._timeline import Timeline, timeline_of

FAULTS = (av.FFmpegError, ValueError, OverflowError, MemoryError, EOFError)
"""What PyAV raises of damaged files."""


class VideoView(ImageStream):
    """Decodes one file forwards; reading an earlier frame than the last one is not possible.

    Frames that cannot be decoded are missing, and so are those up to the next key frame, which depend on them. Images
    are turned as the file's metadata tell, as players and calibrating programs do.
    """

    def __init__(self, path: Path, timeline: Timeline) -> None:
        self._path, self._timeline = path, timeline
        self._frames = _decoded(path, timeline.film, timeline.timed)
        self._convert = Converter()
        self._stamp, self._image = -(2**63), None  # type: tuple[int, av.VideoFrame | None]

    def read(self, index: int) -> Image | None:
        """Image of a frame, None past the end, and where the file has dropped it.

        Raises:
            SequenceError: it cannot be decoded.
        """
        found = self.held(index)
        return None if found is None else found.image()

    def held(self, index: int) -> Decoded | None:
        """The same as it is decoded: luma, and chroma of every fourth pixel, as most codecs have it.

        Raises:
            SequenceError: it cannot be decoded.
        """
        stamp = self._timeline.stamps[index] if index < len(self._timeline) else None
        if stamp is None:
            return None
        while self._stamp < stamp:
            try:
                self._stamp, self._image = next(self._frames)
            except StopIteration:
                self._stamp, self._image = 2**63, None
        if self._stamp > stamp or self._image is None:
            raise SequenceError(
                f"{self._path}: frame {index} cannot be decoded: the file is corrupt; "
                'set on_missing = "skip" to go on without it'
            )
        return Decoded(self._image, self._convert, self._path)


@dataclass(frozen=True)
class Decoded:
    """A frame of a file, not converted yet."""

    frame: av.VideoFrame
    convert: Converter
    path: Path

    @property
    def shape(self) -> tuple[int, int, int]:
        """(h, w, 3) of the image."""
        size = self.frame.height, self.frame.width
        return (*(size if self.frame.rotation % 180 == 0 else size[::-1]), 3)

    def image(self) -> Image:
        """BGR (h, w, 3), turned as the metadata tell.

        Raises:
            SequenceError: it is to be turned by something else than quarters.
        """
        return self.convert.upright(self.frame, self.path)


class Converter:
    """Makes images of decoded frames, one at a time.

    A frame that converts itself makes the tables of the conversion anew: 0.4 ms of 2 for a view of 720x576.
    """

    def __init__(self) -> None:
        self._tables, self._lock = VideoReformatter(), threading.Lock()

    def upright(self, frame: av.VideoFrame, path: Path) -> Image:
        """BGR (h, w, 3), turned as the metadata tell (counter-clockwise degrees)."""
        with self._lock:
            image: Image = self._tables.reformat(frame, format="bgr24").to_ndarray().astype(np.uint8, copy=False)
        quarters, rest = divmod(frame.rotation, 90)
        if rest:
            raise SequenceError(
                f"{path}: is to be shown turned by {frame.rotation} degrees, expected quarters of a turn"
            )
        return image if quarters % 4 == 0 else np.ascontiguousarray(np.rot90(image, quarters))


def _decoded(path: Path, film: int, timed: bool) -> Iterator[tuple[int, av.VideoFrame]]:
    """Time stamps, or numbers where there are none, and images; without those that are damaged."""
    with opened(path) as container:
        stream, number, whole = container.streams.video[film], 0, True
        packets = container.demux(stream)
        while True:
            try:
                packet = next(packets)
                frames = packet.decode()
            except StopIteration:
                return
            except FAULTS:
                whole, number = False, number + 1
                if number > _MOST_FAULTS:
                    return
                continue
            for frame in frames:
                whole = not frame.is_corrupt and (whole or bool(frame.key_frame))
                stamp = frame.pts if timed else number
                number += 1
                if whole and stamp is not None:
                    yield stamp, frame


_MOST_FAULTS = 10**7
"""A demuxer that fails for ever is left: no recording has so many frames."""


def timeline(path: Path, name: str, whole: bool, size: tuple[int, int] | None = None) -> Timeline:
    """The frames of a file; its packets are read, for headers may lie.

    Args:
        path: the file.
        name: of the view, for messages.
        whole: whether nothing may be missing.
        size: width and height of its images as calibrated, px, by which one of several films is chosen; None for none.

    Raises:
        SequenceError: no such file, not a video, or, where nothing may be missing, a truncated one.
    """
    if not path.is_file():
        raise SequenceError(f'view "{name}": no file {path}')
    try:
        with opened(path) as container:
            found = _timeline(container, *film_of(container, size), whole)
        with opened(path) as container:
            told = told_of_pictures(container, container.streams.video[found.film], found.fps)
            return replace(found, told=(*found.told, *told))
    except SequenceError as error:
        raise SequenceError(f'view "{name}": {path} {error}') from error
    except FAULTS as error:
        told_fault = getattr(error, "strerror", None) or type(error).__name__
        raise SequenceError(f'view "{name}": {path} is not a video that can be read: {told_fault}') from error


def _timeline(container: InputContainer, film: int, remark: str, whole: bool) -> Timeline:
    stream = container.streams.video[film]
    told_fps, n_told = float(stream.average_rate or stream.guessed_rate or 0), stream.frames
    # AVI keeps no time stamps, but places for frames, some of them empty
    clock, timed = has_clock(container), "avi" not in container.format.name
    packets = (packet for packet in container.demux(stream) if packet.size > 0)
    held = [(packet.pts if timed else packet.dts, packet.is_discard, packet.dts) for packet in packets]
    # what an edit list cuts off is still in the file, and counts in the header
    stamps = [stamp for stamp, cut_off, _ in held if not cut_off]
    last = held[-1][0] if held and not timed else None
    n_held = len(held) if last is None else max(len(held), last + 1)
    if not stamps:
        raise SequenceError("holds no frame")
    if whole and n_held < n_told:
        raise SequenceError(
            f"holds {n_held} of the {n_told} frames that its header tells: it is truncated; "
            'copy it anew, or set on_missing = "skip"'
        )
    told = (remark,) if remark else ()
    if not clock:
        numbers = tuple(range(len(stamps)))
        return Timeline(0.0, numbers, timed=False, film=film, clock=False, hint_fps=hinted_fps(stream), told=told)
    unit_s = float(stream.time_base or 0)
    _check_order([at for _, _, at in held if at is not None], unit_s)
    found = replace(timeline_of(stamps, unit_s, told_fps), film=film, told=told)
    return found if timed else found.numbered()


def _check_order(stamps: list[int], unit_s: float) -> None:
    """Refuses files whose decoding times run back: their images would be sorted into one another."""
    for before, after in itertools.pairwise(stamps):
        if after < before:
            raise SequenceError(
                f"has time stamps that run back, from {before * unit_s:.3f} to {after * unit_s:.3f} s: were files "
                "joined byte by byte? Join them anew with a program that makes one clock of theirs"
            )
