"""The attempts to see a point in the next frame, in the order in which they are made."""

from __future__ import annotations

import cv2
import numpy as np
from scipy.spatial import cKDTree

from tracker.foundation.arrays import Array, Array32, Integers
from tracker.kernels.patches import key_side
from tracker.points.following.keys import Keys, Starts, correlated, find_keys, flow, led, predicted
from tracker.points.following.points import Points, carried, expected
from tracker.points.following.sightings import NewKeys, Sightings, accept_found
from tracker.points.surfaces import PatchImage
from tracker.points.trajectories import PointStatus

# So many hidden points are tried a frame, for speed; each with the motion of 24 seen ones, at least the six of an
# affinity.
_N_SCOUTS, _N_FAR, _LEAST_FAR = 200, 24, 6
# A hidden surface moves on unseen: what correlation may find it within.
_REACH_PX = 20
# A choice: a start only, matching decides.
_LEAST_CORRELATION = 0.7
_SPLINE = np.array([1, 4, 1], dtype=np.float64) / 6
"""Grey values of cubic B-spline coefficients at whole pixels."""


def chosen_scouts(points: Points, lonely: Integers) -> Integers:
    """Rows of no more than 200 hidden points, others in every frame, but the same when a run is resumed."""
    order = np.argsort(((points.ids[lonely] + 7919 * points.since[lonely]) * 2654435761) % 2**32, kind="stable")
    return lonely[order[:_N_SCOUTS]]


def far_expectation(points: Points, pixels: Array, rows: Integers, view: int) -> Starts:
    """Where the nearest points that are seen, however far, expect some points; their last places where none is seen.

    Args:
        points: all points.
        pixels: (V, N, 2) where they are now, px; NaN where not seen.
        rows: (M,) the points asked for.
        view: index of the view.
    """
    places = points.last_pixels[view, rows].copy()
    affine = points.affine[view, rows] @ points.key_from_birth[view, rows]
    born = points.birth_pixels[view]
    seen = np.flatnonzero(np.isfinite(pixels[view, :, 0]) & np.isfinite(born[:, 0]))
    asked = np.flatnonzero(np.isfinite(born[rows, 0]))
    if len(seen) < _LEAST_FAR or not len(asked):
        return Starts(places, affine)
    _, near = cKDTree(born[seen]).query(born[rows[asked]], k=min(_N_FAR, len(seen)))
    near = seen[np.asarray(near)]
    offset = born[near] - born[rows[asked]][:, None]
    design = np.concatenate([offset, np.ones((*offset.shape[:2], 1))], axis=2)
    normal = np.einsum("nki,nkj->nij", design, design)
    # Held towards a shift: far points on one side tell little of turns and stretches.
    normal += np.diag([1.0, 1.0, 0.0]) * (1.0 + np.trace(normal, axis1=1, axis2=2) / 3)[:, None, None] * 0.1
    moved = pixels[view][near] - offset
    solution = np.linalg.solve(normal, np.einsum("nki,nkj->nij", design, moved - moved.mean(axis=1, keepdims=True)))
    places[asked] = solution[:, 2] + moved.mean(axis=1)
    return Starts(places, affine)


def correlated_keys(keys: Keys, rows: Integers, image: PatchImage, start: Array, half: int) -> Array:
    """Places (M, 2) px of the best cross-correlation of key patches around each start; NaN where it is poor."""
    found = np.full(start.shape, np.nan)
    width, height = image.size
    grey = _grey(image.coefficients.reshape(height, width))
    side, wide = key_side(half), half + _REACH_PX
    for k in np.flatnonzero(keys.usable[rows] & np.isfinite(start).all(axis=1)).tolist():
        u, v = np.round(start[k]).astype(int)
        if not (wide <= u < width - wide and wide <= v < height - wide):
            continue
        patch = _grey(keys.patches[rows[k]].reshape(side, side))[2:-2, 2:-2]
        box = grey[v - wide : v + wide + 1, u - wide : u + wide + 1]
        correlation = cv2.matchTemplate(box, np.ascontiguousarray(patch), cv2.TM_CCOEFF_NORMED)
        row, column = divmod(int(correlation.argmax()), 2 * _REACH_PX + 1)
        if correlation[row, column] >= _LEAST_CORRELATION:
            found[k] = keys.offsets[rows[k]] + (u - _REACH_PX + column, v - _REACH_PX + row)
    return found


