"""Key points: places beside the surface, such as joints, followed by the rigid motion of the points around them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, Integers
from tracker.foundation.errors import ConfigError, MatchingError, nearest
from tracker.foundation.geometry.motions import rigid_motion
from tracker.points.following.tables import quoted
from tracker.points.trajectories import PointTrajectories

# A rigid motion has six unknowns; more than 40 points add little and reach farther than the surface is rigid.
_LEAST, _MOST = 6, 40
# Times the median: a point of another surface.
_WORST = 3.0


@dataclass(frozen=True)
class KeyPoints:
    """K named places in T frames."""

    names: tuple[str, ...]

    positions: Array
    """(T, K, 3) metres; NaN where fewer than six of the points around are seen."""

    spread_m: Array
    """(T, K) RMS of what the rigid motion leaves of the points around, metres: skin and cloth slide over joints."""

    n_around: Integers
    """(T, K) points that took part."""


def clicked_places(clicks: Mapping[str, Mapping[str, tuple[float, float]]], rig: Rig) -> Array:
    """Places (K, 3) m from their images, px, in two or more views of the first frame.

    Raises:
        ConfigError: a view is not one of the rig, a place has fewer than two, or its rays do not meet.
    """
    pixels = np.full((len(rig), len(clicks), 2), np.nan)
    for k, (name, views) in enumerate(clicks.items()):
        for view, place in views.items():
            if view not in rig.names:
                raise ConfigError(f'key point {name}: no view "{view}"; {nearest(view, rig.names)}')
            pixels[rig.names.index(view), k] = place
        if len(views) < 2:
            raise ConfigError(f"key point {name}: clicked in {len(views)} view, expected two or more")
    places, _ = rig.triangulate(pixels)
    gaps = np.linalg.norm(rig.project(places) - pixels, axis=2)
    for k, name in enumerate(clicks):
        worst = float(np.nanmax(gaps[:, k])) if np.isfinite(places[k]).all() else np.inf
        if not worst <= _CLICK_PX:
            raise ConfigError(
                f"key point {name}: its rays miss one another by {worst:.1f} px, expected less than {_CLICK_PX:g}: is "
                "it the same place in all views?"
            )
    return places


# A click by hand is good to some pixels.
_CLICK_PX = 10.0


@dataclass(frozen=True)
class Surroundings:
    """K key points and the followed points around them in the first frame."""

    names: tuple[str, ...]

    places: Array
    """(K, 3) metres."""

    ids: tuple[Integers, ...]
    """Of the points around each place, the nearest first."""

    rest: tuple[Array, ...]
    """(n, 3) where these were, metres."""


def surroundings(ids: Integers, positions: Array, names: Sequence[str], places: Array, reach_m: float) -> Surroundings:
    """The points around key points.

    Args:
        ids: (N,) of the points that the first frame shows.
        positions: (N, 3) metres.
        names: (K,) of the places.
        places: (K, 3) in the first frame, metres.
        reach_m: points farther away take no part.

    Raises:
        MatchingError: fewer than six points lie around a place.
    """
    known = np.flatnonzero(np.isfinite(positions).all(axis=1))
    around = []
    for name, place in zip(names, places, strict=True):
        distances = np.linalg.norm(positions[known] - place, axis=1)
        near = known[np.argsort(distances)][: int((distances <= reach_m).sum())]
        if len(near) < _LEAST:
            raise MatchingError(
                f"key point {name}: {len(near)} followed points within {1000 * reach_m:.0f} mm, expected {_LEAST} "
                "or more: raise key_point_reach_mm, or lower surface.growth.step_px"
            )
        around.append(near)
    rest = tuple(positions[near] for near in around)
    return Surroundings(tuple(names), places, tuple(ids[near] for near in around), rest)


def followed_key_points(trajectories: PointTrajectories, around: Surroundings) -> KeyPoints:
    """Carries places along with the surface around them.

    Each frame's rigid motion is that of least squares from the first frame (Kabsch 1976), of up to 40 of the nearest
    points; points that lie three times farther off than usual are left out once.
    """
    n_frames, n_places = len(trajectories.times), len(around.places)
    positions, spread = np.full((n_frames, n_places, 3), np.nan), np.full((n_frames, n_places), np.nan)
    n_around = np.zeros((n_frames, n_places), dtype=np.int64)
    for k, place in enumerate(around.places):
        here = np.isin(around.ids[k], trajectories.ids)
        columns, rest = np.searchsorted(trajectories.ids, around.ids[k][here]), around.rest[k][here]
        for t in range(n_frames):
            now = trajectories.positions[t, columns]
            own = np.flatnonzero(np.isfinite(now).all(axis=1))[:_MOST]
            if len(own) >= _LEAST:
                positions[t, k], spread[t, k], n_around[t, k] = _carried(rest[own], now[own], place)
    return KeyPoints(around.names, positions, spread, n_around)


def _carried(rest: Array, now: Array, place: Array) -> tuple[Array, float, int]:
    """The place after the rigid motion of the points (N, 3), what that leaves of them (RMS), and how many took part."""
    moved, gaps = _led(rest, now, place)
    kept = gaps <= _WORST * np.median(gaps)
    if kept.sum() >= _LEAST:
        moved, gaps = _led(rest[kept], now[kept], place)
    return moved, float(np.sqrt(np.mean(gaps**2))), len(gaps)


def _led(rest: Array, now: Array, place: Array) -> tuple[Array, Array]:
    """The place (3,) after the rigid motion of the points (N, 3), and what that leaves of each (N,)."""
    motion = rigid_motion(rest, now)
    rotation, shift = motion[:3, :3], motion[:3, 3]
    return rotation @ place + shift, np.linalg.norm(rest @ rotation.T + shift - now, axis=1)


KEY_POINTS_HEADER = "frame,time_s,key_point,x_m,y_m,z_m,spread_m,points_around\n"


def key_points_csv(found: KeyPoints, frames: Integers, times: Array, inner: slice) -> Iterator[str]:
    """A row for each place and frame, of some of the frames; empty where it is not known."""
    for t in range(*inner.indices(len(frames))):
        for k, name in enumerate(found.names):
            numbers = (*found.positions[t, k].tolist(), float(found.spread_m[t, k]))
            cells = ["" if value != value else f"{value:.6f}" for value in numbers]
            yield ",".join([str(frames[t]), f"{times[t]:.6f}", quoted(name), *cells, str(found.n_around[t, k])]) + "\n"
