"""What is found of the points in a frame before it becomes their own, and what must be true of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, Image, Integers, Mask
from tracker.kernels.adjustment import intersect_rays
from tracker.kernels.patches import bending_shifts
from tracker.points.following.following import Following
from tracker.points.following.keys import Keys, Sighting, Starts, find_keys
from tracker.points.following.points import N_NEAREST, Points, carried, expected
from tracker.points.surfaces import PatchImage
from tracker.points.trajectories import PointStatus


@dataclass(frozen=True)
class Prepared:
    """The images of a frame, ready to be followed in; None for views without one."""

    index: int
    """Number of the frame."""

    images: tuple[PatchImage | None, ...]

    greys: tuple[Image | None, ...]
    """(h, w) 8 bit."""

    @property
    def seen(self) -> tuple[int, ...]:
        """Views that have an image."""
        return tuple(v for v, image in enumerate(self.images) if image is not None)


@dataclass(frozen=True)
class NewKeys:
    """Keys of a view that become the points' own if these are accepted."""

    view: int
    rows: Integers
    keys: Keys

    drift: Array
    """(M, 3) px^2."""

    from_birth: Array
    """(M, 2, 2)"""

    cut_in: Integers
    """(M,) frame numbers of the images that they were cut from."""

    bending: Array
    """(M, 2) px, see `Points.key_bending`."""

    def select(self, which: Mask) -> NewKeys:
        """The chosen ones."""
        rows, keys, bending = self.rows[which], self.keys.select(which), self.bending[which]
        return NewKeys(self.view, rows, keys, self.drift[which], self.from_birth[which], self.cut_in[which], bending)


