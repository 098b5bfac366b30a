"""Places on the persons that are followed from image to image, with their attachments and positions."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from tracker.bodies.scene import Scene
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, Integers, Mask, frozen
from tracker.foundation.geometry.superquadrics import meshes_of
from tracker.kernels.body import Carried, meet_parts, residuals_of
from tracker.kernels.pictures import draw_nearest, project_surfaces
from tracker.kernels.rows import CarriedPlaceRow, MetPlaceRow

_GRID = 7, 10
"""Latitudes and longitudes of the surfaces."""

_GROWN = 1.02
"""Chords between ten longitudes lie inside the surface, by at most this."""


@dataclass(frozen=True)
class Shown:
    """Parts of the scene in a view, in the box around them."""

    corner: Integers
    """(2,) x and y of the box's first pixel."""

    parts: NDArray[np.int16]
    """(H, W) number of the part, -1 for none."""

    def at(self, pixels: Array) -> Integers:
        """(N,) part at pixels (N, 2) of the view; -1 outside the box."""
        x, y = (np.round(pixels).astype(np.int64) - self.corner).T
        height, width = self.parts.shape
        inside = (x >= 0) & (y >= 0) & (x < width) & (y < height)
        found: Integers = np.full(len(pixels), -1, dtype=np.int64)
        found[inside] = self.parts[y[inside], x[inside]]
        return found

    def inner(self, margin_px: int, trusted: Mask) -> Mask:
        """(H, W) pixels of trusted parts surrounded by the same part."""
        window = np.ones((2 * margin_px + 1,) * 2, dtype=np.uint8)
        same = cv2.erode(self.parts, window) == cv2.dilate(self.parts, window)
        inner: Mask = np.append(trusted, False)[self.parts] & same
        return inner


def seen_parts(scene: Scene, view: int) -> Shown:
    """The part of the scene at each pixel of a view, from a depth buffer of coarse surfaces.

    It takes 0.2 ms a view, as hulls of visible contours did; of their answers 2 % were wrong, 10 % at worst, and they
    had none on a chest whose outline two arms hide. Pixels at boundaries of parts are unreliable.

    Args:
        scene: persons at their poses; those with a skin by their parts.
        view: number of the view.
    """
    camera, meshes = scene.rig.cameras[view], meshes_of(scene.shapes, *_GRID)
    seen = np.empty((len(scene.shapes), 3, meshes.points.shape[1]))
    points, wanted = frozen(_GROWN * meshes.points), np.ones(len(scene.shapes), dtype=np.bool_)
    project_surfaces(scene.world_from_parts()[0], points, wanted, scene.rig.packed[view], seen)
    pixels = seen[~np.isnan(seen[:, 0, 0]), :2]
    if not len(pixels):
        return Shown(np.zeros(2, dtype=np.int64), np.full((1, 1), -1, dtype=np.int16))
    end = np.array(camera.size) - 1
    low = np.clip(np.floor(pixels.min(axis=(0, 2))), 0, end).astype(np.int64)
    high = np.clip(np.ceil(pixels.max(axis=(0, 2))), low, end).astype(np.int64)
    depths = np.zeros((high - low + 1)[::-1], dtype=np.float32)
    parts = np.full(depths.shape, -1, dtype=np.int16)
    draw_nearest(seen, meshes.triangles, (int(low[0]), int(low[1])), depths, parts)
    return Shown(low, parts)


Grey = NDArray[np.uint8]

_TO_AND_FRO_PX = 0.7
"""Largest error of a place followed there and back, px; beyond, it is another place."""

# Two levels, 11 px and 22 px of the image: wider windows reach across an arm, and points on it went with the trunk
# behind it (one start: 15.6 mm with four levels, 14.2 with two). See docs/lab/motion.md.
_LEVELS = 1
_ROUNDS = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 20, 0.02)

_STILL_PX = 1.0
"""A place no farther from its first position stands still, px."""

_CORNERS = 200
"""Most new places in a view at a time."""

_TEXTURE = 0.01
"""Least share of the best corner's texture (Shi & Tomasi 1994)."""


