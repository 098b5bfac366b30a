"""Projection of a point by a camera, and distortion by its lens."""

from __future__ import annotations

import tracker._native as native
from tracker.foundation.arrays import Array

# The lens: from the plane z = 1 of a camera to what its distortion makes of it.
#
# Radial distortion is a quotient of polynomials, decentring is Brown's, as in OpenCV's model of eight numbers:
# x (1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + k5 r^4 + k6 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2), and so for y with p1
# and p2 exchanged. Lenses of few millimetres need the denominator; with k4 = k5 = k6 = 0 it divides by 1, exactly.


def undistort(camera: Array, x: float, y: float) -> tuple[float, float]:
    """Coordinates of a pixel in the plane z = 1; the twin is `Lens.undistort_clamped`.

    What is next to where the lens turns back may be imaged beyond, where its slopes lead away: then steps begin at what
    the radial distortion alone images there. A contour lies up to a pixel beside what is seen: if the lens images
    nothing there, it is at the end of its reach.

    Args:
        camera: (29,) row of `Rig.packed`.
        x, y: the pixel.
    """
    return native.undistort(camera, x, y)


# Projection of single points, shared by the compiled kernels.


def project_point(camera: Array, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Image of a world point; the twin is `Camera.project`.

    Args:
        camera: (29,) row of `Rig.packed`.
        x, y, z: world position, metres.

    Returns:
        Pixel u, v and the depth in metres, 0 beyond the reach of the lens (pixel 0, 0 when it is not positive).
    """
    return native.project_point(camera, x, y, z)
