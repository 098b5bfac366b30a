"""Information in a video file: its films, its clock, the kind of its pictures."""

from __future__ import annotations

import contextlib
import struct
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path
from typing import Any, cast

import av
import cv2
from av.container import InputContainer
from av.sidedata.sidedata import SideData, Type
from av.stream import Disposition
from av.video.stream import VideoStream

from tracker.foundation.arrays import Image
from tracker.foundation.errors import ConfigError, SequenceError
from tracker.foundation.files import replacing, write_whole

_JPEG_QUALITY = 92
"""JPEG quality, of 100: text and thin lines stay sharp."""


def write_picture(path: Path, picture: Image) -> None:
    """Writes a picture as the suffix says, PNG or JPEG.

    Args:
        path: of the file.
        picture: (h, w, 3) BGR, or (h, w).

    Raises:
        ConfigError: the kind of file is unknown or the folder is missing.
        OSError: it cannot be written.
    """
    suffix = path.suffix.lower()
    if suffix not in (".png", ".jpg", ".jpeg") or not path.parent.is_dir():
        raise ConfigError(f"{path}: expected a .png or .jpg in a folder that exists")
    quality = [] if suffix == ".png" else [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY]
    write_whole(path, cv2.imencode(suffix, picture, quality)[1].tobytes())


@contextmanager
def film_writer(path: Path, fps: float, **options: str) -> Iterator[Callable[[Image], None]]:
    """A film, H.264 in MP4, to which pictures are added.

    Args:
        path: of the file.
        fps: pictures a second.
        options: of the encoder, for instance its `preset` and `crf`.

    Yields:
        A function that adds a picture (h, w, 3), BGR, as large as the first one.
    """
    streams: list[VideoStream] = []
    with replacing(path) as unfinished, av.open(str(unfinished), "w", format="mp4") as container:

        def add(picture: Image) -> None:
            if not streams:
                stream = container.add_stream("libx264", rate=Fraction(fps).limit_denominator(1001), options=options)
                height, width = picture.shape[:2]
                # colours at half the resolution need even sides
                even = width % 2 == height % 2 == 0
                stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p" if even else "yuv444p"
                streams.append(stream)
            container.mux(streams[0].encode(av.VideoFrame.from_ndarray(picture, format="bgr24")))

        yield add
        for stream in streams:
            container.mux(stream.encode(None))


_NO_CLOCK = 0x0080
"""AVFMT_NOTIMESTAMPS of FFmpeg's avformat.h: a stream without a container, to which FFmpeg gives 25 frames a second."""

_NO_FILM = Disposition.attached_pic | Disposition.timed_thumbnails | Disposition.still_image
"""Covers and previews: FFmpeg counts them among the video streams."""

_HDR = {16: "PQ", 18: "HLG"}
"""Transfer characteristics of ITU-T H.273."""

_CAPTURED = "com.android.capture.fps"
"""Metadata of telephones: the filmed frame rate, which differs in slow motion."""

_OTHER_RATE = 1.1
"""Ratio of two rates without an explanation by clocks: slow motion has 2 and more, a rate that varies in the dark
1.05."""


_ANY_SIGNS: dict[str, Any] = {"metadata_errors": "replace"} if int(av.__version__.split(".")[0]) < 19 else {}
"""Metadata may be no UTF-8, which PyAV refuses before 19; from 19 on, it has no such setting, and takes all."""


def opened(path: Path) -> InputContainer:
    """A file to read, closed by `with`.

    Raises:
    Raises:
        av.FFmpegError: FFmpeg does not know the file.
    """
    container: InputContainer = av.open(str(path), **_ANY_SIGNS)
    return container


def films_of(container: InputContainer) -> list[VideoStream]:
    """The video streams of a file that are films: no covers, previews or unknown codecs, which have no size."""
    known = (stream for stream in container.streams.video if stream.codec_context is not None)
    return [stream for stream in known if not stream.disposition & _NO_FILM]


