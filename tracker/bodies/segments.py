"""What a body consists of: rigid segments in a tree, the parameters that move them, parts and landmarks on them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

from tracker.bodies.shape import TaperedSuperquadric
from tracker.foundation.arrays import Array, Integers


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
    """Standard deviation from the rest pose in everyday movement, rad; infinite where all values are as likely."""

    @property
    def unit(self) -> str:
        """Unit as shown to people and in tables: m or deg."""
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
    """Index of the segment it hangs on, always a smaller one; -1 for the world."""

    joint: Array
    """(3,) centre of its joint in the reference pose, metres."""

    parameters: tuple[int, ...]
    """Indices of its own parameters, outermost first; empty where it is fixed to its parent."""

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
    """The parameters that everything hangs on: where a body is, and which way it faces."""

    columns: Integers
    """All of them."""

    shifts: Integers
    """(3,) translations along x, y, z."""

    turn: int
    """Rotation about the vertical."""


def unjoined(chains: Sequence[frozenset[int]]) -> list[tuple[int, int]]:
    """Pairs of parts that are neither on one segment nor on two that hang on each other.

    Args:
        chains: the parameters that move each part.
    """
    return [(p, q) for p, q in combinations(range(len(chains)), 2) if not _joined(chains[p], chains[q], chains)]


def _joined(one: frozenset[int], other: frozenset[int], chains: Sequence[frozenset[int]]) -> bool:
    """Whether what two chains of parameters move is one segment or two that hang on each other."""
    inner, outer = sorted((one, other), key=len)
    return inner <= outer and not any(inner < chain < outer for chain in chains)
