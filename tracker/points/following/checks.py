"""What must be true of a point before it counts as seen: meeting rays, agreeing views, neighbours not surprised."""

from __future__ import annotations

import numpy as np

from tracker.foundation.arrays import Integers, Mask
from tracker.points.following.keys import Keys, Starts, find_keys
from tracker.points.following.neighbours import expected
from tracker.points.following.sightings import Sightings
from tracker.points.trajectories import PointStatus

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
