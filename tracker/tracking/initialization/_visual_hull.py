"""Where persons can be: the volume that the foreground of all views has in common, in pieces that hang together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from tracker.cameras.frame import seen_pixels
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, Array32, Integers, Mask
from tracker.images.operations.edges import distance_to
from tracker.images.operations.masks import grown

STEP_M = 0.04
"""Edge of a voxel, metres."""

# A cube of the first pass has 27 of the second.
_COARSE = 3
# A tall man with an arm raised.
_HEIGHT_M = 2.4
# Least and largest half side of the floor that is searched.
_REACH_M = (1.5, 5.0)


@dataclass(frozen=True)
class Hull:
    """Voxels that lie in the foreground of the views that see them."""

    cells: Integers
    """(N, 3) numbers of the voxels."""

    points: Array
    """(N, 3) their centres, metres."""

    lacking: Integers
    """(N,) views that see the voxel, but no foreground there."""

    seen: Array
    """(N,) share of the views that see the voxel."""

    def part(self, which: Mask | Integers) -> Hull:
        """Some of the voxels."""
        return Hull(self.cells[which], self.points[which], self.lacking[which], self.seen[which])


def visual_hull(rig: Rig, masks: tuple[Mask | None, ...], most_lacking: int) -> Hull:
    """The voxels of the common field of view that are foreground.

    Coarse cells first, then those that may hold some are cut into voxels.

    Args:
        rig: the cameras.
        masks: (H, W) foreground of each view, None where there is none.
        most_lacking: views that may see a voxel without foreground there; at least two must see it.
    """
    gaps = [None if mask is None else distance_to(mask) for mask in masks]
    middle, reach = _common_field(rig)
    n = np.ceil(np.array([reach, reach, _HEIGHT_M]) / (STEP_M * _COARSE)).astype(int)
    axes = [np.arange(-size, size) * _COARSE for size in n]
    cells = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    half = (_COARSE - 1) / 2
    within, _, _ = _in_foreground(rig, gaps, middle + STEP_M * (cells + half), STEP_M * _COARSE, most_lacking)
    inner = np.stack(np.meshgrid(*[np.arange(_COARSE)] * 3, indexing="ij"), axis=-1).reshape(1, -1, 3)
    cells = (cells[within][:, None] + inner).reshape(-1, 3)
    points = middle + STEP_M * cells
    within, lacking, seen = _in_foreground(rig, gaps, points, 0.0, most_lacking)
    return Hull(cells, points, lacking, seen).part(within)


def connected(hull: Hull, erosions: int = 0) -> list[Hull]:
    """Pieces of a hull that hang together, the largest first.

    Args:
        hull: the voxels.
        erosions: layers taken off to part pieces that touch, before the voxels are given to the nearest core.
    """
    if len(hull.cells) == 0:
        return []
    low = hull.cells.min(axis=0) - 1
    grid = np.zeros(hull.cells.max(axis=0) - low + 2, dtype=np.bool_)
    at = tuple((hull.cells - low).T)
    grid[at] = True
    cores = ndimage.binary_erosion(grid, iterations=erosions) if erosions else grid
    labels, count = ndimage.label(cores, structure=np.ones((3, 3, 3)))
    if erosions and count:
        nearest = ndimage.distance_transform_edt(labels == 0, return_distances=False, return_indices=True)
        labels = labels[tuple(nearest)]
    owners = labels[at]
    sizes = np.bincount(owners, minlength=count + 1)
    order = [label for label in np.argsort(sizes[1:])[::-1] + 1 if sizes[label]]
    return [hull.part(owners == label) for label in order]


def shadow(rig: Rig, v: int, points: Array, margin_m: float) -> Mask:
    """The pixels (H, W) of view v around the projections of points (N, 3), by a margin in metres."""
    camera = rig.cameras[v]
    width, height = camera.size
    mask = np.zeros((height, width), dtype=np.uint8)
    rounded, seen = seen_pixels(camera, points)
    if not seen.any():
        return mask.astype(np.bool_)
    mask[rounded[seen, 1], rounded[seen, 0]] = 1
    radius = int(np.ceil(camera.matrix[0, 0] * margin_m / np.percentile(camera.in_camera(points[seen])[:, 2], 5)))
    return grown(mask.view(np.bool_), radius)


def within_all(rig: Rig, masks: tuple[Mask, ...], points: Array) -> Mask:
    """Which of points (N, 3) lie in the mask (H, W) of every view that sees them."""
    within = np.ones(len(points), dtype=np.bool_)
    for camera, mask in zip(rig.cameras, masks, strict=True):
        rounded, seen = seen_pixels(camera, points)
        within[seen] &= mask[rounded[seen, 1], rounded[seen, 0]]
    return within


def _common_field(rig: Rig) -> tuple[Array, float]:
    """The point that all cameras look at, and how far around it persons are sought, metres."""
    centres = np.array([camera.centre for camera in rig.cameras])
    forward = np.array([camera.camera_from_world[2, :3] for camera in rig.cameras])
    ahead = centres.mean(axis=0) + 3.0 * forward.mean(axis=0)
    # Parallel optical axes meet nowhere: a weak pull to 3 m before the cameras settles that.
    across = np.eye(3) - forward[:, :, None] * forward[:, None, :]
    weak = 0.01 * np.eye(3)
    middle = np.linalg.solve(across.sum(axis=0) + weak, (across @ centres[..., None]).sum(axis=0)[:, 0] + weak @ ahead)
    reach = float(np.clip(0.9 * np.median(np.linalg.norm(centres - middle, axis=1)), *_REACH_M))
    return middle, reach


def _in_foreground(
    rig: Rig, gaps: list[Array32 | None], points: Array, size_m: float, most_lacking: int
) -> tuple[Mask, Integers, Array]:
    """Which cells of a size around points (N, 3) may hold foreground of all views but some.

    Also how many views lack it, and the share of the views that see the cell.
    """
    inside, lacking = np.zeros((2, len(points)), dtype=np.int64)
    for camera, gap in zip(rig.cameras, gaps, strict=True):
        if gap is None:
            continue
        rounded, seen = seen_pixels(camera, points)
        radius = 0.87 * size_m * camera.matrix[0, 0] / camera.in_camera(points[seen])[:, 2]
        there = gap[rounded[seen, 1], rounded[seen, 0]] <= radius
        inside[seen] += there
        lacking[seen] += ~there
    share: Array = (inside + lacking) / sum(gap is not None for gap in gaps)
    return (inside >= 2) & (lacking <= most_lacking), lacking, share
