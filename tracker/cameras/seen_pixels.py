"""Where a camera sees points, to the pixel."""

from __future__ import annotations

import numpy as np

from tracker.cameras.camera import Camera
from tracker.foundation.arrays import Array, Integers, Mask


def seen_pixels(camera: Camera, points: Array, spacing_px: int = 1) -> tuple[Integers, Mask]:
    """Nearest pixels (N, 2) of points, x and y, and which of the points (N,) the camera sees.

    Args:
        camera: it.
        points: (N, 3) in the world, metres.
        spacing_px: of the pixels counted, every second one for 2: those of `image[::spacing_px, ::spacing_px]`.
    """
    # near the plane of the lens the distortion runs away
    before = camera.in_camera(points)[:, 2] > 0.1
    pixels = np.full((len(points), 2), -1.0)
    pixels[before] = np.nan_to_num(camera.project(points[before]) / spacing_px, nan=-1.0)
    nearest = np.round(np.clip(pixels, -1.0, 1e6)).astype(np.int64)
    n_pixels = -(-np.array(camera.size) // spacing_px)
    seen: Mask = before & (nearest >= 0).all(axis=1) & (nearest < n_pixels).all(axis=1)
    return nearest, seen
