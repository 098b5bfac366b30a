"""Constituents of a body: rigid segments in a tree, the parameters that move them, parts and landmarks on them."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from tracker.foundation.arrays import Array, Integers, frozen, shape_fault
from tracker.foundation.errors import ModelError
from tracker.foundation.geometry.superquadrics import inside_outside, surface

Side = tuple[str, str]


@dataclass(frozen=True)
class Mirror:
    """The symmetry of a body: names that differ only in the word of a side are a pair."""

    sides: Side = ("left", "right")
    """Words in names, between underscores: `left_thigh` and `right_thigh`, `front_left_paw` and `front_right_paw`."""

    across: tuple[float, float, float] = (0.0, 1.0, 0.0)
    """Normal of the plane of symmetry, which goes through the origin of the reference pose."""

    def of(self, name: str) -> str:
        """The name of the other side's part, parameter or landmark; the same name on the midline."""
        one, other = self.sides
        swapped = {one: other, other: one}
        return "_".join(swapped.get(word, word) for word in name.split("_"))

    def meant(self, name: str, names: Iterable[str]) -> list[str]:
        """Names that one name means: itself, or both sides' if the word of the side is left out."""
        valid = tuple(names)
        if name in valid:
            return [name]
        found = [own for own in valid if name == _without(own, self.sides)]
        return sorted(found, key=lambda own: self.sides[1] in own.split("_"))


@functools.lru_cache(maxsize=4096)
def _without(name: str, sides: Side) -> str:
    """A name without the word of a side. Bodies made anew in a fit use the same ones again: a tenth of its time."""
    return "_".join(word for word in name.split("_") if word not in sides)


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


@dataclass(frozen=True)
class Parameter:
    """One degree of freedom: a translation along, or a rotation about, an axis of the reference pose."""

    name: str
    rotates: bool
    """True for a rotation (rad), False for a translation (m)."""

    axis: Array
    """(3,) unit vector in the reference pose."""

    point: Array
    """(3,) a point on the axis in the reference pose, metres."""

    limits: tuple[float, float]
    """Lowest and highest value, rad or m; infinite where free."""

    parent: int
    """Index of the parameter that moves this axis, -1 for none."""

    spread: float = math.inf
    """Standard deviation from the rest pose in everyday movement, rad; infinite if all values are equally likely."""

    @property
    def unit(self) -> str:
        """Unit for users and tables: m or deg."""
        return "deg" if self.rotates else "m"

    @property
    def column(self) -> str:
        """Column name in tables, for instance ``left_arm_extension_deg``."""
        return f"{self.name}_{self.unit}"


@dataclass(frozen=True)
class Segment:
    """A rigid segment: a node of the tree that a skeleton file is written from."""

    name: str
    parent: int
    """Index of its parent segment, always a smaller one; -1 for the world."""

    joint: Array
    """(3,) centre of its joint in the reference pose, metres."""

    parameters: tuple[int, ...]
    """Indices of its own parameters, outermost first; empty if it is fixed to its parent."""

    end: int
    """Index of the last parameter that moves it, -1 if none does."""


@dataclass(frozen=True)
class Part:
    """A rigid shape, moved by the chain of parameters that ends in `parameter`."""

    name: str
    segment: str
    """Rigid segment the part belongs to (a hand may move with its forearm)."""

    parameter: int
    """Index of the last parameter that moves the part, -1 if none does."""

    shape: TaperedSuperquadric
    model_from_part: Array
    """(4, 4) placement in the reference pose, metres."""


@dataclass(frozen=True)
class Landmark:
    """A named point on a segment, such as a joint centre."""

    name: str
    parameter: int
    """Index of the last parameter that moves it, -1 if none does."""

    point: Array
    """(3,) in the reference pose, metres."""

    segment: str = "world"


@dataclass(frozen=True)
class Root:
    """The parameters that carry everything: the body's place, and its heading."""

    columns: Integers
    """All of them."""

    shifts: Integers
    """(3,) translations along x, y, z."""

    turn: int
    """Rotation about the vertical."""


def unjoined(chains: Sequence[frozenset[int]]) -> list[tuple[int, int]]:
    """Pairs of parts that are neither on one segment nor on two joined segments.

    Args:
        chains: the parameters that move each part.
    """
    return [(p, q) for p, q in combinations(range(len(chains)), 2) if not _joined(chains[p], chains[q], chains)]


def _joined(one: frozenset[int], other: frozenset[int], chains: Sequence[frozenset[int]]) -> bool:
    """Whether two chains of parameters move one segment or two joined ones."""
    inner, outer = sorted((one, other), key=len)
    return inner <= outer and not any(inner < chain < outer for chain in chains)
