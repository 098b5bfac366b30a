"""Bundle adjustment and ray intersection, for `calibration` and for points."""

from __future__ import annotations

import tracker._native as native
from tracker.foundation.arrays import Array, Integers

# Normal equations of a bundle adjustment, reduced to the cameras object by object (Schur complement).
#
# An object is what moves as a whole between two exposures and has six unknowns of its own: the two ends of a reference
# bar, the pose of a board, or a single point. Its unknowns are eliminated as soon as its observations are summed up,
# so that only the cameras' equations are ever solved together.

N_OBJECT = 6
"""Unknowns of an object."""

Observed = tuple[Integers, Integers, Array, Array, Array]
"""N observations: their views (N,), points (N,), pixels (N, 2), image velocities (N, 2) px per frame, weights (N,)."""

Objects = tuple[Array, Array, Integers, Array, Array]
"""Points (P, 3), their slopes (P, 3, 6) by the unknowns of their object, the first observation of each object (G+1,),
and what is known of the objects beforehand: normal matrices (G, 6, 6) and right sides (G, 6)."""

Reduced = tuple[Array, Array, Array, Array, Array]
"""Outputs: normal matrix (17V, 17V) and right side (17V,), and for the way back to the objects their inverse
normal matrices (G, 6, 6), right sides (G, 6) and couplings with the cameras (G, V, 6, 17)."""


def residuals_of(cameras: Array, points: Array, observed: Observed, residuals: Array) -> None:
    """Observed minus projected pixels.

    Args:
        cameras: (V, 26) states.
        points: (P, 3) metres.
        observed: the observations.
        residuals: (N, 2) output, px; NaN behind the camera.
    """
    native.bundle_residuals(cameras, points, observed, residuals)


def reduce_normal(cameras: Array, objects: Objects, observed: Observed, damping: float, reduced: Reduced) -> None:
    """Sums up the normal equations and eliminates the unknowns of every object.

    Args:
        cameras: (V, 26) states.
        objects: points and objects.
        observed: observations, those of an object one after another; of weight 0, they count for nothing.
        damping: Levenberg-Marquardt's; added to every diagonal element as a share of it.
        reduced: outputs.
    """
    native.reduce_normal(cameras, objects, observed, damping, reduced)


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
