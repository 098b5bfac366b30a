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

_STEPS, _MOST_STEPS, _HALVINGS = 8, 20, 60
"""Of Newton's method from the pixel itself, of that from a better start, of an interval to find this start in."""

_SETTLED, _FARTHEST = 1e-6, 1e6
"""In the plane z = 1: a solution is one if its last step was shorter; the end of lenses that have none."""


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


@compiled
def undistort(camera: Array, x: float, y: float) -> tuple[float, float]:
    """Coordinates of a pixel in the plane z = 1; the twin is `Lens.undistort_clamped`.

    What is next to where the lens turns back may be imaged beyond, where its slopes lead away: then steps begin at what
    the radial distortion alone images there. A contour lies up to a pixel beside what is seen: if the lens images
    nothing there, it is at the end of its reach.

    Args:
        camera: (29,) row of `Rig.packed`.
        x, y: the pixel.
    """
    ty = (y - camera[at.CY]) / camera[at.FY]
    tx = (x - camera[at.CX] - camera[at.SHEAR] * ty) / camera[at.FX]
    a, b, found = _stepped(camera, tx, ty, tx, ty, _STEPS)
    if not found:
        distance, reach = np.sqrt(tx * tx + ty * ty), min(np.sqrt(camera[at.REACH2]), _FARTHEST)
        straight = _straightened(camera, distance, reach) / distance
        a, b, found = _stepped(camera, tx, ty, straight * tx, straight * ty, _MOST_STEPS)
        if not found:
            a, b = tx * reach / distance, ty * reach / distance
    return a, b


@compiled
def _stepped(camera: Array, tx: float, ty: float, a: float, b: float, n: int) -> tuple[float, float, bool]:
    """The point that the lens images at tx, ty, by n Newton steps from a, b at most; whether it is one."""
    da = db = 0.0
    for _ in range(n):
        u, v, xx, xy, yy = bend_with_slopes(lens_of(camera), a, b, 1.0)
        ex, ey = tx - u, ty - v
        if ex == 0.0 and ey == 0.0:
            return a, b, not beyond_reach(camera, a, b)
        det = xx * yy - xy * xy
        da, db = float((yy * ex - xy * ey) / det), float((xx * ey - xy * ex) / det)
        a, b = a + da, b + db
    return a, b, abs(da) < _SETTLED and abs(db) < _SETTLED and not beyond_reach(camera, a, b)


@compiled
def _straightened(camera: Array, distance: float, reach: float) -> float:
    """How far from the axis is what the radial distortion images at a distance from it: by halving, within a reach."""
    k1, k2, _, _, k3, k4, k5, k6 = lens_of(camera)
    low, high = 0.0, reach
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        if bend((k1, k2, 0.0, 0.0, k3, k4, k5, k6), middle, 0.0, 1.0)[0] < distance:
            low = middle
        else:
            high = middle
    return low
