"""Forward ray intersection of many points, weighted by the precision of their images."""

from __future__ import annotations

import tracker._native as native
from tracker.foundation.arrays import Array


def intersect_rays(
    cameras: Array, pixels: Array, variances: Array, points: Array, covariances: Array, residuals: Array
) -> None:
    """Gauss-Newton on the weighted reprojection error of N points.

    Args:
        cameras: (V, 29) rows of `Rig.packed`.
        pixels: (V, N, 2) px, NaN where a view does not show the point.
        variances: (V, N, 3) of the pixels: xx, yy, xy, px^2.
        points: (N, 3) holds the starts, and the points after, metres; NaN where fewer than two views meet.
        covariances: (N, 3, 3) written, m^2.
        residuals: (N,) written: RMS of the reprojection over the coordinates, px.
    """
    native.intersect_rays(cameras, pixels, variances, points, covariances, residuals)
