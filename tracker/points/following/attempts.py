"""The attempts to see a point in the next frame, in the order in which they are made."""

from __future__ import annotations

import numpy as np

from tracker.foundation.arrays import Array, Integers
from tracker.points.following.checks import accept_found
from tracker.points.following.keys import Keys, Starts, find_keys
from tracker.points.following.neighbours import expected
from tracker.points.following.points import carried
from tracker.points.following.scouts import chosen_scouts, correlated_keys, far_expectation
from tracker.points.following.sightings import NewKeys, Sightings
from tracker.points.following.starts import correlated, flow, led, predicted
from tracker.points.trajectories import PointStatus

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
    """Hidden points are looked for where their neighbours expect them; those found are neighbours of the next round."""
    lonely = _look_where_expected(sightings)
    scouts = chosen_scouts(sightings.points, lonely)
    if len(scouts):
        _send(sightings, scouts)
        if sightings.alive[scouts].any():
            _look_where_expected(sightings)


def _look_where_expected(sightings: Sightings) -> Integers:
    """Returns the rows of those that nobody expects anywhere."""
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

    What that finds must be checked by other views. A view alone looks for them where they were seen last.
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