class Sightings:
    """What is found of N points in a frame. Filled step by step, then committed."""

    def __init__(self, following: Following, rig: Rig, points: Points, previous: Prepared, present: Prepared) -> None:
        self.following, self.rig, self.points = following, rig, points
        self.previous, self.present = previous, present
        n, n_views = len(points), points.n_views
        self.was_alive = points.alive.copy()
        self.pixels = np.full((n_views, n, 2), np.nan)
        self.affine = points.affine.copy()
        self.variances = np.full((n_views, n, 3), np.nan)
        self.drift = points.drift.copy()
        self.positions = points.positions.copy()
        self.covariances = np.full((n, 3, 3), np.nan)
        self.bending = np.full((n_views, n, 2), np.nan)
        self.status = np.where(points.alive, PointStatus.FOLLOWED, PointStatus.HIDDEN).astype(np.int64)
        self.new_keys: list[NewKeys] = []

    @property
    def alive(self) -> Mask:
        """(N,) points that are taken to be seen."""
        alive: Mask = self.status != PointStatus.HIDDEN
        return alive

    @property
    def seen(self) -> Mask:
        """(V, N) where the points were found."""
        seen: Mask = np.isfinite(self.pixels[..., 0])
        return seen

    @property
    def too_few(self) -> Mask:
        """(N,) points that fewer views show than must."""
        few: Mask = self.seen.sum(axis=0) < self.following.needed(self.points)
        return few

    def put(self, view: int, rows: Integers, sighting: Sighting) -> None:
        """Takes over what was found of some points in a view."""
        own = sighting.good
        self.pixels[view, rows[own]] = sighting.pixels[own]
        self.affine[view, rows[own]] = sighting.affine[own]
        self.variances[view, rows[own]] = sighting.variances[own]

    def hide(self, rows: Integers | Mask) -> None:
        """The points are not seen; what other keys may find of them has nothing to do with the new keys so far."""
        self.pixels[:, rows] = np.nan
        self.status[rows] = PointStatus.HIDDEN
        hidden = np.zeros(len(self.status), dtype=np.bool_)
        hidden[rows] = True
        self.new_keys = [new.select(~hidden[new.rows]) for new in self.new_keys]

    def intersect(self, rows: Integers) -> Array:
        """Positions of the points that enough views show.

        Returns:
            RMS of the reprojection (M,) px, infinite where too few views show a point; 0 in 2-D mode.
        """
        few = self.too_few[rows]
        if self.points.n_views == 1:
            return np.where(few, np.inf, 0.0)
        variances = carried(self.drift[:, rows], self.affine[:, rows]) + self.variances[:, rows]
        pixels = np.where(few[:, None], np.nan, self.pixels[:, rows])
        positions, covariances, residuals = self.positions[rows], np.zeros((len(rows), 3, 3)), np.zeros(len(rows))
        unknown = ~np.isfinite(positions[:, 0])
        if unknown.any():
            positions[unknown] = self.rig.triangulate(pixels[:, unknown])[0]
        before = positions.copy()
        # one memory layout, and so one compiled kernel
        pixels, variances = np.ascontiguousarray(pixels), np.ascontiguousarray(variances)
        intersect_rays(self.rig.packed, pixels, variances, positions, covariances, residuals)
        good = np.isfinite(residuals)
        self.positions[rows] = np.where(good[:, None], positions, before)
        self.covariances[rows] = covariances
        return residuals

    def correct_curvature(self) -> None:
        """Shifts what was found from the means of the patches to the points; see `bending_shifts`.

        A key that was cut after the birth knows nothing of the curvature before: only what has grown since counts.
        """
        points, seen = self.points, self.seen
        rows = points.rows_of(points.neighbours[:, :N_NEAREST])
        from_birth = self.affine @ self.key_from_birth
        half = self.following.matching.patch_px // 2
        for v in range(points.n_views):
            offsets = points.neighbour_pixels[v, :, :N_NEAREST] - points.birth_pixels[v][:, None]
            shifts = bending_shifts(offsets, rows, from_birth[v], seen[v], half)
            self.bending[v] = np.where(shifts.any(axis=1, keepdims=True), shifts, np.nan)
        of_key = points.key_bending.copy()
        for new in self.new_keys:
            of_key[new.view, new.rows] = new.bending
        self.pixels -= np.nan_to_num(self.bending - np.einsum("vnij,vnj->vni", self.affine, of_key))
        self.intersect(np.flatnonzero(self.alive))

    @property
    def key_from_birth(self) -> Array:
        """(V, N, 2, 2) of the keys that the points were found by."""
        from_birth = self.points.key_from_birth.copy()
        for new in self.new_keys:
            from_birth[new.view, new.rows] = new.from_birth
        return from_birth

    def commit(self) -> None:
        """What was found becomes the points' own."""
        points, seen = self.points, self.seen
        for new in self.new_keys:
            kept = self.alive[new.rows] & seen[new.view, new.rows]
            rows = new.rows[kept]
            points.keys[new.view].put(rows, new.keys.select(kept))
            points.drift[new.view, rows] = new.drift[kept]
            points.key_from_birth[new.view, rows] = new.from_birth[kept]
            points.keys_in[new.view, rows] = new.cut_in[kept]
            points.key_bending[new.view, rows] = new.bending[kept]
        points.before, points.pixels = points.pixels, self.pixels
        points.last_pixels = np.where(seen[..., None], self.pixels, points.last_pixels)
        points.affine = np.where(seen[..., None, None], self.affine, points.affine)
        points.variances = np.where(seen[..., None], self.variances, points.variances)
        points.bending = np.where(seen[..., None], self.bending, points.bending)
        points.positions = np.where(self.alive[:, None], self.positions, points.positions)
        points.status, points.latest = self.status, self.present.index
        points.since = np.where(self.alive, 0, points.since + 1)


# What must be true of a point before it counts as seen: meeting rays, agreeing views, neighbours not surprised.

# What two views that found the same point may differ by: a choice.
_PROJECTED_PX = 1.5


