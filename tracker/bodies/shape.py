"""Tapered superquadrics: the shapes of body parts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tracker.foundation.arrays import Array, frozen, shape_fault
from tracker.foundation.errors import ModelError
from tracker.foundation.geometry.superquadrics import inside_outside, surface


@dataclass(frozen=True)
class TaperedSuperquadric:
    """A superquadric, tapered linearly along its z axis (Metaxas & Terzopoulos 1993; paper, section 3).

    ``x = a1 (1 + k1 z/a3) cos^e1(eta) cos^e2(omega)``, ``y = a2 (1 + k2 z/a3) cos^e1(eta) sin^e2(omega)``,
    ``z = a3 sin^e1(eta)``.

    Raises:
        ModelError: sizes not positive, squareness outside 0.1-1 (convex shapes), taper outside -0.7..0.7.
    """

    size: Array
    """(3,) half extents a1 a2 a3, metres."""

    squareness: Array
    """(2,) exponents e1 (along z) and e2 (around z): 1 an ellipsoid, towards 0 a box."""

    taper: Array
    """(2,) relative growth of x and y from the middle to the +z end; the -z end shrinks alike. Beyond 0.7 an ellipsoid
    is no longer convex, which silhouettes and visibility rely on."""

    def __post_init__(self) -> None:
        for name, length in (("size", 3), ("squareness", 2), ("taper", 2)):
            values = frozen(getattr(self, name))
            if fault := shape_fault(values, length):
                raise ModelError(f"superquadric: {name}: {fault}")
            object.__setattr__(self, name, values)
        if not (self.size > 0).all():
            raise ModelError(f"superquadric: half extents {self.size.tolist()} m, expected positive")
        if not ((self.squareness >= 0.1) & (self.squareness <= 1)).all():
            raise ModelError(f"superquadric: squareness {self.squareness.tolist()}, expected 0.1 to 1")
        if not (np.abs(self.taper) <= 0.7).all():
            raise ModelError(f"superquadric: taper {self.taper.tolist()}, expected -0.7 to 0.7")

    @property
    def packed(self) -> Array:
        """(7,) the row that kernels take; `tracker.kernels.rows.SuperquadricRow` names the columns."""
        return frozen(np.concatenate([self.size, self.squareness, self.taper]))

    def surface(self, eta: Array, omega: Array) -> tuple[Array, Array]:
        """Points (..., 3) and outward unit normals (..., 3) at latitudes eta and longitudes omega, rad."""
        return surface(self.packed, eta, omega)

    def inside_outside(self, points: Array) -> Array:
        """Inside-outside function of points (..., 3) in the part's frame: < 1 inside, 1 on the surface."""
        return inside_outside(self.packed, points)

    def scaled(self, length: float, girth: float) -> TaperedSuperquadric:
        """The shape with its z extent times `length` and its x and y extents times `girth`."""
        return TaperedSuperquadric(self.size * (girth, girth, length), self.squareness, self.taper)