def film_of(container: InputContainer, size: tuple[int, int] | None = None) -> tuple[int, str]:
    """The video stream to read: the first one of the size, else the largest.

    Args:
        container: the file.
        size: width and height of the images, either way up; None if unknown.

    Returns:
        Its number among the file's video streams, and a message if there were others.

    Raises:
        SequenceError: there is none.
    """
    films = films_of(container)
    if not films:
        raise SequenceError(f"has {_instead_of_films(container)}")
    fitting = [film for film in films if size is not None and sorted((film.width, film.height)) == sorted(size)]
    # the first of the largest; max takes the first of equals
    chosen = fitting[0] if fitting else max(films, key=lambda film: film.width * film.height)
    number = next(k for k, stream in enumerate(container.streams.video) if stream.index == chosen.index)
    if len(films) == 1:
        return number, ""
    why = "the largest one" if not fitting else "the one of the calibrated size"
    if fitting[1:] or (not fitting and [chosen.width * chosen.height] * 2 == _areas(films)[:2]):
        why = "the first one of that size; copy another one to a file of its own, if that is meant"
    sizes = ", ".join(f"{film.width}x{film.height}" for film in films)
    return number, f"it holds {len(films)} films ({sizes} px): {chosen.width}x{chosen.height} is read, {why}"


def _instead_of_films(container: InputContainer) -> str:
    if any(stream.codec_context is None for stream in container.streams.video):
        return "a film of a codec that FFmpeg does not know"
    return "a cover picture, but no film" if container.streams.video else "no video stream"


def _areas(films: list[VideoStream]) -> list[int]:
    return sorted((film.width * film.height for film in films), reverse=True)


def has_clock(container: InputContainer) -> bool:
    """Whether the file has times of its images: streams without a container, and rows of pictures, have none."""
    name = container.format.name
    return not container.format.flags & _NO_CLOCK and not name.endswith("_pipe") and name != "image2"


def hinted_fps(film: VideoStream) -> float:
    """Frame rate in the coded pictures themselves (as H.264 may have, in its VUI); 0 without one."""
    return float(film.codec_context.framerate or 0)


def told_of_pictures(container: InputContainer, film: VideoStream, fps: float) -> Iterator[str]:
    """Properties in its metadata and its first image that nothing corrects, in some words each.

    Args:
        container: the file.
        film: the stream that is read.
        fps: frames a second by its time stamps; 0 for none.

    Raises:
        SequenceError: the images are to be shown otherwise than turned by quarters.
    """
    with contextlib.suppress(ValueError):
        captured = float(container.metadata.get(_CAPTURED, 0))
        if fps > 0 and captured > 0 and not 1 / _OTHER_RATE < captured / fps < _OTHER_RATE:
            yield (
                f"it was filmed at {captured:.5g} frames a second, as its metadata tell, and its time stamps tell "
                f"{fps:.5g}: slow motion; set fps to the rate that was filmed at"
            )
    ratio = film.sample_aspect_ratio
    if ratio and ratio != 1:
        yield (
            f"its pixels are shown {float(ratio):.4g} times as wide as high ({ratio.numerator}:{ratio.denominator}); "
            "they are read as stored, and so must the images be that it is calibrated by"
        )
    if (mode := film.metadata.get("stereo_mode", "mono")) != "mono":
        yield f"it is a stereo film ({ascii(mode)[1:-1]}): each image holds the pictures of two cameras"
    with contextlib.suppress(av.FFmpegError, StopIteration, ValueError):  # what cannot be decoded is said by a run
        yield from _told_of_image(next(container.decode(film)), "stereo_mode" in film.metadata)


def _told_of_image(image: av.VideoFrame, stereo_told: bool) -> Iterator[str]:
    kinds = cast("Mapping[Type, SideData]", image.side_data)  # by kind: PyAV 19 walks them otherwise than 18
    if Type.DISPLAYMATRIX in kinds:
        _check_shown(bytes(kinds[Type.DISPLAYMATRIX]))
    if image.interlaced_frame:
        yield (
            "it is interlaced: the even and the odd rows of an image are of two moments, half a frame apart; "
            'set reading.lines = "odd", for the calibration too, or deinterlace it (FFmpeg\'s bwdif)'
        )
    if int(image.color_trc or 0) in _HDR:
        yield (
            f"its colours are HDR ({_HDR[int(image.color_trc or 0)]}) and read as they are: a plate must come from a "
            "film of the same camera, for pictures that programs export are of other colours"
        )
    if Type.STEREO3D in kinds and not stereo_told:
        yield "it is a stereo film: each image may hold the pictures of two cameras"
    if Type.SPHERICAL in kinds:
        yield "it is a spherical film, which no pinhole camera's calibration describes: export a flat one"


def _check_shown(matrix: bytes) -> None:
    """Refuses mirrored films; turns are `VideoFrame.rotation`'s."""
    a, b, _, c, d = struct.unpack("=5i", matrix[:20])
    if a * d - b * c < 0:
        raise SequenceError(
            "is to be shown mirrored, as its display matrix tells, which programs read in different ways: write it "
            "anew without (`ffmpeg -display_rotation 0 -i IN -c copy OUT`), and calibrate from such films"
        )