def accept_followed(sightings: Sightings) -> None:
    """Hides living points that too few views show, whose rays miss one another, or whose new key is not the point."""
    rows = np.flatnonzero(sightings.alive)
    residuals = sightings.intersect(rows)
    sightings.hide(rows[~(residuals <= sightings.following.max_residual_px)])
    if sightings.following.template == "previous":
        # the paper's test of every point in every frame (figure 7)
        rows = np.flatnonzero(sightings.alive)
        sightings.hide(rows[_differs_across(sightings, rows)])
        return
    rows = np.flatnonzero(sightings.status == PointStatus.REKEYED)
    if len(rows):
        sightings.hide(rows[_surprising(sightings, rows) | _differs_across(sightings, rows)])


def accept_found(sightings: Sightings, rows: Integers) -> None:
    """Takes over hidden points that enough views show again and whose rays meet."""
    residuals = sightings.intersect(rows)
    good = residuals <= sightings.following.max_residual_px
    sightings.hide(rows[~good])
    found = rows[good]
    again = ~sightings.was_alive[found]
    sightings.status[found] = np.where(again, PointStatus.FOUND_AGAIN, PointStatus.FOLLOWED)


def _surprising(sightings: Sightings, rows: Integers) -> Mask:
    """(M,) points that neighbours expect elsewhere, in any view; lonely points surprise nobody."""
    surprising = np.zeros(len(rows), dtype=np.bool_)
    for v in range(sightings.points.n_views):
        expectation = expected(sightings.points, sightings.pixels, rows, v).pixels
        gaps = np.linalg.norm(sightings.pixels[v, rows] - expectation, axis=1)
        surprising |= gaps > sightings.following.max_surprise_px
    return surprising


def _differs_across(sightings: Sightings, rows: Integers) -> Mask:
    """(M,) points that are elsewhere in a view when matched with another view (spatial LSM; paper, figure 7)."""
    following, points = sightings.following, sightings.points
    differs = np.zeros(len(rows), dtype=np.bool_)
    seen = sightings.seen[:, rows]
    looks = sightings.affine @ sightings.key_from_birth @ points.across
    first = seen.argmax(axis=0)
    for t in range(points.n_views):
        image = sightings.present.images[t]
        for v in range(t + 1, points.n_views):
            own = np.flatnonzero((first == t) & seen[t] & seen[v])
            search = sightings.present.images[v]
            if image is None or search is None or not len(own):
                continue
            keys = Keys.cut(image, sightings.pixels[t, rows[own]], following.matching.patch_px // 2)
            affine = looks[v, rows[own]] @ np.linalg.inv(looks[t, rows[own]])
            place = sightings.pixels[v, rows[own]]
            starts = Starts(place, affine)
            found = find_keys(following.matching, following.quality, keys, np.arange(len(own)), search, starts=starts)
            differs[own] |= ~(np.linalg.norm(found.pixels - place, axis=1) <= following.max_across_px)
    return differs


def look_where_projected(sightings: Sightings) -> None:
    """Views that missed a point which others have placed in space: at its projection, with the key it has."""
    following, points = sightings.following, sightings.points
    if points.n_views < 3:
        return
    for v, camera in enumerate(sightings.rig.cameras):
        image = sightings.present.images[v]
        rows = np.flatnonzero(sightings.alive & points.keys[v].usable & ~sightings.seen[v])
        if image is None or not len(rows):
            continue
        place = camera.project(sightings.positions[rows])
        starts = Starts(place, points.affine[v, rows])
        found = find_keys(following.matching, following.quality, points.keys[v], rows, image, starts=starts)
        near = np.linalg.norm(found.pixels - place, axis=1) <= _PROJECTED_PX
        rows = rows[near]
        sightings.put(v, rows, found.select(near))
        worse = ~(sightings.intersect(rows) <= following.max_residual_px)
        sightings.pixels[v, rows[worse]] = np.nan
        sightings.intersect(rows[worse])
