"""By how many frames views are late: the delays at which planes that touch foregrounds agree best in all views."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, Integers, Mask

_AT_BORDER_RAD = 1e-3
"""A plane that touches what the border of the image cuts, to so much, does not touch the person there."""

Tangents = dict[tuple[int, int], Array]
"""Two views -> (2, T, 2): in each of them, in each frame, the angles of the first and the last plane that touch."""


def tangents(rig: Rig, regions: Sequence[Sequence[Mask | None]], factor: int) -> Tangents:
    """Angles of the epipolar planes that touch the foregrounds, for all pairs of views, radians.

    A point of the surface where such a plane touches it is on the outline of both views (a frontier point), so that the
    angles of both views are the same at the same moment, whatever moves (Sinha & Pollefeys 2004).

    Args:
        rig: V cameras of the whole images.
        regions: T x V small foregrounds (h, w); None where nothing is shown.
        factor: pixels of an image to one of a region.

    Returns:
        NaN where nothing is shown, where the border of the image cuts it, and where a camera is seen inside.
    """
    pixels = [[None if region is None else np.flatnonzero(region) for region in row] for row in regions]
    shapes = [next((shown.shape for row in regions if (shown := row[v]) is not None), None) for v in range(len(rig))]
    rays = [None if shape is None else _rays(rig, v, shape, factor) for v, shape in enumerate(shapes)]
    found: Tangents = {}
    for one, other in itertools.combinations(range(len(rig)), 2):
        across = _across(rig, one, other)
        ends = np.full((2, len(regions), 2), np.nan)
        for k, v in enumerate((one, other)):
            if (shape := shapes[v]) is not None and (directions := rays[v]) is not None:
                angles = np.arctan2(directions @ across[1], directions @ across[0])
                border = _border(shape)
                for t, row in enumerate(pixels):
                    if (numbers := row[v]) is not None:
                        ends[k, t] = _touching(angles, numbers, border)
        found[one, other] = ends
    return found


def _rays(rig: Rig, view: int, shape: tuple[int, ...], factor: int) -> Array:
    """Directions (h * w, 3) in the world of the pixels of a small image."""
    rows, columns = np.mgrid[: shape[0], : shape[1]]
    pixels = np.stack([columns, rows], axis=-1).reshape(-1, 2) * factor + (factor - 1) / 2
    return rig.cameras[view].rays(pixels, clamped=True)


def _across(rig: Rig, one: int, other: int) -> Array:
    """Two directions (2, 3) across the line of two cameras; the first one shows to where all cameras look."""
    centres = rig.cameras[one].centre, rig.cameras[other].centre
    along = (centres[1] - centres[0]) / np.linalg.norm(centres[1] - centres[0])
    aside = rig.middle - centres[0]
    aside = aside - along * (aside @ along)
    aside /= np.linalg.norm(aside)
    return np.stack([aside, np.cross(along, aside)])


def _border(shape: tuple[int, ...]) -> Mask:
    border = np.ones(shape, dtype=np.bool_)
    border[1:-1, 1:-1] = False
    return border.ravel()


def _touching(angles: Array, shown: Integers, border: Mask) -> tuple[float, float]:
    """The first and the last angle of some pixels; NaN where the border cuts them off, or they lie all around."""
    seen = angles[shown]
    first, last = float(seen.min()), float(seen.max())
    if last - first > np.pi:
        return np.nan, np.nan
    cut = seen[border[shown]]
    if len(cut):
        first = np.nan if cut.min() <= first + _AT_BORDER_RAD else first
        last = np.nan if cut.max() >= last - _AT_BORDER_RAD else last
    return first, last


_LIKE_FRAMES = 6.0
"""Neighbouring frames that tell as much as one: what is wrong about a foreground lasts."""

_LEAST_FRAMES = 30
"""Of both views from which a delay is told. By 24 frames of who walks on the spot, 12.5 a second, a view in step was
moved by half a stride."""

_MOST_FRAMES = 60
"""That a delay is looked for: two seconds of a usual camera, and one of a quick one."""

_LEAST_MISS = 0.02
"""Share of the usual miss below which a smaller one tells no more."""

_SURE_NATS = 5.0
"""By how much a delay has to be more likely than any other, for views to be tied by it. See docs/lab/in_step.md."""

_APART_FRAMES = 2
"""Of other delays in this sense; a frame more or less is for `_MOVED_NATS` to tell."""

_MOVED_NATS = 6.0
"""By how much the delays of a view have to be more likely than none. Of 94 sets of views in step, of those that are
tied, none had more than 3.5."""

_USUAL_FRAMES = 5.0
"""Delays are likely up to some of these, beforehand; of ten times as much one in ten is."""

_PART_FRAMES, _PART_NATS = 0.4, 3.0
"""Parts of a frame that are told, and by how much more likely. In step, with plates, up to 0.38 were found."""

_FINE, _FINE_REACH = 0.125, 1.5
"""Of a frame: how finely parts are looked for, and up to how many frames to either side."""

_CHANGE_NATS = 6.0
"""By how much a change of delay has to make frames more likely."""

_MOST_CHANGE = 5
"""Frames by which a delay is tried to change at a time."""

_MOST_MISSES = 6.0
"""Usual misses at which a single frame counts no more."""

_ROUNDS = 10
"""In which delays of single views are found with the others held; few are needed."""


@dataclass(frozen=True)
class Delays:
    """Delays of V views in T frames."""

    late: Integers
    """(V, T) by how many whole frames a view is late against most of them; 0 where that is not told."""

    part: Array
    """(V,) by what part of a frame it is late on top of it; 0 where none is told."""

    told: Mask
    """(V,) whether a view moves alike with most others, so that its delay is told."""


def delays_of(found: Tangents, n_views: int, reach: int | None = None) -> Delays:
    """The most likely delays.

    The misses of a pair of views are of one scale that is not known (Laplace), so that a delay at which they are a
    third of the usual ones is n log 3 nats more likely in n frames; what does not move is missed alike at any delay.

    Args:
        found: angles of planes that touch; see `tracker.images.inspection._delays.tangents`.
        n_views: V.
        reach: frames that are tried to both sides; None for half of all, up to `_MOST_FRAMES`.
    """
    n_frames = next(iter(found.values())).shape[1] if found else 0
    reach = min(n_frames // 2, _MOST_FRAMES) if reach is None else reach
    none = Delays(np.zeros((n_views, n_frames), dtype=np.int64), np.zeros(n_views), np.zeros(n_views, dtype=np.bool_))
    if n_frames < _LEAST_FRAMES or reach < 1:
        return none
    smooth = {pair: _smoothed(ends) for pair, ends in found.items()}
    tried = np.arange(-reach, reach + 1, dtype=np.float64)
    likely = _Likely(_nats(smooth, n_views, tried), tried)
    late, told = likely.tied()
    if not told.any():
        return none
    late = _only_sure(likely, likely.settled(late, told, tried), told)
    told &= np.abs(late) < reach - 1  # what is likeliest may lie beyond
    late = np.where(told, late, 0.0)
    path = _changing(smooth, np.repeat(late[:, None], n_frames, axis=1), told)
    changes = (path != path[:, :1]).any()
    part = np.zeros(n_views) if changes else _parts(smooth, late, told)
    return Delays(_beside_most(path, told), part, told)


@dataclass(frozen=True)
class _Likely:
    """How likely delays are."""

    nats: Array
    """(V, V, D) of each pair, with the first view late by each delay against the second one."""

    tried: Array
    """(D,) the delays, frames, evenly spaced."""

    def of_view(self, view: int, late: Array, others: Mask, tried: Array) -> Array:
        """(N,) nats of a view at delays (N,), beside other views at theirs (V,)."""
        nats, step = np.zeros(len(tried)), self.tried[1] - self.tried[0]
        for u in _numbers(others):
            places = np.round((tried - late[u] - self.tried[0]) / step).astype(np.int64)
            inside = (places >= 0) & (places < len(self.tried)) & (u != view)
            nats += np.where(inside, self.nats[view, u, np.clip(places, 0, len(self.tried) - 1)], 0.0)
        return nats

    def tied(self) -> tuple[Array, Mask]:
        """Delays (V,) of the views that are tied to each other beyond doubt, and which (V,) these are.

        The pair that is tied best, then whichever view is tied best to all that are.
        """
        n_views = len(self.nats)
        late, told = np.zeros(n_views), np.zeros(n_views, dtype=np.bool_)
        sure = [[_surely(self.nats[u, v], self.tried) for v in range(n_views)] for u in range(n_views)]
        one, other = max(((u, v) for u in range(n_views) for v in range(u)), key=lambda uv: sure[uv[0]][uv[1]][1])
        if sure[one][other][1] < _SURE_NATS:
            return late, told
        late[one], told[one], told[other] = sure[one][other][0], True, True
        while not told.all():
            wide = np.arange(2 * self.tried[0], 2 * self.tried[-1] + 1)
            found = {v: _surely(self.of_view(v, late, told, wide), wide) for v in _numbers(~told)}
            v = max(found, key=lambda v: found[v][1])
            if found[v][1] < _SURE_NATS:
                break
            late[v], told[v] = found[v][0], True
        return late, told

    def settled(self, late: Array, told: Mask, tried: Array) -> Array:
        """Delays (V,) that no single view's would make more likely."""
        late = np.array(late)
        for _ in range(_ROUNDS):
            before = late.copy()
            for v in _numbers(told):
                near = late[v] + tried
                late[v] = near[np.argmax(self.of_view(v, late, told, near) - 1e-9 * np.abs(near))]
            if (late == before).all():
                break
        return late


