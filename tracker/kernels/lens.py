"""The lens: from the plane z = 1 of a camera to what its distortion makes of it.

Radial distortion is a quotient of polynomials, decentring is Brown's, as in OpenCV's model of eight numbers:
x (1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + k5 r^4 + k6 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2), and so for y with p1
and p2 exchanged. Lenses of few millimetres need the denominator; with k4 = k5 = k6 = 0 it divides by 1, exactly.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from tracker.arrays import Array, Array32
from tracker.kernels.compilation import compiled
from tracker.kernels.rows import camera as at

Number = float | np.floating[Any]
"""In double or single precision."""

LensTerms = tuple[Number, Number, Number, Number, Number, Number, Number, Number]
"""k1 k2 p1 p2 k3 k4 k5 k6, OpenCV's order."""


@compiled
def lens_of(camera: Array | Array32) -> LensTerms:
    """The distortion of a camera.

    Args:
        camera: (29,) row of `Rig.packed`.
    """
    return (
        camera[at.K1],
        camera[at.K2],
        camera[at.P1],
        camera[at.P2],
        camera[at.K3],
        camera[at.K4],
        camera[at.K5],
        camera[at.K6],
    )


@compiled(fastmath={"contract", "nsz"})
def beyond_reach(camera: Array | Array32, a: Number, b: Number) -> bool:
    """Whether a point of the plane z = 1 is so far from the axis that the lens does not image it.

    Args:
        camera: (29,) row of `Rig.packed`.
        a, b: the point.
    """
    return a * a + b * b > camera[at.REACH2]


@compiled
def bends(lens: LensTerms) -> bool:
    """Whether the lens does anything at all."""
    k1, k2, p1, p2, k3, k4, k5, k6 = lens
    radial = k1 != 0.0 or k2 != 0.0 or k3 != 0.0 or k4 != 0.0 or k5 != 0.0 or k6 != 0.0
    return radial or p1 != 0.0 or p2 != 0.0


@compiled(fastmath={"contract", "nsz"})
def bend(lens: LensTerms, a: Number, b: Number, one: Number) -> tuple[Number, Number]:
    """Where the lens images a point of the plane z = 1, in the same plane.

    Args:
        lens: of `lens_of`.
        a, b: the point.
        one: 1 in the precision to work in.
    """
    k1, k2, p1, p2, k3, k4, k5, k6 = lens
    r2, two = a * a + b * b, one + one
    radial = (one + r2 * (k1 + r2 * (k2 + r2 * k3))) / (one + r2 * (k4 + r2 * (k5 + r2 * k6)))
    u = a * radial + two * p1 * a * b + p2 * (r2 + two * a * a)
    v = b * radial + p1 * (r2 + two * b * b) + two * p2 * a * b
    return u, v


@compiled(fastmath={"contract", "nsz"})
def bend_with_slopes(
    lens: LensTerms, a: Number, b: Number, one: Number
) -> tuple[Number, Number, Number, Number, Number]:
    """`bend`, and its derivatives: of u by a, of u by b, which is that of v by a, and of v by b."""
    k1, k2, p1, p2, k3, k4, k5, k6 = lens
    r2, two = a * a + b * b, one + one
    three = two + one
    under = one / (one + r2 * (k4 + r2 * (k5 + r2 * k6)))
    radial = (one + r2 * (k1 + r2 * (k2 + r2 * k3))) * under
    slope = two * under * (k1 + r2 * (two * k2 + r2 * three * k3) - radial * (k4 + r2 * (two * k5 + r2 * three * k6)))
    pull = two * (p1 * b + p2 * a)
    u = a * radial + two * p1 * a * b + p2 * (r2 + two * a * a)
    v = b * radial + p1 * (r2 + two * b * b) + two * p2 * a * b
    aa, bb = radial + a * a * slope + pull + two * two * p2 * a, radial + b * b * slope + pull + two * two * p1 * b
    return u, v, aa, a * b * slope + two * (p1 * a + p2 * b), bb
