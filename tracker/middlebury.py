"""Cameras of the Middlebury multi-view stereo data sets (Seitz et al., CVPR 2006)."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from tracker.camera import Camera
from tracker.errors import CalibrationError


def read_middlebury(path: Path) -> list[Camera]:
    """Reads `NAME_par.txt`: a count, then a line `image K R t` for each view, row by row, metres.

    Cameras are called as their images, without the ending. The file does not tell the image size: it is taken from
    the images beside the file, and views whose images are not there are left out.

    Args:
        path: the file.

    Raises:
        CalibrationError: a line cannot be understood, or there is no image beside the file.
    """
    lines = path.read_text(encoding="utf-8").split("\n")
    cameras = [_camera(line, path.parent) for line in lines[1:] if line.strip()]
    present = [camera for camera in cameras if camera is not None]
    if not present:
        raise CalibrationError("none of the images it names lies beside it: their size is needed")
    return present


def _camera(line: str, folder: Path) -> Camera | None:
    image, *numbers = line.split()
    try:
        values = np.array(numbers, dtype=np.float64)
    except ValueError as error:
        raise CalibrationError(f"{image}: expected numbers, found {line!r}") from error
    if len(values) != 21:
        raise CalibrationError(f"{image}: {len(values)} numbers found, expected 21: K and R row by row, and t")
    if not (folder / image).is_file():
        return None
    picture = cv2.imread(str(folder / image), cv2.IMREAD_GRAYSCALE)
    if picture is None:
        raise CalibrationError(f"{folder / image}: not an image that can be read")
    motion = np.eye(4)
    motion[:3, :3], motion[:3, 3] = values[9:18].reshape(3, 3), values[18:]
    size = picture.shape[1], picture.shape[0]
    return Camera(Path(image).stem, size, values[:9].reshape(3, 3), np.zeros(5), motion)