@dataclass(frozen=True)
class Anchors:
    """N places; a frozen value."""

    views: Integers
    """(N,) views whose images show them."""

    parts: Integers
    """(N,) parts of the scene that carry them; -1 for places that stand still before the persons."""

    surface: Array
    """(N, 9) place, metres, normal and the ray by which it was found, in the part's frame: see
    `tracker.kernels.rows.MetPlaceRow`."""

    depths_m: Array
    """(N,) standard deviation of the place along that ray, metres."""

    pixels: Array
    """(N, 2) positions in the last image."""

    origins: Array
    """(N, 2) first positions."""

    variances: Array
    """(N,) of `pixels`, px^2."""

    ahead: Array
    """(N, 2) movement of their parts in the last frame, px."""

    strikes: Integers
    """(N,) consecutive frames in which they disagreed with their parts."""

    @staticmethod
    def none() -> Anchors:
        """No place yet."""
        whole, pairs = np.zeros(0, dtype=np.int64), np.zeros((0, 2))
        return Anchors(
            whole, whole, np.zeros((0, MetPlaceRow.N_SURFACE)), np.zeros(0), pairs, pairs, np.zeros(0), pairs, whole
        )

    def joined(self, *others: Anchors) -> Anchors:
        """These and others."""
        every = (self, *others)
        return Anchors(*(np.concatenate([getattr(one, each.name) for one in every]) for each in fields(self)))

    def chosen(self, which: Mask | Integers) -> Anchors:
        """Some of them."""
        # of a mask the rows are looked for once, not in each of nine arrays
        rows = np.flatnonzero(which) if which.dtype == np.bool_ else which
        return Anchors(*(getattr(self, each.name).take(rows, axis=0) for each in fields(self)))

    @property
    def standing(self) -> Mask:
        """(N,) places still at their first positions."""
        found: Mask = np.linalg.norm(self.pixels - self.origins, axis=1) < _STILL_PX
        return found

    @cached_property
    def carried(self) -> Carried:
        """Their form for compiled kernels."""
        place, normal, ray = (
            np.ascontiguousarray(self.surface[:, k : k + 3])
            for k in (MetPlaceRow.X, MetPlaceRow.NORMAL_X, MetPlaceRow.RAY_X)
        )
        whole = np.ascontiguousarray(self.views), np.ascontiguousarray(self.parts)
        return Carried(*whole, place, normal, ray, self.depths_m, self.pixels, self.variances)

    def residuals(self, placements: Array, rig: Rig, slide_m: float) -> Array:
        """(N, 10) rows of `tracker.kernels.rows.CarriedPlaceRow`; parts (1, P, 4, 4) in the world."""
        found = np.empty((len(self.parts), CarriedPlaceRow.N_COLUMNS))
        residuals_of(placements, rig.packed, self.carried, slide_m, found)
        return found

    def shares(self, most: float) -> Array:
        """(N,) weights, so that those of a part in a view count as no more than `most`."""
        groups = self.parts * (int(self.views.max(initial=0)) + 1) + self.views
        shares: Array = np.minimum(1.0, most / np.bincount(groups)[groups]) if len(groups) else np.zeros(0)
        return shares

    def followed(self, view: int, before: Grey, now: Grey, window_px: int, drift_px: float) -> Anchors:
        """The places of a view in its next image; without hidden or mistaken ones.

        By Lucas and Kanade's method in a pyramid, there and back, from the positions that their parts predict (Bouguet
        2001).

        Args:
            view: number of the view.
            before, now: (H, W) images.
            window_px: side of the compared window, px.
            drift_px: standard deviation of one step, px.
        """
        own = self.chosen(self.views == view)
        if not len(own.parts):
            return own
        margin = 4 * window_px
        size = now.shape[::-1]
        ends = np.concatenate([own.pixels, own.pixels + own.ahead])
        low = np.clip(np.floor(ends.min(axis=0)).astype(int) - margin, 0, size)
        high = np.clip(np.ceil(ends.max(axis=0)).astype(int) + margin, 0, size)
        if (high - low).min() <= 2 * window_px:
            return own.chosen(np.zeros(len(own.parts), dtype=np.bool_))
        first, second = (np.ascontiguousarray(one[low[1] : high[1], low[0] : high[0]]) for one in (before, now))
        start = (own.pixels - low).astype(np.float32)[:, None]
        guess = start + own.ahead.astype(np.float32)[:, None]
        how = ((window_px, window_px), _LEVELS, _ROUNDS, cv2.OPTFLOW_USE_INITIAL_FLOW)
        there, seen, _ = cv2.calcOpticalFlowPyrLK(first, second, start, guess, None, None, *how)
        back, seen_back, _ = cv2.calcOpticalFlowPyrLK(second, first, there, start.copy(), None, None, *how)
        kept = (seen[:, 0] > 0) & (seen_back[:, 0] > 0)
        kept &= np.linalg.norm(back - start, axis=2)[:, 0] < _TO_AND_FRO_PX
        pixels = there[:, 0].astype(np.float64) + low
        return replace(own, pixels=pixels, variances=own.variances + drift_px**2).chosen(kept)


def corners(image: Grey, where: Mask, corner: Integers, taken: Array, spacing_px: int) -> Array:
    """(N, 2) pixels of textured places, apart from one another and from others (Shi & Tomasi 1994).

    Args:
        image: the whole one.
        where: (H, W) allowed pixels, in a box of it.
        corner: (2,) x and y of the box's first pixel.
        taken: (M, 2) the others, px.
        spacing_px: least distance.
    """
    if not where.any():
        return np.zeros((0, 2))
    free = where.astype(np.uint8)
    for place in (np.round(taken).astype(int) - corner).tolist():
        cv2.circle(free, place, spacing_px, 0, -1)
    (x, y), (height, width) = corner.tolist(), where.shape
    crop = np.ascontiguousarray(image[y : y + height, x : x + width])
    found = cv2.goodFeaturesToTrack(crop, _CORNERS, _TEXTURE, spacing_px, mask=free, blockSize=7)
    if found is None:
        return np.zeros((0, 2))
    pixels: Array = found[:, 0].astype(np.float64) + corner
    return pixels


def attached(
    scene: Scene, view: int, pixels: Array, parts: Integers, facing: float, sigmas: tuple[float, float]
) -> Anchors:
    """Places on parts where the rays of pixels meet them, except beside them and on slopes.

    Args:
        scene: persons at their poses.
        view: number of the view.
        pixels: (N, 2) of its image.
        parts: (N,) parts seen there.
        facing: least cosine between normal and ray.
        sigmas: standard deviations of the surface along its normal, metres, and of a pixel, px.
    """
    camera, found = scene.rig.cameras[view], np.zeros((len(parts), MetPlaceRow.N_COLUMNS))
    placed = scene.world_from_parts()[0]
    meet_parts(placed, scene.shapes, camera.centre, camera.rays(pixels), parts, found)
    kept = found[:, MetPlaceRow.FACING] >= facing
    found, pixels, parts = found[kept], pixels[kept], parts[kept]
    n = len(parts)
    return Anchors(
        np.full(n, view),
        parts,
        found[:, : MetPlaceRow.N_SURFACE],
        sigmas[0] / found[:, MetPlaceRow.FACING],
        pixels,
        pixels,
        np.full(n, sigmas[1] ** 2),
        np.zeros((n, 2)),
        np.zeros(n, dtype=np.int64),
    )
