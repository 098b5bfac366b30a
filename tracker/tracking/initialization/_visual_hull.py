"""Space where persons can be: the common volume of all views' foreground, in connected pieces."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy import ndimage

from tracker.cameras.frame import seen_pixels
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, Array32, Integers, Mask
from tracker.foundation.errors import InitializationError
from tracker.foundation.geometry import line_from_planes, nearest_along_line
from tracker.images.operations.edges import distance_to
from tracker.images.operations.masks import PrincipalAxis, grown, iterated_axes, region_points

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

    Coarse cells come first; those that may hold foreground are cut into voxels.

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
    """Connected pieces of a hull, the largest first.

    Args:
        hull: the voxels.
        erosions: layers removed to part pieces that touch, before the voxels go to the nearest core.
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
    """The point that all cameras face, and the radius of the search for persons around it, metres."""
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
    """Cells of a size around points (N, 3) that may hold foreground of all views except some.

    Also the number of views that lack it, and the share of the views that see the cell.
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


# Bins of the head histogram, metres, and how far from the axis its points may lie: half a shoulder width.
_BIN_M = 0.02
_LATERAL_M = 0.2
_LEANING = np.cos(np.radians(45.0))
# Two pixels and fewer have no major axis, and no strip around it.
_LEAST_PIXELS = 3
# Specks beyond the end of a person.
_END_PERCENT = 1.0


@dataclass(frozen=True)
class TorsoAxis:
    """Line through head and pelvis."""

    head_top: Array
    """(3,) top of the head, metres."""

    direction: Array
    """(3,) unit vector from the pelvis to the head."""

    @property
    def leans(self) -> bool:
        """Whether it is nearer to the floor than to the vertical: then the head may be at either end."""
        return bool(self.direction[2] < _LEANING)

    def other_way(self, points: Array) -> TorsoAxis:
        """The same line with the head at the other end of the voxels (N, 3), metres."""
        along = (points - self.head_top) @ self.direction
        return TorsoAxis(self.head_top + np.percentile(along, _END_PERCENT) * self.direction, -self.direction)


def region_axes(regions: tuple[Mask | None, ...], min_area: float) -> list[tuple[PrincipalAxis, ...]]:
    """Successive major axes of one person's region in each view; empty where it covers too little of it.

    Args:
        regions: (H, W) of each view.
        min_area: least share of an image that counts.
    """
    return [() if region is None else _axes_of(region, min_area) for region in regions]


def _axes_of(region: Mask, min_area: float) -> tuple[PrincipalAxis, ...]:
    least = max(int(min_area * region.size), _LEAST_PIXELS)
    return iterated_axes(region_points(region)) if int(region.sum()) >= least else ()


def torso_axis(rig: Rig, regions: tuple[Mask | None, ...], axes: list[tuple[PrincipalAxis, ...]]) -> TorsoAxis:
    """The 3-D axis that projects to the major axes of at least two views, with the head's place on it.

    A shadow connected to a region turns its major axis. With three views or more, each is left out in turn, and the
    line with most foreground of all views around it wins.

    Raises:
        InitializationError: fewer than two views show the person, all of them from the same direction, or the
            foreground of no view lies around the axis.
    """
    seen = {v: region for v, region in enumerate(regions) if axes[v] and region is not None}
    if len(seen) < 2:
        raise InitializationError(
            f"the foreground shows a person in {len(seen)} view(s), expected at least two: "
            "check the background plates and their threshold"
        )
    subsets = [tuple(seen), *(combinations(seen, len(seen) - 1) if len(seen) > 2 else ())]
    lines = [line for line in (_line(rig, axes, views) for views in subsets) if line is not None]
    if not lines:
        raise InitializationError(
            "the views see the torso's axis from one direction only, expected two views well apart"
        )
    rays = {v: rig.cameras[v].rays(region_points(region, 4000)) for v, region in seen.items()}
    spreads = [_along(rig, rays, point, direction) for point, direction in lines]
    best = max(range(len(lines)), key=lambda k: sum(share for _, share in spreads[k]))
    (point, direction), spread = lines[best], spreads[best]
    tops = [_head_position(along) for along, share in spread if share > 0.3]
    if not tops:
        raise InitializationError("the foreground does not lie around the torso's axis: check the background plates")
    return TorsoAxis(point + float(np.median(tops)) * direction, direction)


def hull_axis(points: Array) -> TorsoAxis:
    """The major axis of a person's voxels (N, 3) metres, after removing lateral parts turn by turn.

    It needs no axis in any view, and so tolerates shadows and objects connected to the regions.

    Raises:
        InitializationError: nothing lies around it, as in a ring.
    """
    centre, direction = _hull_line(points)
    near = _beside(points, centre, direction) < _LATERAL_M
    if not near.any():
        raise InitializationError("the foreground does not lie around its own axis: it is not a person")
    along = (points - centre) @ direction
    return TorsoAxis(centre + _head_position(along[near]) * direction, direction)


def _hull_line(points: Array) -> tuple[Array, Array]:
    """Point and upward direction (3,) of the major axis of voxels (N, 3)."""
    kept = points
    for _ in range(10):
        centre = kept.mean(axis=0)
        _, vectors = np.linalg.eigh((kept - centre).T @ (kept - centre))
        direction: Array = vectors[:, 2] if vectors[2, 2] > 0 else -vectors[:, 2]
        lateral = _beside(kept, centre, direction)
        near = lateral <= 2.0 * np.sqrt((lateral**2).mean())
        if near.all() or near.sum() < 10:
            break
        kept = kept[near]
    return centre, direction


def _beside(points: Array, centre: Array, direction: Array) -> Array:
    """Distances (N,) of points (N, 3) from a line, metres."""
    distances: Array = np.linalg.norm(np.cross(points - centre, direction), axis=1)
    return distances


def _line(rig: Rig, axes: list[tuple[PrincipalAxis, ...]], views: tuple[int, ...]) -> tuple[Array, Array] | None:
    """Point and upward direction (3,) of the line in the planes of some views' axes; None if the planes coincide."""
    normals = []
    for v in views:
        lower, upper = rig.cameras[v].rays(axes[v][-1].ends)
        normal = np.cross(lower, upper)
        normals.append(normal / np.linalg.norm(normal))
    centres = np.array([rig.cameras[v].centre for v in views])
    point, direction, strength = line_from_planes(np.array(normals), centres)
    # The head is up, as the paper assumes; who lies is tried the other way round as well.
    return None if strength < 0.1 else (point, direction if direction[2] > 0 else -direction)


def _along(rig: Rig, rays: dict[int, Array], point: Array, direction: Array) -> list[tuple[Array, float]]:
    """For each view the positions along the line of the foreground near it, metres, and their share of it all."""
    found = []
    for v, directions in rays.items():
        along, distance = nearest_along_line(point, direction, rig.cameras[v].centre, directions)
        near = distance < _LATERAL_M
        found.append((along[near], float(near.mean())))
    return found


def _head_position(along: Array) -> float:
    """Top of the head in one view: the upper end of the histogram of the positions along the axis, metres."""
    bins = np.arange(along.min(), along.max() + 2 * _BIN_M, _BIN_M)
    counts, _ = np.histogram(along, bins)
    # A head is a third as wide as a torso; specks above it are narrower.
    filled = np.flatnonzero(counts >= 0.15 * np.percentile(counts, 80))
    return float(bins[filled[-1] + 1])
