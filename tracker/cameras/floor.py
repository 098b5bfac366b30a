"""The floor of a rig's world, and which way is up, from points that lie on it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array
from tracker.foundation.errors import CalibrationError

_ROUNDS = 6
"""Fits that follow one another: the first turns a world that lies up to 60 degrees obliquely, the others leave out what
lies beside the plane and converge."""

_GROSS = 3.5
"""Times the usual scatter from which on a point is none of the floor."""

_MOST_SCATTER_M = 0.03
"""RMS distance from a plane beyond which points are none of one floor. Resting feet of eight recordings scattered by
0 to 17 mm, those of somebody who lies on the floor by 35."""

_SURE = 3.0
"""Standard deviations from which on a tilt is taken."""

_TILT_DEG = 1.0
"""Standard deviation of a tilt that can be used: 17 mm per metre. Points on a line say nothing of the tilt across."""

_FEWEST = 6
"""Points that can disagree about a plane: feet of somebody who lies, four times at rest, told a tilt of 7 degrees."""

_HOW = ("as before: they do not tell the tilt", "as they lie, along one direction alone", "as they lie")
"""Where the direction that is up comes from, by the number of directions along which points tell the tilt."""


@dataclass(frozen=True)
class Floor:
    """A floor in the world of a rig."""

    up: Array
    """(3,) unit vector that is up."""

    height_m: float
    """Where the floor is along it."""

    scatter_m: float
    """RMS distance from it of the points that tell it; 0 of one point."""

    n_points: int
    beside_m: tuple[float, ...]
    """Heights over it of points that lie elsewhere."""

    n_directions: int
    """Along which points tell the tilt, 0 to 2; without it, `up` is taken from the cameras or the world."""

    source: str
    """What the points are, in words."""

    def laid(self, rig: Rig) -> Rig:
        """The rig in a world in which z is up and the floor is z = 0."""
        return rig.standing(self.up, self.height_m)

    def told(self) -> Iterator[str]:
        """What was found, in one line each."""
        off_deg = float(np.degrees(np.arccos(np.clip(self.up[2], -1, 1))))
        axis = ", ".join(f"{value + 0.0:.4f}" for value in np.round(self.up, 4))
        yield f"floor: told by {self.n_points} {self.source}, {1000 * self.scatter_m:.0f} mm off it (RMS)"
        yield f"up: ({axis}), {off_deg:.1f} degrees off z, {_HOW[self.n_directions]}"
        yield f"the floor is at {self.height_m:+.3f} m along it"
        if self.beside_m:
            beside = ", ".join(f"{1000 * height:+.0f} mm" for height in self.beside_m[:_MOST_TOLD])
            yield f"{len(self.beside_m)} more lie elsewhere ({beside}): on a step, or is one of them the floor?"


_MOST_TOLD = 6
"""Of what is told one by one."""


def fitted_floor(points: Array, rig: Rig, source: str, sigma_m: float) -> Floor:
    """The floor on which points lie; those that lie beside the plane of most are left out.

    Args:
        points: (N, 3) of the rig's world, metres.
        rig: the cameras, which are above the floor, and which tell roughly what is up.
        source: what the points are, in words.
        sigma_m: their usual standard deviation, metres.

    Raises:
        CalibrationError: no points, none of one plane, or most cameras come out below it.
    """
    if not len(points):
        raise CalibrationError(f"floor: no {source}, expected at least one")
    up = usual_up(rig)
    kept, n_directions = np.ones(len(points), dtype=bool), 0
    for _ in range(_ROUNDS):
        upwards, n_directions = _tilt(points[kept], up, sigma_m)
        up = upwards / np.linalg.norm(upwards)
        heights = points @ up
        off = np.abs(heights - np.median(heights[kept]))
        kept = off <= _GROSS * max(sigma_m, 1.4826 * float(np.median(off[kept])))
    floor_m, scatter_m = float(heights[kept].mean()), float(heights[kept].std())
    if scatter_m > _MOST_SCATTER_M:
        raise CalibrationError(
            f"floor: {kept.sum()} {source} are {1000 * scatter_m:.0f} mm off one plane (RMS), expected at most "
            f"{1000 * _MOST_SCATTER_M:.0f}: are they on one floor?"
        )
    if np.median([camera.centre @ up for camera in rig.cameras]) < floor_m:
        raise CalibrationError(f"floor: most cameras would be below the {source}, expected above: are these on it?")
    beside = tuple((heights[~kept] - floor_m).tolist())
    return Floor(up, floor_m, scatter_m, int(kept.sum()), beside, n_directions, source)


def usual_up(rig: Rig) -> Array:
    """(3,) z where the cameras do not contradict it, else what they hold up."""
    z = np.array([0.0, 0.0, 1.0])
    held = rig.probable_up
    return z if held @ z > np.cos(np.radians(_NEAR_DEG)) else held


_NEAR_DEG = 15.0
"""Between z and what the cameras hold up, below which z is meant to be up; see `tracker.cameras.rig`."""


def _tilt(points: Array, up: Array, sigma_m: float) -> tuple[Array, int]:
    """A vector upwards from the plane through points, and along how many directions they tell it.

    Heights are fitted by a slope along each of the two main directions of their spread; a slope that is not beyond its
    uncertainty stays 0.
    """
    if len(points) < _FEWEST:
        return up, 0
    offsets = points - points.mean(axis=0)
    level = offsets - np.outer(offsets @ up, up)
    _, spreads, axes = np.linalg.svd(level, full_matrices=False)
    heights, upwards, n_directions = offsets @ up, up.copy(), 0
    slopes = (heights @ (level @ axes[:2].T)) / np.maximum(spreads[:2], 1e-9) ** 2
    left = heights - level @ axes[:2].T @ slopes
    scatter = max(sigma_m, float(np.sqrt((left**2).sum() / max(len(points) - 3, 1))))
    for slope, spread, axis in zip(slopes, spreads[:2], axes[:2], strict=True):
        sigma = scatter / max(float(spread), 1e-9)
        usable = bool(sigma < np.radians(_TILT_DEG))
        n_directions += usable
        if usable and abs(slope) > _SURE * sigma:
            upwards -= slope * axis
    return upwards, n_directions
