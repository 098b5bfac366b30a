"""The lens of a camera: where it images directions, and how far from its axis it can.

`tracker.kernels.lens` has the same formulas point by point.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.polynomial import Polynomial

from tracker.arrays import Array


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
    def reach(self) -> float:
        """Distance from the axis, in the plane z = 1, at which the radial distortion turns back; inf if it never does.

        ``r N(r^2) / D(r^2)`` grows up to the first root of ``N D + 2 r^2 (N' D - N D')``, or of ``D``; without a
        denominator that is ``1 + 3 k1 r^2 + 5 k2 r^4 + 7 k3 r^6``. What lies farther out would be imaged nearer to the
        centre again, over other things.
        """
        over, under = self._radial
        slope = over * under + Polynomial([0, 2]) * (over.deriv() * under - over * under.deriv())
        roots = np.concatenate([slope.trim().roots(), under.trim().roots()])
        squares = roots.real[(np.abs(roots.imag) < 1e-9) & (roots.real > 0)]
        return float(np.sqrt(squares.min())) if len(squares) else np.inf

    @property
    def imaged_reach(self) -> float:
        """Distance from the axis at which a finite `reach` is imaged by the radial distortion, in the plane z = 1.

        Inf where what lies there is imaged infinitely far away.
        """
        over, under = self._radial
        divisor = under(self.reach**2)
        # of a root of the denominator rounding leaves next to nothing, of either sign
        return float(self.reach * over(self.reach**2) / divisor) if divisor > 1e-9 else np.inf

    def distort(self, plane: Array) -> tuple[Array, Array]:
        """Plane coordinates (..., 2) as they are imaged, and the Jacobian of that (..., 2, 2)."""
        k1, k2, p1, p2, k3, k4, k5, k6 = self.distortion
        x, y = plane[..., 0], plane[..., 1]
        r2 = x * x + y * y
        under = 1 + r2 * (k4 + r2 * (k5 + r2 * k6))
        radial = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / under
        slope = (k1 + r2 * (2 * k2 + r2 * 3 * k3) - radial * (k4 + r2 * (2 * k5 + r2 * 3 * k6))) / under
        value = np.stack(
            [
                x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
                y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
            ],
            axis=-1,
        )
        jacobian = np.empty((*r2.shape, 2, 2))
        jacobian[..., 0, 0] = radial + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x
        jacobian[..., 0, 1] = jacobian[..., 1, 0] = 2 * x * y * slope + 2 * p1 * x + 2 * p2 * y
        jacobian[..., 1, 1] = radial + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x
        return value, jacobian

    def undistort(self, imaged: Array) -> Array:
        """The inverse of `distort`: imaged coordinates (..., 2) to those of the plane z = 1 (..., 2).

        Solved by Newton steps on the distortion's Jacobian.
        """
        plane: Array = imaged.copy()
        if not self.distortion.any():
            return plane
        for _ in range(20):
            value, slope = self.distort(plane)
            step = np.linalg.solve(slope, (imaged - value)[..., None])[..., 0]
            plane = plane + step
            if np.abs(step).max(initial=0.0) < 1e-13:
                break
        return plane
