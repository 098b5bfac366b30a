"""The lens of a camera: where it images directions, and how far from its axis it can.

`tracker.kernels.projection` has the same formulas point by point.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.polynomial import Polynomial

from tracker.foundation.arrays import Array, Mask

FARTHEST_DEG = 75.0
"""Largest angle from the axis of a wide lens, whose radial distortion is a quotient of polynomials: there it ends. It
was fitted to directions up to there (`camera.rational_of`), because the plane z = 1 has no room for 90 degrees; beyond
it is arbitrary."""

_MOST_STEPS = 20
"""Steps of `undistort`: each doubles the digits, except for directions next to where the distortion turns back."""

_SMALL_STEP, _SETTLED = 1e-13, 1e-6
"""Step length in the plane z = 1 that ends the iteration, and last step of a valid solution."""

_HALVINGS, _MARGIN = 40, 1.1
"""Halvings of an interval as long as the lens reaches, for a start; and the factor by which decentring may image
farther."""


_NO_TERM = 1e-100
"""A coefficient so small is none: roots are found by dividing by the leading one, which would overflow."""


@dataclass(frozen=True)
class Lens:
    """Radial and decentring distortion of the plane z = 1, the radial one a quotient of polynomials for wide lenses."""

    distortion: Array
    """(8,) k1 k2 p1 p2 k3 k4 k5 k6, OpenCV's order; k4 k5 k6 are the denominator of the radial distortion."""

    @property
    def _radial(self) -> tuple[Polynomial, Polynomial]:
        """Numerator and denominator of the radial distortion, polynomials of r^2."""
        k1, k2, _, _, k3, k4, k5, k6 = self.distortion
        return Polynomial([1, k1, k2, k3]), Polynomial([1, k4, k5, k6])

    @cached_property
    def turns_back(self) -> float:
        """Distance from the axis, in the plane z = 1, at which the radial distortion turns back; inf if it never does.

        ``r N(r^2) / D(r^2)`` grows up to the first root of ``N D + 2 r^2 (N' D - N D')``, or of ``D``; without a
        denominator that is ``1 + 3 k1 r^2 + 5 k2 r^4 + 7 k3 r^6``. Farther points would be imaged nearer to the centre
        again, over other things.
        """
        if not self.distortion.any():
            return np.inf
        over, under = self._radial
        slope = over * under + Polynomial([0, 2]) * (over.deriv() * under - over * under.deriv())
        roots = np.concatenate([one.trim(_NO_TERM).roots() for one in (slope, under)])
        squares = roots.real[(np.abs(roots.imag) < 1e-9) & (roots.real > 0)]
        return float(np.sqrt(squares.min())) if len(squares) else np.inf

    @cached_property
    def reach(self) -> float:
        """Distance from the axis, in the plane z = 1, up to which the lens images anything; inf if it has no end.

        There it turns back; a quotient of polynomials ends at `FARTHEST_DEG` if it does not before.
        """
        wide = self.distortion[5:].any()
        return min(self.turns_back, float(np.tan(np.radians(FARTHEST_DEG)))) if wide else self.turns_back

    def imaged(self, distance: float) -> float:
        """Distance from the axis whose radial image is infinite, both in the plane z = 1.

        Inf where what lies there is imaged infinitely far away.
        """
        over, under = self._radial
        divisor = under(distance**2)
        # of a root of the denominator rounding leaves next to nothing, of either sign
        return float(distance * over(distance**2) / divisor) if divisor > 1e-9 else np.inf

    def distort(self, plane: Array) -> tuple[Array, Array]:
        """Plane coordinates (..., 2) as they are imaged, and the Jacobian of that (..., 2, 2)."""
        k1, k2, p1, p2, k3, k4, k5, k6 = self.distortion
        value, r2, under, radial = self._distorted(plane)
        x, y = plane[..., 0], plane[..., 1]
        slope = (k1 + r2 * (2 * k2 + r2 * 3 * k3) - radial * (k4 + r2 * (2 * k5 + r2 * 3 * k6))) / under
        jacobian = np.empty((*r2.shape, 2, 2))
        jacobian[..., 0, 0] = radial + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x
        jacobian[..., 0, 1] = jacobian[..., 1, 0] = 2 * x * y * slope + 2 * p1 * x + 2 * p2 * y
        jacobian[..., 1, 1] = radial + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x
        return value, jacobian

    def distorted(self, plane: Array) -> Array:
        """Plane coordinates (..., 2) as they are imaged: `distort` without the Jacobian, in half of its time."""
        return self._distorted(plane)[0]

    def _distorted(self, plane: Array) -> tuple[Array, Array, Array, Array]:
        """Imaged coordinates, squares of the distances from the axis, divisor and whole of the radial distortion."""
        k1, k2, p1, p2, k3, k4, k5, k6 = self.distortion
        x, y = plane[..., 0], plane[..., 1]
        r2 = x * x + y * y
        under = 1 + r2 * (k4 + r2 * (k5 + r2 * k6))
        radial = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / under
        value = np.stack(
            [
                x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
                y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
            ],
            axis=-1,
        )
        return value, r2, under, radial

    def undistort(self, imaged: Array) -> Array:
        """The inverse of `distort`: imaged coordinates (..., 2) to those of the plane z = 1 (..., 2).

        Solved by Newton steps on the distortion's Jacobian; NaN where the lens images nothing within its reach to.
        """
        if not self.distortion.any():
            return imaged.copy()
        plane, found = self._newton(imaged, imaged)
        # next to where it turns back, what is imaged may lie beyond: steps from there lead away
        lost = ~found & (np.linalg.norm(imaged, axis=-1) < _MARGIN * self._farthest)
        if lost.any():
            plane[lost], found[lost] = self._newton(imaged[lost], self._straightened(imaged[lost]))
        return np.where(found[..., None], plane, np.nan)

    def _newton(self, imaged: Array, start: Array) -> tuple[Array, Mask]:
        """Plane coordinates (..., 2) by steps from a start (..., 2), and which of them (...) are solutions."""
        plane: Array = start.copy()
        with np.errstate(all="ignore"):  # what has no solution may run anywhere
            for _ in range(_MOST_STEPS):
                value, slope = self.distort(plane)
                step = _solved(slope, imaged - value)
                plane = plane + step
                if not (np.abs(step) >= _SMALL_STEP).any():
                    break
            found = (np.abs(step).max(axis=-1) < _SETTLED) & (np.linalg.norm(plane, axis=-1) <= self.reach)
        return plane, np.asarray(found)

    @cached_property
    def _farthest(self) -> float:
        """Image of the end of the lens's reach."""
        return self.imaged(self.reach) if np.isfinite(self.reach) else np.inf

    def _straightened(self, imaged: Array) -> Array:
        """Plane coordinates (N, 2) without the radial distortion, which grows within its reach: by halving."""
        over, under = self._radial
        distances = np.linalg.norm(imaged, axis=-1)
        end = self.reach
        if not np.isfinite(end):
            end = 1.0
            while self.imaged(end) < distances.max():
                end *= 2
        low, high = np.zeros_like(distances), np.full_like(distances, end)
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            short = middle * over(middle**2) < distances * under(middle**2)
            low, high = np.where(short, middle, low), np.where(short, high, middle)
        straight: Array = imaged * (low / np.maximum(distances, 1e-300))[..., None]
        return straight

    def undistort_clamped(self, imaged: Array) -> Array:
        """`undistort`, but what lies beyond the reach of the lens is at its end, on the same side of the axis."""
        plane = self.undistort(imaged)
        distances = np.maximum(np.linalg.norm(imaged, axis=-1, keepdims=True), 1e-12)
        return np.where(np.isfinite(plane), plane, imaged * (min(self.reach, 1e6) / distances))


def _solved(matrix: Array, right: Array) -> Array:
    """Solutions (..., 2) of symmetric systems (..., 2, 2), (..., 2); not finite for singular ones."""
    a, b, d = matrix[..., 0, 0], matrix[..., 0, 1], matrix[..., 1, 1]
    x, y = right[..., 0], right[..., 1]
    return np.stack([d * x - b * y, a * y - b * x], axis=-1) / (a * d - b * b)[..., None]
