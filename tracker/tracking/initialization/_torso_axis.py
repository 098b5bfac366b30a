"""The torso's axis in space from the foreground of several views (paper, section 4.1)."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, Mask
from tracker.foundation.errors import InitializationError
from tracker.foundation.geometry import line_from_planes, nearest_along_line
from tracker.images.operations.masks import PrincipalAxis, iterated_axes, region_points

# Bins of the head histogram, metres, and how far from the axis its points may lie: half a shoulder width.
_BIN_M = 0.02
_LATERAL_M = 0.2
_LEANING = np.cos(np.radians(45.0))
# Of two pixels and fewer there is no major axis, or no strip around it.
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

    A shadow that hangs on a region turns its major axis. With three views or more, each is left out in turn, and of
    all lines the one wins that the foreground of all views lies around best.

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
    """The major axis of a person's voxels (N, 3) metres, after removing what lies lateral to it turn by turn.

    It needs no axis in any view, so that it also holds where shadows and objects hang on the regions.

    Raises:
        InitializationError: nothing lies around it, as in a ring.
    """
    centre, direction = _hull_line(points)
    near = _beside(points, centre, direction) < _LATERAL_M
    if not near.any():
        raise InitializationError("the foreground does not lie around its own axis: it is no person")
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
    """Point and upward direction (3,) of the line in the planes of some views' axes; None if these are one plane."""
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