def _grey(coefficients: Array32) -> Array32:
    grey: Array32 = cv2.sepFilter2D(coefficients, -1, _SPLINE, _SPLINE, borderType=cv2.BORDER_REFLECT_101)
    return grey


# Each carries points one neighbour further: six reach across a gap of twelve points.
_ROUNDS = 6


def look_for_keys(sightings: Sightings) -> None:
    """Every living point in every view against its own key, and once more from another start where that fails."""
    following, points = sightings.following, sightings.points
    if following.template == "previous":
        _take_previous_keys(sightings, np.flatnonzero(points.alive))
    for v in range(points.n_views):
        image = sightings.present.images[v]
        if image is None or sightings.previous.images[v] is None:
            continue
        linear = predicted(points.pixels[v], points.before[v])
        for attempt in range(2):
            rows = _missed(sightings, v)
            if len(rows):
                start = _started(sightings, v, rows, linear[rows], attempt)
                starts = Starts(start, sightings.affine[v, rows])
                found = find_keys(following.matching, following.quality, points.keys[v], rows, image, starts=starts)
                sightings.put(v, rows, found)


def _missed(sightings: Sightings, view: int) -> Integers:
    """Living points that a view showed in the frame before and has not shown yet."""
    was = np.isfinite(sightings.points.pixels[view, :, 0])
    return np.flatnonzero(sightings.alive & was & ~sightings.seen[view])


def _started(sightings: Sightings, view: int, rows: Integers, linear: Array, attempt: int) -> Array:
    following, points = sightings.following, sightings.points
    before, now = sightings.previous.greys[view], sightings.present.greys[view]
    assert before is not None
    assert now is not None
    pixels = points.pixels[view, rows]
    if following.start == "correlation":
        found = correlated(before, now, pixels, linear, following.search_px * (attempt + 1))
    elif attempt == 0:
        found = led(before, now, pixels, linear, points.ids[rows])
    else:
        found = flow(before, now, pixels, linear)
    return np.where(np.isfinite(found), found, linear)


def _take_previous_keys(sightings: Sightings, rows: Integers) -> None:
    """The paper's way: each point is known by its patch in the frame before."""
    points = sightings.points
    for v in range(points.n_views):
        new = _keys_of_previous(sightings, v, rows)
        if new is not None:
            points.keys[v].put(new.rows, new.keys)
            points.drift[v, new.rows] = sightings.drift[v, new.rows] = new.drift
            points.key_from_birth[v, new.rows] = new.from_birth
            points.keys_in[v, new.rows], points.key_bending[v, new.rows] = new.cut_in, new.bending
            points.affine[v, new.rows] = sightings.affine[v, new.rows] = np.eye(2)
            points.variances[v, new.rows] = 0.0


