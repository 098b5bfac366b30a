"""A reference bar moved through the common volume of simulated cameras: exact rigs, images with every usual fault."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tracker.cameras.camera import Camera
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, Integers, Mask, frozen

SIZE = (768, 576)
"""Image size of D'Apuzzo's cameras, px."""


@dataclass(frozen=True)
class BarRecording:
    """Images of a bar's two targets, and the truth behind them."""

    rig: Rig
    ends: Array
    """(B, 2, 3) metres."""

    length_m: float
    frames: Integers
    """(B,) number of the frame that shows each position."""

    pixels: Array
    """(V, B, 2, 2) px, NaN where a target is not seen."""

    outliers: Mask
    """(V, B, 2) images that were thrown off."""

    swapped: Mask
    """(V, B) views in which the two ends were taken for each other."""


@dataclass(frozen=True)
class Faults:
    """What goes wrong with the images of a bar."""

    noise_px: float = 0.05
    outliers: float = 0.05
    """Share of images 5 to 100 px off."""

    swapped: float = 0.05
    """Share of bars in a view whose ends are exchanged."""

    late_frames: tuple[float, ...] = ()
    """Time by which each camera lags, frames; empty for synchronized cameras."""

    stride: int = 10
    """Every so many frames are measured, of those recorded while the bar is waved."""


def three_in_line(rng: np.random.Generator) -> Rig:
    """D'Apuzzo's arrangement: left, centre and right camera, 0.6 m apart, looking at a person 2.5 m away."""
    target = np.array([0.0, 2.5, 1.2])
    positions = [(x, 0.0, 1.2 + rng.normal(0, 0.02)) for x in (-0.6, 0.0, 0.6)]
    return _rig(("left", "centre", "right"), positions, target, 1100.0, rng)


def four_around(rng: np.random.Generator) -> Rig:
    """Four cameras in the corners of a room, 6 m apart."""
    target = np.array([0.0, 0.0, 1.0])
    angles = np.radians([45, 135, 225, 315]) + rng.normal(0, 0.05, 4)
    positions = [(4.2 * np.cos(a), 4.2 * np.sin(a), 2.2 + rng.normal(0, 0.1)) for a in angles]
    return _rig(("north_east", "north_west", "south_west", "south_east"), positions, target, 850.0, rng)


def _rig(
    names: tuple[str, ...],
    positions: list[tuple[float, float, float]],
    target: Array,
    focal_px: float,
    rng: np.random.Generator,
) -> Rig:
    """Cameras whose lenses and sensors differ as real ones do."""
    cameras = []
    for name, position in zip(names, positions, strict=True):
        camera = Camera.looking_at(name, SIZE, focal_px, position, target + rng.normal(0, 0.05, 3))
        matrix = np.array(camera.matrix)
        matrix[:2, :2] *= rng.uniform(0.97, 1.03)
        matrix[0, 0] *= 1 + rng.normal(0, 0.003)
        matrix[0, 1] = matrix[1, 1] * rng.normal(0, 2e-4)
        matrix[:2, 2] += rng.normal(0, 8, 2)
        lens = rng.uniform((-0.25, 0.02, -1e-3, -1e-3, -0.02), (-0.1, 0.12, 1e-3, 1e-3, 0.02))
        cameras.append(replace(camera, matrix=matrix, distortion=lens))
    return Rig(tuple(cameras))


