"""Views without distortion that contain what a distorted camera sees."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass

import numpy as np

from tracker.cameras.camera import Camera
from tracker.foundation.arrays import Array, Integers

# What every GL 4.3 can draw.
_LARGEST_PX = 8192


@dataclass(frozen=True)
class Pinhole:
    """A pinhole view with the centre and axes of a camera, and where it shows the camera's pixels."""

    size: tuple[int, int]
    """Width and height, px."""

    intrinsics: tuple[float, float, float, float]
    """fx, fy, cx, cy, px; pixel centres at integers."""

    positions: Array
    """(H, W, 2) x, y in the pinhole view of each pixel of the camera, px."""

    @property
    def nearest(self) -> tuple[Integers, Integers]:
        """Rows and columns (H, W) of the pinhole view's pixels nearest to the camera's."""
        rounded = np.rint(self.positions).astype(np.int64)
        columns, rows = (np.clip(rounded[..., i], 0, self.size[i] - 1) for i in range(2))
        return rows, columns


_CACHE: OrderedDict[tuple[bytes, bytes, tuple[int, int], int], Pinhole] = OrderedDict()


def pinhole_of(camera: Camera, enlarged: int) -> Pinhole:
    """The pinhole view around a camera's image, `enlarged` times as fine; kept for the cameras last used.

    Less fine where it would be larger than what can be drawn: 120 degrees of a lens fill 9300 px at 1920.
    """
    key = camera.matrix.tobytes(), camera.distortion.tobytes(), camera.size, enlarged
    if key not in _CACHE:
        _CACHE[key] = _around(camera, enlarged)
        while len(_CACHE) > 16:
            _CACHE.popitem(last=False)
    return _CACHE[key]


def _around(camera: Camera, enlarged: int) -> Pinhole:
    width, height = camera.size
    columns, rows = np.meshgrid(np.arange(width, dtype=np.float64), np.arange(height, dtype=np.float64))
    pixels = np.stack([columns, rows], axis=-1)
    if camera.distortion.any() or camera.matrix[0, 1] != 0:
        plane, focal = camera.undistort(pixels), enlarged * np.diag(camera.matrix)[:2]
        spans = focal * (np.nanmax(plane, axis=(0, 1)) - np.nanmin(plane, axis=(0, 1)))
        focal *= min(1.0, (_LARGEST_PX - 4) / float(spans.max()))
        positions = plane * focal
        low = np.floor(np.nanmin(positions, axis=(0, 1))) - 1
        # what the lens images nothing to shows a corner beside all that it images
        positions = np.where(np.isfinite(positions), positions, low)
        extent = np.ceil(positions.max(axis=(0, 1)) - low) + 2
        shift = -low
    else:
        # a pixel becomes a square of pixels
        enlarged = max(min(enlarged, _LARGEST_PX // max(width, height)), 1)
        focal = enlarged * np.diag(camera.matrix)[:2]
        shift = (camera.matrix[:2, 2] + 0.5) * enlarged - 0.5
        positions = (pixels + 0.5) * enlarged - 0.5 - shift
        extent = np.array([enlarged * width, enlarged * height])
    size = np.minimum(extent, _LARGEST_PX).astype(np.int64).tolist()
    fx, fy, cx, cy = (float(value) for value in (*focal, *shift))
    return Pinhole((size[0], size[1]), (fx, fy, cx, cy), positions + shift)