def _keys_of_previous(sightings: Sightings, view: int, rows: Integers) -> NewKeys | None:
    """Keys cut from the frame before; their uncertainty is that of the old ones and of the match in that frame."""
    points, image = sightings.points, sightings.previous.images[view]
    if image is None:
        return None
    keys = Keys.cut(image, points.pixels[view][rows], sightings.following.matching.patch_px // 2)
    rows, keys = rows[keys.usable], keys.select(keys.usable)
    affine = points.affine[view, rows]
    drift = carried(points.drift[view, rows], affine) + points.variances[view, rows]
    cut_in = np.full(len(rows), sightings.previous.index)
    from_birth = affine @ points.key_from_birth[view, rows]
    return NewKeys(view, rows, keys, drift, from_birth, cut_in, points.bending[view, rows])


def look_for_previous(sightings: Sightings) -> None:
    """Points that too few views show so far are matched with the frame before, which may give them new keys."""
    following = sightings.following
    if following.template == "previous":
        return
    few = sightings.too_few
    for v in range(sightings.points.n_views):
        rows, image = _missed(sightings, v), sightings.present.images[v]
        rows = rows[few[rows]]
        new = _keys_of_previous(sightings, v, rows) if len(rows) else None
        if new is None or image is None or not len(new.rows):
            continue
        linear = predicted(sightings.points.pixels[v, new.rows], sightings.points.before[v, new.rows])
        starts = Starts(_started(sightings, v, new.rows, linear, 1), np.tile(np.eye(2), (len(new.rows), 1, 1)))
        own = np.arange(len(new.rows))
        found = find_keys(following.matching, following.quality, new.keys, own, image, starts=starts)
        sightings.put(v, new.rows, found)
        good = found.good
        rows = new.rows[good]
        sightings.drift[v, rows] = new.drift[good]
        sightings.status[rows] = PointStatus.REKEYED
        sightings.new_keys.append(new.select(good))


def look_again(sightings: Sightings) -> None:
    """Hidden points are searched where their neighbours expect them; those found are neighbours of the next round."""
    lonely = _look_where_expected(sightings)
    scouts = chosen_scouts(sightings.points, lonely)
    if len(scouts):
        _send(sightings, scouts)
        if sightings.alive[scouts].any():
            _look_where_expected(sightings)


def _look_where_expected(sightings: Sightings) -> Integers:
    """Returns the rows of those that no neighbour expects."""
    points, tried = sightings.points, np.zeros(len(sightings.points), dtype=np.bool_)
    for _ in range(_ROUNDS):
        rows = np.flatnonzero(~sightings.alive & ~tried)
        expectations = [expected(points, sightings.pixels, rows, v) for v in range(points.n_views)]
        usable = np.stack([points.birth_keys[v].usable[rows] for v in range(points.n_views)])
        known = np.stack([np.isfinite(expectation.pixels[:, 0]) for expectation in expectations])
        own = np.flatnonzero((known & usable).sum(axis=0) >= sightings.following.needed(points)[rows])
        if not len(own):
            break
        tried[rows[own]] = True
        _look_for_hidden(sightings, rows[own], [expectation.select(own) for expectation in expectations])
    return np.flatnonzero(~sightings.alive & ~tried)


def _send(sightings: Sightings, rows: Integers) -> None:
    """Looks for points that are far from all others: first by correlation in a wide box.

    Other views must check these. A view alone looks for them where they were seen last.
    """
    points, half = sightings.points, sightings.following.matching.patch_px // 2
    starts = []
    for v, image in enumerate(sightings.present.images):
        start = far_expectation(points, sightings.pixels, rows, v)
        if points.n_views == 1:
            starts.append(Starts(points.last_pixels[v, rows], start.affine))
            continue
        place = np.full_like(start.pixels, np.nan)
        if image is not None:
            place = correlated_keys(points.birth_keys[v], rows, image, start.pixels, half)
        starts.append(Starts(place, start.affine))
    _look_for_hidden(sightings, rows, starts)


def _look_for_hidden(sightings: Sightings, rows: Integers, expectations: list[Starts]) -> None:
    """By their keys of birth, then by the latest ones where these are others."""
    points = sightings.points
    unit = (points.key_from_birth[:, rows] == np.eye(2)).all(axis=(0, 2, 3))
    for of_birth in (True, False):
        own = np.flatnonzero(~sightings.alive[rows] & (of_birth | ~unit))
        for v in range(points.n_views):
            _look_expected(sightings, v, rows[own], expectations[v].select(own), of_birth)
        accept_found(sightings, rows[own])


def _look_expected(sightings: Sightings, view: int, rows: Integers, expectation: Starts, of_birth: bool) -> None:
    following, points, image = sightings.following, sightings.points, sightings.present.images[view]
    if image is None or not len(rows):
        return
    if of_birth:
        keys, drift, starts = points.birth_keys[view], points.birth_drift[view, rows], expectation
    else:
        keys, drift = points.keys[view], points.drift[view, rows]
        affine = expectation.affine @ np.linalg.inv(points.key_from_birth[view, rows])
        starts = Starts(expectation.pixels, affine)
    found = find_keys(following.matching, following.quality, keys, rows, image, starts=starts)
    near = np.linalg.norm(found.pixels - expectation.pixels, axis=1) <= following.max_surprise_px
    sightings.drift[view, rows] = drift
    sightings.put(view, rows[near], found.select(near))
    if of_birth:
        unit = np.tile(np.eye(2), (int(near.sum()), 1, 1))
        own = keys.select(rows[near]), drift[near], unit, points.born[rows[near]], np.zeros((len(unit), 2))
        sightings.new_keys.append(NewKeys(view, rows[near], *own))