def wave(rig: Rig, n_bars: int, length_m: float, rng: np.random.Generator, faults: Faults) -> BarRecording:
    """A bar waved through the volume that at least two cameras see.

    Args:
        rig: the cameras.
        n_bars: positions, one a frame, along a smooth path.
        length_m: distance of the targets.
        rng: path and faults.
        faults: noise and gross errors.
    """
    frames, ends, velocities = _path(rig, n_bars * faults.stride, length_m, rng)
    frames, ends, velocities = frames[:: faults.stride], ends[:: faults.stride], velocities[:: faults.stride]
    late = faults.late_frames or (0.0,) * len(rig)
    clean = [camera.project(ends + lag * velocities) for camera, lag in zip(rig.cameras, late, strict=True)]
    pixels = np.stack(clean)
    inside = ((pixels > 0) & (pixels < np.array(SIZE) - 1)).all(axis=3)
    pixels[~inside] = np.nan
    pixels += rng.normal(0, faults.noise_px, pixels.shape)
    outliers = rng.random(pixels.shape[:3]) < faults.outliers
    angles, radii = rng.uniform(0, 2 * np.pi, outliers.shape), rng.uniform(5, 100, outliers.shape)
    off = np.stack([radii * np.cos(angles), radii * np.sin(angles)], axis=-1)
    pixels = np.where(outliers[..., None], pixels + off, pixels)
    swapped = rng.random(pixels.shape[:2]) < faults.swapped
    pixels = np.where(swapped[..., None, None], pixels[:, :, ::-1], pixels)
    outliers = np.where(swapped[..., None], outliers[:, :, ::-1], outliers)
    return BarRecording(rig, frozen(ends), length_m, frames, frozen(pixels), outliers, swapped)


def _path(rig: Rig, n_bars: int, length_m: float, rng: np.random.Generator) -> tuple[Integers, Array, Array]:
    """Frames (B,), ends (B, 2, 3) and their velocities a frame, of bars with both ends in two views or more."""
    centre, reach = _volume(rig)
    n_tried = 6 * n_bars
    times = np.arange(n_tried, dtype=np.float64)
    middle, middle_speed = _smooth(times, 3, rng)
    direction, direction_speed = _smooth(times, 3, rng)
    middle, middle_speed = centre + reach * middle, reach * middle_speed
    size = np.linalg.norm(direction, axis=1, keepdims=True)
    unit = direction / size
    turn = (direction_speed - unit * np.sum(unit * direction_speed, axis=1, keepdims=True)) / size
    half = np.array([-0.5, 0.5])[:, None] * length_m
    ends = middle[:, None] + half * unit[:, None]
    speeds = middle_speed[:, None] + half * turn[:, None]
    images = rig.project(ends)
    inside = ((images > 8) & (images < np.array(SIZE) - 9)).all(axis=(2, 3))
    chosen = np.flatnonzero(inside.sum(axis=0) >= 2)[:n_bars]
    return chosen, ends[chosen], speeds[chosen]


def _smooth(times: Array, n: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Sums of sines between -1 and 1 (T, n) that come everywhere, and their derivatives."""
    rates = rng.uniform(0.01, 0.09, (3, n))
    phases = rng.uniform(0, 2 * np.pi, (3, n))
    sizes = np.array([0.5, 0.35, 0.15])[:, None]
    angles = times[:, None, None] * rates + phases
    return (sizes * np.sin(angles)).sum(axis=1), (sizes * rates * np.cos(angles)).sum(axis=1)


def _volume(rig: Rig) -> tuple[Array, Array]:
    """Centre and half extents (3,) of the space before the cameras."""
    axes = np.stack([camera.camera_from_world[2, :3] for camera in rig.cameras])
    if np.linalg.norm(axes.mean(axis=0)) > 0.9:
        # nearly parallel: their axes meet nowhere that could be relied on
        centre = np.mean([camera.centre for camera in rig.cameras], axis=0)
        return centre + 2.5 * axes.mean(axis=0), np.array([0.6, 0.5, 0.45])
    return rig.middle, np.array([1.4, 1.4, 0.8])


def every(recording: BarRecording, first: int, step: int) -> BarRecording:
    """Every `step`-th bar from `first` on: what is held out beside what is calibrated with."""
    part = slice(first, None, step)
    return BarRecording(
        recording.rig,
        recording.ends[part],
        recording.length_m,
        recording.frames[part],
        recording.pixels[:, part],
        recording.outliers[:, part],
        recording.swapped[:, part],
    )
