"""Tables of followed points: of a view's image, or in space."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from tracker.foundation.arrays import Array, Integers, Mask
from tracker.foundation.errors import SequenceError
from tracker.foundation.files import Stamp, stamp_of
from tracker.foundation.geometry.superquadrics import inside_outside, signed_distance
from tracker.points.following.tables import TABLE, PointTable, read_trajectories


@dataclass(frozen=True)
class Followed:
    """One table."""

    view: int
    """Number of the view of the points' image; -1 in space."""

    trajectories: PointTable

    def at(self, frame: int) -> tuple[Integers, Array, Array]:
        """Numbers (N,) of the points in a frame, their positions (N, D) and covariances (N, D, D), m or px."""
        t = frame - int(self.trajectories.frames[0])
        if not 0 <= t < len(self.trajectories.frames):
            n_axes = self.trajectories.positions.shape[2]
            return np.zeros(0, dtype=np.int64), np.zeros((0, n_axes)), np.zeros((0, n_axes, n_axes))
        seen = np.flatnonzero(self.trajectories.seen[t])
        return seen, self.trajectories.positions[t, seen], self.trajectories.covariances[t, seen]


def open_followed(pattern: str, views: tuple[str, ...], downscales: tuple[float, ...]) -> tuple[Followed, ...]:
    """The tables of a path, read once as long as they do not change.

    Args:
        pattern: a table or a result folder of `bodytrack follow`; with `{view}` one for each view that has one.
        views: names of the cameras.
        downscales: one a view, size of the images in which points were followed, over that of these.

    Raises:
        SequenceError: there is none, or points of an image without a view.
    """
    paths = [Path(pattern.replace("{view}", name)) for name in views]
    return _opened(pattern, views, downscales, tuple(map(stamp_of, paths)))


@lru_cache(maxsize=8)
def _opened(
    pattern: str, views: tuple[str, ...], downscales: tuple[float, ...], _: tuple[Stamp, ...]
) -> tuple[Followed, ...]:
    if "{view}" not in pattern:
        found = read_trajectories(Path(pattern))
        if found.flat and len(views) > 1:
            raise SequenceError(
                f"{pattern}: points in the image of one view, and the recording has {len(views)}: follow each by "
                "itself, and put {view} for its name into the path"
            )
        return (_scaled(0 if found.flat else -1, found, downscales[0]),)
    paths = [Path(pattern.replace("{view}", name)) for name in views]
    present = [k for k, path in enumerate(paths) if path.exists()]
    if not present:
        raise SequenceError(f"{pattern}: no followed points of any view ({', '.join(views)}); expected {TABLE}")
    tables = []
    for k in present:
        found = read_trajectories(paths[k])
        if not found.flat:
            raise SequenceError(f"{paths[k]}: points in space, expected those of view {views[k]} in its image")
        tables.append(_scaled(k, found, downscales[k]))
    return tuple(tables)


def _scaled(view: int, found: PointTable, downscale: float) -> Followed:
    """Pixels in the tracked images; pixel centres lie at integer coordinates."""
    if not found.flat or downscale == 1:
        return Followed(view, found)
    places = (found.positions + 0.5) / downscale - 0.5
    return Followed(view, replace(found, positions=places, covariances=found.covariances / downscale**2))


# Steps of a ray through the sphere around a part; bisections of the crossing between two of them.
_STEPS, _HALVINGS = 40, 10


@dataclass(frozen=True)
class Attachments:
    """N attachments of followed points to parts of the scene's persons; a frozen value."""

    table: Integers
    """(N,) number of the point's table."""

    point: Integers
    """(N,) its number there."""

    part: Integers
    """(N,) part of the scene that carries it; -1 if it was dropped."""

    place: Array
    """(N, 3) in the part's frame, metres."""

    covariance: Array
    """(N, 3, 3) of the place, square metres."""

    strikes: Integers
    """(N,) consecutive frames in which it disagreed with its part."""

    @staticmethod
    def none() -> Attachments:
        """No point yet."""
        whole = np.zeros(0, dtype=np.int64)
        return Attachments(whole, whole, whole, np.zeros((0, 3)), np.zeros((0, 3, 3)), whole)

    @staticmethod
    def of(points: Integers, part: Integers, place: Array, covariance: Array) -> Attachments:
        """Attachments of the first table."""
        whole = np.zeros(len(points), dtype=np.int64)
        return Attachments(whole, points, part, place, covariance, whole)

    def joined(self, other: Attachments) -> Attachments:
        """These and others."""
        fields = self.__dataclass_fields__
        return Attachments(**{name: np.concatenate([getattr(self, name), getattr(other, name)]) for name in fields})

    def chosen(self, which: Mask | Integers) -> Attachments:
        """Some of them."""
        return Attachments(**{name: getattr(self, name)[which] for name in self.__dataclass_fields__})

    def judged(self, seen: Mask, disagree: Mask, patience: int) -> tuple[Attachments, Mask]:
        """The attachments after a frame: points that disagreed in `patience` consecutive frames are dropped.

        Args:
            seen: (N,) points that the frame shows on trusted parts.
            disagree: (N,) those that are away from their part.
            patience: frames.

        Returns:
            The attachments, and (N,) the dropped ones.
        """
        strikes = np.where(seen, np.where(disagree, self.strikes + 1, 0), self.strikes)
        dropped: Mask = (self.part >= 0) & (strikes >= patience)
        part = np.where(dropped, -1, self.part)
        return replace(self, part=part, strikes=np.where(dropped, 0, strikes)), dropped


