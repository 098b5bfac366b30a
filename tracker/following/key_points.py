"""Key points: places beside the surface, such as joints, followed by the rigid motion of the points around them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from tracker.arrays import Array, Integers
from tracker.errors import ConfigError, MatchingError, nearest
from tracker.point_trajectories import PointTrajectories
from tracker.rig import Rig

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


def followed_key_points(
    trajectories: PointTrajectories, names: Sequence[str], places: Array, reach_m: float
) -> KeyPoints:
    """Carries places along with the surface around them.

    Each frame's rigid motion is that of least squares from the first frame (Kabsch 1976), of up to 40 of the nearest
    points; points that lie three times farther off than usual are left out once.

    Args:
        trajectories: points in space.
        names: (K,) of the places.
        places: (K, 3) in the first frame, metres.
        reach_m: points farther away take no part.

    Raises:
        MatchingError: fewer than six points lie around a place.
    """
    first = trajectories.positions[0]
    around = points_around(first, names, places, reach_m)
    n_frames = len(trajectories.times)
    positions, spread = np.full((n_frames, len(places), 3), np.nan), np.full((n_frames, len(places)), np.nan)
    n_around = np.zeros((n_frames, len(places)), dtype=np.int64)
    for k, place in enumerate(places):
        for t in range(n_frames):
            now = trajectories.positions[t, around[k]]
            own = np.flatnonzero(np.isfinite(now).all(axis=1))[:_MOST]
            if len(own) >= _LEAST:
                carried = _carried(first[around[k][own]], now[own], place)
                positions[t, k], spread[t, k], n_around[t, k] = carried
    return KeyPoints(tuple(names), positions, spread, n_around)


def points_around(positions: Array, names: Sequence[str], places: Array, reach_m: float) -> list[Integers]:
    """Rows of the points (N, 3) near each place, the nearest first.

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
    return around


def _carried(rest: Array, now: Array, place: Array) -> tuple[Array, float, int]:
    """The place after the rigid motion of the points (N, 3), what that leaves of them (RMS), and how many took part."""
    moved, gaps = _rigid(rest, now, place)
    kept = gaps <= _WORST * np.median(gaps)
    if kept.sum() >= _LEAST:
        moved, gaps = _rigid(rest[kept], now[kept], place)
    return moved, float(np.sqrt(np.mean(gaps**2))), len(gaps)


def _rigid(rest: Array, now: Array, place: Array) -> tuple[Array, Array]:
    centre, target = rest.mean(axis=0), now.mean(axis=0)
    rotation, _ = Rotation.align_vectors(now - target, rest - centre)
    gaps = np.linalg.norm(rotation.apply(rest - centre) + target - now, axis=1)
    return rotation.apply(place - centre) + target, gaps


def key_points_csv(found: KeyPoints, frames: Integers, times: Array) -> str:
    """A row for each place and frame; empty where it is not known."""
    lines = ["frame,time_s,key_point,x_m,y_m,z_m,spread_m,points_around"]
    for t, frame in enumerate(frames):
        for k, name in enumerate(found.names):
            numbers = (*found.positions[t, k].tolist(), float(found.spread_m[t, k]))
            cells = ["" if value != value else f"{value:.6f}" for value in numbers]
            lines.append(",".join([str(frame), f"{times[t]:.6f}", name, *cells, str(found.n_around[t, k])]))
    return "\n".join(lines) + "\n"
