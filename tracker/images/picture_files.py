"""Pictures and films that are written: a file is there when it is whole."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path

import av
import cv2
from av.video.stream import VideoStream

from tracker.foundation.arrays import Image
from tracker.foundation.errors import ConfigError
from tracker.foundation.files import replacing, write_whole

_JPEG_QUALITY = 92
"""Of 100: text and thin lines stay sharp."""


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
    """A film, H.264 in MP4, that pictures are added to.

    Args:
        path: of the file.
        fps: pictures a second.
        options: of the encoder, for instance its `preset` and `crf`.

    Yields:
        What adds a picture (h, w, 3), BGR, as large as the first one.
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
