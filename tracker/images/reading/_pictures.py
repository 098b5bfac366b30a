"""Single pictures: read, checked against the calibrated size, made brighter, smaller or larger."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import cv2
import numpy as np
import pydantic
from pydantic_core import PydanticCustomError

from tracker.cameras.frame import Packed
from tracker.foundation.arrays import Image, Mask
from tracker.foundation.errors import CalibrationError, SequenceError

_JPEG_START, _PNG_START, _TIFF_STARTS = b"\xff\xd8", b"\x89PNG\r\n", (b"II*\0", b"MM\0*")
_JPEG_SCAN, _JPEG_END = 0xDA, 0xD9
"""Markers SOS and EOI (ITU-T T.81, table B.1)."""

_SAMPLE_FORMAT = 339
"""Tag of a TIFF."""

_LOSSY, _RINGING = {".jpg", ".jpeg", ".webp"}, 0.25
"""Files that ring around edges, and the share of the brightest up to which that can be: at qualities of 75 and more a
seventh. Silhouettes of what is not 0 were 5 % larger."""

_MOST_PIXELS = 2**28
"""268 million, 0.8 GB: four times the largest camera."""


_NEARLY = 0.05
"""Share by which images of another size than calibrated may be those of a copy with bars: 1080 of 1088 px are usual."""


def check_size(name: str, image: Image | Packed, expected: tuple[int, int], source: str = "") -> None:
    """Compares an image with the calibrated size.

    Args:
        name: of the view.
        image: one of its images, or what is compared with them.
        expected: width and height, px.
        source: what it is and its path where it is no image of the recording, for the message.

    Raises:
        CalibrationError: they differ.
    """
    height, width = image.shape[:2]
    if (width, height) != tuple(expected):
        mended = "take the calibration of these images"
        if source:
            mended = "it must be as large as the images are recorded"
        elif max(abs(width / expected[0] - 1), abs(height / expected[1] - 1)) < _NEARLY:
            mended += (
                ", or make these anew at that size: are there black bars at their borders? "
                "docs/from_other_programs.md has the command that takes them off"
            )
        if (height, width) == tuple(expected):
            mended = (
                "are the images turned upright? `bodytrack rig convert RIG rig.toml --upright` makes the rig of those"
            )
        who = f"{source} has" if source else "the images have"
        raise CalibrationError(
            f'view "{name}": {who} {width}x{height} px, the rig was calibrated at '
            f"{expected[0]}x{expected[1]} px: {mended}"
        )


_FACTORS: tuple[float, ...] = (0.5, *range(1, 17))
"""Of the widest images, 8K, 16 leave 480 px."""


def _factor(value: Any) -> float:
    if isinstance(value, bool) or value not in _FACTORS:
        raise PydanticCustomError("factor", "Input should be a whole number from 1 to 16, or 0.5")
    return _FACTORS[_FACTORS.index(value)]


Downscale = Annotated[int | float, pydantic.BeforeValidator(_factor)]
"""Pixels, in both directions, that are averaged; 0.5: images are enlarged twice."""


Lines = Literal["all", "odd", "even"]
"""Lines of an image that are used, counted from 1: those of one parity were taken at one time."""


def of_one_field(image: Image, lines: Lines) -> Image:
    """The image (h, w, 3) with its other lines made of those above and below, so that it is of one time."""
    if lines == "all" or len(image) < 2:
        return image
    kept = 0 if lines == "odd" else 1
    field, filled = image[kept::2], image.copy()
    # the line before the first and the one behind the last are as those beside them
    n = len(image[1 - kept :: 2])
    above, below = (np.clip(np.arange(n) + place, 0, len(field) - 1) for place in (-kept, 1 - kept))
    filled[1 - kept :: 2] = cv2.addWeighted(field[above], 0.5, field[below], 0.5, 0.0)
    return filled


def brightened(image: Image, gain: float) -> Image:
    """The image with its grey levels multiplied, 255 at most."""
    if gain == 1:
        return image
    brighter: Image = cv2.convertScaleAbs(image, alpha=gain)
    return brighter


def downscaled(image: Image, factor: float) -> Image:
    """The image averaged over `factor` x `factor` pixels, or enlarged twice, for 0.5."""
    if factor == 1:
        return image
    if factor < 1:
        enlarged: Image = cv2.resize(image, None, fx=1 / factor, fy=1 / factor, interpolation=cv2.INTER_CUBIC)
        return enlarged
    factor = int(factor)
    size = image.shape[1] // factor, image.shape[0] // factor
    cropped = image[: size[1] * factor, : size[0] * factor]
    smaller: Image = cv2.resize(cropped, size, interpolation=cv2.INTER_AREA)
    return smaller


def read_image(path: Path) -> Image | None:
    """A BGR image (h, w, 3), None if the file is none or is cut off.

    Raises:
        SequenceError: the image is whole, but of a kind that is not read.
    """
    return _decoded(path, cv2.IMREAD_COLOR)


def read_painted(path: Path) -> Mask | None:
    """What an image shows that is neither black nor transparent (h, w), whatever channels and bits it has.

    None and errors as of `read_image`.
    """
    end = path.suffix.lower()
    # OpenCV turns pictures as their EXIF data tell if it may change them; a JPEG has no alpha channel to lose
    picture = _decoded(path, cv2.IMREAD_COLOR if end in (".jpg", ".jpeg") else cv2.IMREAD_UNCHANGED)
    if picture is None:
        return None
    shown = picture if picture.ndim == 2 else picture[..., :3].max(axis=2)
    painted: Mask = shown > (_RINGING * float(shown.max(initial=0)) if end in _LOSSY else 0.0)
    if picture.ndim == 3 and picture.shape[2] == 4 and picture[..., 3].any():
        painted = painted & (picture[..., 3] > 0)
    return painted


def _decoded(path: Path, kind: int) -> Image | None:
    content = path.read_bytes()
    if not content or _cut_off(content):
        return None
    if fault := _unfit(content):
        raise SequenceError(f"{path}: {fault}")
    try:
        image: Image | None = cv2.imdecode(np.frombuffer(content, dtype=np.uint8), kind)
    except cv2.error:
        return None
    return image


def _cut_off(content: bytes) -> bool:
    """Whether a JPEG ends before its last marker: OpenCV fills it with grey without a word.

    What programs append behind that marker does not matter, and a preview within the header has one of its own.
    """
    if not content.startswith(_JPEG_START):
        return False
    place = 2
    while place + 4 <= len(content):
        mark = content[place + 1]
        if content[place] != 0xFF or mark == 0xFF:
            place += 1
        elif mark == _JPEG_END:
            return False
        elif 0xD0 <= mark <= 0xD7 or mark in (0x00, 0x01):
            place = _next_mark(content, place + 2)
        else:
            place += 2 + int.from_bytes(content[place + 2 : place + 4], "big")
            if mark == _JPEG_SCAN:
                place = _next_mark(content, place)
    return content[place : place + 2] != bytes((0xFF, _JPEG_END))


def _next_mark(content: bytes, place: int) -> int:
    found = content.find(b"\xff", place)
    return len(content) if found < 0 else found


def _unfit(content: bytes) -> str:
    """Why a whole image cannot be read; empty if it may be."""
    if content.startswith(_PNG_START) and len(content) >= 24:
        width, height = int.from_bytes(content[16:20], "big"), int.from_bytes(content[20:24], "big")
        if width * height > _MOST_PIXELS:
            return f"says to have {width}x{height} px, expected at most {_MOST_PIXELS / 1e6:.0f} million"
    if content.startswith(_TIFF_STARTS) and _tiff_floats(content):
        return "a TIFF of 32- or 64-bit numbers, expected 8 or 16 bits a channel: convert it, its range is not known"
    return ""


def _tiff_floats(content: bytes) -> bool:
    """Whether the first image of a TIFF has floating-point samples: tag 339, SampleFormat, is 3."""
    order: Literal["little", "big"] = "little" if content.startswith(b"II") else "big"
    begin = int.from_bytes(content[4:8], order)
    n_entries = int.from_bytes(content[begin : begin + 2], order)
    for k in range(n_entries):
        entry = content[begin + 2 + 12 * k : begin + 14 + 12 * k]
        if int.from_bytes(entry[:2], order) == _SAMPLE_FORMAT:
            count, value = int.from_bytes(entry[4:8], order), entry[8:10]
            if count > 2:  # the values lie elsewhere
                place = int.from_bytes(entry[8:12], order)
                value = content[place : place + 2]
            return int.from_bytes(value, order) == 3
    return False