@dataclass(frozen=True)
class Met:
    """Points where N rays meet a body."""

    part: Integers
    """(N,) -1 for rays that miss it."""

    point: Array
    """(N, 3) in the part's frame, metres."""

    facing: Array
    """(N,) cosine between surface normal and the direction back along the ray: 0 at the contour."""


def met_by_rays(centre: Array, rays: Array, placements: Array, shapes: Array) -> Met:
    """The nearest crossing of each ray with the parts' surfaces.

    Args:
        centre: (3,) origin of the rays, metres.
        rays: (N, 3) unit vectors.
        placements: (P, 4, 4) of the parts in the world.
        shapes: (P, 7) packed superquadrics.
    """
    n = len(rays)
    nearest, part = np.full(n, np.inf), np.full(n, -1)
    point, facing = np.zeros((n, 3)), np.zeros(n)
    for p, (placed, shape) in enumerate(zip(placements, shapes, strict=True)):
        start, along = (centre - placed[:3, 3]) @ placed[:3, :3], rays @ placed[:3, :3]
        radius = float(np.linalg.norm(shape[:3] * (1 + np.append(np.abs(shape[5:7]), 0))))
        middle = -along @ start
        beside = np.linalg.norm(start + middle[:, None] * along, axis=1)
        near = np.flatnonzero((beside < radius) & (middle > 0) & (middle - radius < nearest))
        if not len(near):
            continue
        depth, hit = _crossing(shape, start, along[near], middle[near], radius)
        near, depth = near[hit], depth[hit]
        first = depth < nearest[near]
        near, depth = near[first], depth[first]
        nearest[near], part[near] = depth, p
        point[near] = start + depth[:, None] * along[near]
        facing[near] = -(signed_distance(shape, point[near])[1] * along[near]).sum(axis=1)
    return Met(part, point, facing)


def _crossing(shape: Array, start: Array, along: Array, middle: Array, radius: float) -> tuple[Array, Mask]:
    """Depth (N,) at which rays first enter a shape, metres, and (N,) whether they do."""
    steps = np.linspace(-radius, radius, _STEPS)
    depths = np.maximum(middle[:, None] + steps, 0)
    inside = inside_outside(shape, start + depths[..., None] * along[:, None]) < 1
    k = inside.argmax(axis=1)
    hit: Mask = inside.any(axis=1) & (k > 0)
    rows = np.arange(len(along))
    far, near = depths[rows, k], depths[rows, np.maximum(k - 1, 0)]
    for _ in range(_HALVINGS):
        half = (near + far) / 2
        within = inside_outside(shape, start + half[:, None] * along) < 1
        near, far = np.where(within, near, half), np.where(within, half, far)
    return (near + far) / 2, hit


def ray_covariances(along: Array, facing: Array, lateral_m: Array, surface_m: float) -> Array:
    """(N, 3, 3) covariances of places found by rays: from the pixel across them, and the surface along them.

    Args:
        along: (N, 3) unit directions of the rays, in the frame of the covariances.
        facing: (N,) cosine between ray and
            surface normal.
        lateral_m: (N,) standard deviation across the ray, metres.
        surface_m: standard deviation of the surface along its normal, metres.
    """
    outer = along[:, :, None] * along[:, None, :]
    depth = (surface_m / np.maximum(facing, 0.1)) ** 2
    found: Array = lateral_m[:, None, None] ** 2 * (np.eye(3) - outer) + depth[:, None, None] * outer
    return found