def _numbers(chosen: Mask) -> list[int]:
    found: list[int] = np.flatnonzero(chosen).tolist()
    return found


def _surely(nats: Array, tried: Array) -> tuple[float, float]:
    """The most likely delay, and by how many nats it is more likely than any that is not next to it."""
    nats = nats - np.log1p(np.abs(tried) / _USUAL_FRAMES)
    best = int(np.argmax(nats))
    if best in (0, len(tried) - 1):
        return float(tried[best]), 0.0  # what is best may lie beyond
    others = nats[np.abs(tried - tried[best]) >= _APART_FRAMES]
    return float(tried[best]), float(nats[best] - max(others.max(initial=0.0), 0.0))


def _only_sure(likely: _Likely, late: Array, told: Mask) -> Array:
    """Delays (V,) beside most views; none of views for which that is hardly less likely."""
    late = late - _most(late, told)
    for v in _numbers(told & (late != 0)):
        here, none = likely.of_view(v, late, told, np.array([late[v], 0.0]))
        if here - none < _MOVED_NATS:
            late[v] = 0.0
    return np.where(told, late, 0.0)


def _most(late: Array, told: Mask) -> float:
    """The delay that most told views have; of as many the first view's."""
    values = late[told]
    return float(max(values, key=lambda one: np.count_nonzero(values == one))) if len(values) else 0.0


