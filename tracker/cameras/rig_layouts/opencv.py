"""OpenCV YAML, one file a camera."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

import numpy as np

from tracker.cameras.rig import Rig
from tracker.cameras.rig_layouts import Listing
from tracker.cameras.rig_layouts._cameras import Entry, listing_of
from tracker.cameras.rig_layouts._opencv_yaml import opened, written
from tracker.cameras.rig_layouts.easymocap import EasyMocapLayout
from tracker.foundation.configuration.components import component
from tracker.foundation.errors import CalibrationError

_LENS, _POSE = ("camera_matrix", "distortion_coefficients"), ("rotation", "translation")
_OTHER = {
    "camera_matrix": ("cameraMatrix", "K"),
    "distortion_coefficients": ("distCoeffs", "D"),
    "rotation": ("R", "rvec"),
    "translation": ("T", "tvec"),
}
"""Other names that programs built on OpenCV use: those of its functions' parameters."""


@component
class OpenCvLayout:
    """A folder of `CAMERA.yml`, as OpenCV's calibration samples write them, with rotation and translation added.

    Entries: image_width, image_height, camera_matrix, distortion_coefficients, rotation (matrix or Rodrigues vector)
    and translation, metres; also K, D, R (or rvec) and T (or tvec). A file without the last two is left out. With
    fisheye_model the coefficients are those of a fisheye lens.
    """

    endings: ClassVar[tuple[str, ...]] = ()
    shape: ClassVar[str] = "a folder with one OpenCV .yml a camera"
    terms: ClassVar[int] = 8

    def detects(self, path: Path) -> bool:
        """A folder with such files that is not EasyMocap's."""
        return path.is_dir() and bool(_files(path)) and not EasyMocapLayout().detects(path)

    def read(self, path: Path, size: tuple[int, int] | None) -> Listing:
        """Reads all the files, in the order of their names."""
        return listing_of(_entry(file, size) for file in _files(path))

    def contents(self, rig: Rig) -> dict[str, bytes]:
        """One file a camera, called after it."""
        unfit = [name for name in rig.names if name.startswith(".")]
        if unfit:
            raise CalibrationError(f'camera "{unfit[0]}": a name that no file can have')
        return {
            f"{camera.name}.yml": written(
                {
                    "image_width": camera.size[0],
                    "image_height": camera.size[1],
                    "camera_matrix": camera.matrix,
                    "distortion_coefficients": camera.told_distortion[:, None],
                    "rotation": camera.camera_from_world[:3, :3],
                    "translation": camera.camera_from_world[:3, 3:],
                }
            )
            for camera in rig.cameras
        }


def _files(folder: Path) -> list[Path]:
    return sorted(file for file in folder.iterdir() if file.suffix.lower() in (".yml", ".yaml") and file.is_file())


def _entry(path: Path, given: tuple[int, int] | None) -> Entry:
    file = opened(path)
    size = file.number("image_width"), file.number("image_height")
    if min(size) <= 0:
        if given is None:
            raise CalibrationError(f"{path.name}: no image_width and image_height: give the image size, --size WxH")
        size = given
    lens = {key: file.matrix(key, *_OTHER[key]) for key in _LENS}
    posed = any(file.has(key) for name in _POSE for key in (name, *_OTHER[name]))
    pose = {key: file.matrix(key, *_OTHER[key]) for key in _POSE} if posed else {}
    fisheye = {"fisheye": file.number("fisheye_model") > 0}  # as the sample program calls it
    table = {"size": np.array(size), **lens, **fisheye, **pose}
    return Entry(path.stem, table, *_LENS, *_POSE)
