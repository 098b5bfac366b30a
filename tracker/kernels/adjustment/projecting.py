"""Where a camera shows a point, and how that changes with camera and point: what a bundle adjustment linearizes."""

from __future__ import annotations

import tracker._native as native
from tracker.foundation.arrays import Array


def project_with_slopes(
    camera: Array, point: Array, velocity: Array, by_camera: Array, by_point: Array
) -> tuple[float, float, bool]:
    """Image of a point with its derivatives; the twin is `Camera.project`.

    Args:
        camera: (26,) state, see `tracker.kernels.rows.bundle_camera`.
        point: (3,) world position, metres.
        velocity: (2,) velocity of the image, px per frame; the time offset shifts along it.
        by_camera: (2, 17) output; rotations act after the camera's own, positions are the centre's.
        by_point: (2, 3) output.

    Returns:
        Pixel u, v, and whether the point lies before the camera; if it does not, the slopes are 0.
    """
    return native.project_with_slopes(camera, point, velocity, by_camera, by_point)
