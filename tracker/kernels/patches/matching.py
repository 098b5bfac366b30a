"""Adaptive least squares matching of image patches (Gruen 1985): six affine and two radiometric parameters."""

from __future__ import annotations

import tracker._native as native
from tracker.foundation.arrays import Array, Integers
from tracker.kernels.patches.equations import Noise, Rule
from tracker.kernels.patches.splines import SplineImage

MATCHED, NOT_CONVERGED, DRIFTED, OUTSIDE, WEAK = 0, 1, 2, 3, 4
"""How a match ended; WEAK: the patch has too little texture, or looks like its negative."""

WARP, SIGMA0, COVARIANCE, CORRELATION, HALF_PATCH, N_FOUND = slice(0, 6), 8, slice(9, 12), 12, 14, 15
"""Columns of what is found.

0-5 centre px and affine matrix row by row, 6-7 brightness and contrast, 8 sigma0 grey levels, 9-11 variances and
covariance of the shift xx yy xy px^2, 12 correlation, 13 iterations, 14 half the patch px.
"""


def match_patches(
    template: SplineImage, search: SplineImage, at: Array, found: Array, ended: Integers, rule: Rule, noise: Noise
) -> None:
    """Finds N template patches in another image.

    The inverse-compositional form linearizes the template once; the classical form of Gruen (1985) linearizes
    the search image at every iteration. Both minimize the squares of ``brightness + contrast g(A x + c) - f(x)``.

    Args:
        template, search: spline coefficients, width and height of both images.
        at: (N, 2) centres of the template patches, px.
        found: (N, 15) holds the starts, and the results after.
        ended: (N,) written: how each match ended.
        rule: see `Rule`.
        noise: see `Noise`.
    """
    native.match_patches(template, search, at, found, ended, rule, noise)
