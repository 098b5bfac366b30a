"""Cameras of the Middlebury multi-view stereo data sets (Seitz et al., CVPR 2006)."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

import cv2
import numpy as np

from tracker.cameras.camera import Camera
from tracker.cameras.rig import Rig
from tracker.cameras.rig_layouts import Listing
from tracker.cameras.rig_layouts._cameras import camera_of
from tracker.cameras.rig_layouts._sources import text_of
from tracker.foundation.configuration.components import component
from tracker.foundation.errors import CalibrationError


@component
class MiddleburyLayout:
    """`NAME_par.txt`: a count, then a line `image K R t` for each view, row by row, metres.

    Cameras are called as their images, without the ending. The file has no image size: it is that of the images beside
    the file, and views without images there are left out.
    """

    endings: ClassVar[tuple[str, ...]] = ("_par.txt",)
    shape: ClassVar[str] = "Middlebury's NAME_par.txt"
    terms: ClassVar[int] = 8

    def detects(self, path: Path) -> bool:
        """A file of that name."""
        return path.name.lower().endswith(self.endings) and path.is_file()

    def read(self, path: Path, size: tuple[int, int] | None) -> Listing:
        """Reads the lines."""
        cameras: list[Camera] = []
        left_out: dict[str, str] = {}
        for line in text_of(path).splitlines()[1:]:
            if not line.strip():
                continue
            image, values = _numbers(line)
            if (path.parent / image).is_file():
                cameras.append(_camera(path.parent / image, values))
            else:
                left_out[Path(image).stem] = "has no image beside the file, which its size is taken from"
        return Listing(tuple(cameras), left_out)

    def contents(self, rig: Rig) -> dict[str, bytes]:
        """Nothing: the layout holds neither image sizes nor distortion."""
        raise CalibrationError("Middlebury's files are read only: they hold neither image sizes nor distortion")


def _numbers(line: str) -> tuple[str, np.ndarray]:
    image, *words = line.split()
    try:
        values = np.array(words, dtype=np.float64)
    except ValueError as error:
        raise CalibrationError(f"{image}: expected numbers, found {line[:80]!r}") from error
    if len(values) != 21:
        raise CalibrationError(f"{image}: {len(values)} numbers found, expected 21: K and R row by row, and t")
    return image, values


def _camera(image: Path, values: np.ndarray) -> Camera:
    picture = cv2.imread(str(image), cv2.IMREAD_GRAYSCALE)
    if picture is None:
        raise CalibrationError(f"{image}: not an image that can be read")
    size = picture.shape[1], picture.shape[0]
    return camera_of(image.stem, size, (values[:9], np.zeros(5)), (values[9:18], values[18:]))