def _beside_most(path: Array, told: Mask) -> Integers:
    """(V, T) whole delays beside what most views have in each frame."""
    beside = [np.where(told, late - _most(late, told), 0.0) for late in path.T]
    return np.stack(beside, axis=1).astype(np.int64)


def _smoothed(ends: Array) -> Array:
    """Angles (2, T, 2) over three frames, so that those between two frames are hardly smoother."""
    smooth: Array = np.array(ends)
    smooth[:, 1:-1] = 0.25 * ends[:, :-2] + 0.5 * ends[:, 1:-1] + 0.25 * ends[:, 2:]
    return smooth


def _at(track: Array, times: Array) -> Array:
    """A track (T,) at times (N,), frames, by straight lines; NaN outside and beside what is not known."""
    whole = np.floor(times).astype(np.int64)
    rest, last = times - whole, len(track) - 1
    inside = (times >= 0) & (times <= last)
    before, after = track[np.clip(whole, 0, last)], track[np.clip(whole + 1, 0, last)]
    between = np.where(rest == 0, before, (1 - rest) * before + rest * after)
    return np.where(inside, between, np.nan)


def _nats(found: Tangents, n_views: int, tried: Array) -> Array:
    """(V, V, D) see `_Likely`."""
    nats = np.zeros((n_views, n_views, len(tried)))
    for (one, other), ends in found.items():
        for end in range(2):
            told = _nats_of(ends[0, :, end], ends[1, :, end], tried)
            nats[one, other] += told
            nats[other, one] += told[::-1]
    return nats


