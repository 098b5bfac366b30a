"""Single pictures: read, checked against the calibrated size, made smaller."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from tracker.arrays import Image
from tracker.errors import CalibrationError

_JPEG_START, _JPEG_END = b"\xff\xd8", b"\xff\xd9"


def check_size(name: str, image: Image, expected: tuple[int, int]) -> None:
    """Compares an image with the calibrated size.

    Raises:
        CalibrationError: they differ.
    """
    height, width = image.shape[:2]
    if (width, height) != tuple(expected):
        mended = "take the calibration of these images"
        if (height, width) == tuple(expected):
            mended = (
                "are the images turned upright? `bodytrack rig convert RIG rig.toml --upright` makes the rig of those"
            )
        raise CalibrationError(
            f'view "{name}": the images have {width}x{height} px, the rig was calibrated at '
            f"{expected[0]}x{expected[1]} px: {mended}"
        )


def downscaled(image: Image, factor: int) -> Image:
    """The image averaged over `factor` x `factor` pixels."""
    if factor == 1:
        return image
    size = image.shape[1] // factor, image.shape[0] // factor
    cropped = image[: size[1] * factor, : size[0] * factor]
    smaller: Image = cv2.resize(cropped, size, interpolation=cv2.INTER_AREA)
    return smaller


def read_image(path: Path) -> Image | None:
    """A BGR image (h, w, 3), None if the file is none or is cut off."""
    content = path.read_bytes()
    # OpenCV fills a cut-off JPEG with grey without a word
    cut_off = content.startswith(_JPEG_START) and _JPEG_END not in content[-1024:]
    if not content or cut_off:
        return None
    image: Image | None = cv2.imdecode(np.frombuffer(content, dtype=np.uint8), cv2.IMREAD_COLOR)
    return image
