"""Start poses of all persons, and the evidence of how they were found."""

from __future__ import annotations

from dataclasses import dataclass

from tracker.arrays import Array, Mask


@dataclass(frozen=True)
class AxisFit:
    """Bootstrapping in one view, for the picture like the paper's figure 5."""

    foreground: Mask
    """(H, W) thresholded difference to the background."""

    axes: tuple[Array, ...]
    """Successive major axes, each (2, 2): its two end points, px."""


@dataclass(frozen=True)
class Start:
    """Start poses of all persons."""

    poses: tuple[Array, ...]
    """(dof,) for each person, rad and m."""

    evidence: tuple[tuple[AxisFit | None, ...], ...] = ()
    """For each person and view; empty if the poses were given."""