def _nats_of(one: Array, other: Array, tried: Array) -> Array:
    """(D,) nats of delays, beside the usual ones."""
    times, misses, n_frames = np.arange(len(one), dtype=np.float64), np.full(len(tried), np.nan), np.zeros(len(tried))
    for k, delay in enumerate(tried):
        gaps = _at(one, times + delay) - other
        gaps = gaps[np.isfinite(gaps)]
        n_frames[k] = len(gaps)
        if len(gaps) >= _LEAST_FRAMES:
            misses[k] = np.abs(gaps - np.median(gaps)).mean()
    if not np.isfinite(misses).any() or (usual := float(np.nanmedian(misses))) <= 0:
        return np.zeros(len(tried))
    told = n_frames / _LIKE_FRAMES * np.log(usual / np.maximum(misses, _LEAST_MISS * usual))
    return np.where(np.isfinite(told), told, 0.0)


def _parts(found: Tangents, late: Array, told: Mask) -> Array:
    """(V,) parts of a frame by which told views are late beside their whole delays and most views."""
    reach = np.ptp(late[told]) + 2 * _FINE_REACH
    tried = np.arange(-reach, reach + _FINE / 2, _FINE)
    likely = _Likely(_nats(found, len(late), tried), tried)
    fine = likely.settled(late, told, np.arange(-_FINE_REACH, _FINE_REACH + _FINE / 2, _FINE))
    parts = np.where(told, fine - late, 0.0)
    parts = np.where(told, parts - np.median(parts[told]), 0.0)
    for v in _numbers(told):
        here, none = likely.of_view(v, late + parts, told, late[v] + np.array([parts[v], 0.0]))
        if abs(parts[v]) < _PART_FRAMES or here - none < _PART_NATS:
            parts[v] = 0.0
    return parts


def _changing(found: Tangents, path: Array, told: Mask) -> Array:
    """Delays (V, T) that may change at any frame, each view's with the others' held, from constant ones (V, T)."""
    path = np.array(path)
    if np.count_nonzero(told) < 2:
        return path
    for _ in range(3):
        before = path.copy()
        for v in _numbers(told):
            tried = np.arange(path[v].min() - _MOST_CHANGE, path[v].max() + _MOST_CHANGE + 1)
            path[v] = _likeliest(_costs(found, path, v, told, tried), tried, path[v])
        if (path == before).all():
            break
    return path


def _costs(found: Tangents, path: Array, view: int, told: Mask, tried: Array) -> Array:
    """(D, T) nats that frames cost at delays (D,) of a view, the others' being a path (V, T)."""
    times = np.arange(path.shape[1], dtype=np.float64)
    costs = np.zeros((len(tried), path.shape[1]))
    for (one, other), ends in found.items():
        if view not in (one, other) or not (told[one] and told[other]):
            continue
        mine, its, u = (ends[0], ends[1], other) if view == one else (ends[1], ends[0], one)
        for end in range(2):
            held = _at(its[:, end], times + path[u])
            now = _at(mine[:, end], times + path[view]) - held
            if np.count_nonzero(np.isfinite(now)) < _LEAST_FRAMES:
                continue
            usual = float(np.nanmedian(now))
            scale = max(float(np.nanmean(np.abs(now - usual))), 1e-6)
            for k, delay in enumerate(tried):
                gaps = np.abs(_at(mine[:, end], times + delay) - held - usual) / scale
                gaps = np.where(np.isfinite(gaps), np.minimum(gaps, _MOST_MISSES), _MOST_MISSES)
                costs[k] += np.where(np.isfinite(now), gaps, 0.0) / _LIKE_FRAMES
    return costs


def _likeliest(costs: Array, tried: Array, now: Array) -> Array:
    """The path (T,) through costs (D, T) whose changes are worth `_CHANGE_NATS` each; the present one if none is."""
    n_tried, n_frames = costs.shape
    best, came = costs[:, 0].copy(), np.zeros((n_tried, n_frames), dtype=np.int64)
    for t in range(1, n_frames):
        from_other = int(np.argmin(best))
        changes = best[from_other] + _CHANGE_NATS < best
        came[:, t] = np.where(changes, from_other, np.arange(n_tried))
        best = np.where(changes, best[from_other] + _CHANGE_NATS, best) + costs[:, t]
    k = int(np.argmin(best))
    path = np.empty(n_frames)
    for t in range(n_frames - 1, -1, -1):
        path[t] = tried[k]
        k = int(came[k, t])
    return path if len(np.unique(path)) > 1 else now
