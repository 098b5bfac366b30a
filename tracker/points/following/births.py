"""Source and density of followed points: measured surfaces, given places, new surface."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import pydantic
from scipy.spatial import cKDTree

from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, Array32, Image, Integers, Mask
from tracker.foundation.configuration.components import component
from tracker.foundation.errors import ConfigError, MatchingError, nearest
from tracker.foundation.geometry import rigid_motion
from tracker.kernels.adjustment import intersect_rays
from tracker.kernels.patches import COVARIANCE, key_side
from tracker.points.following.points import NewPoints, Points, expected
from tracker.points.following.tables import quoted
from tracker.points.surfaces import Matches, PatchImage
from tracker.points.surfaces.growth import MatchField
from tracker.points.surfaces.surface import Surface, SurfaceMeasurement
from tracker.points.trajectories import PointTrajectories


def points_of_surface(surface: Surface) -> NewPoints:
    """Every measured point of a surface; patches across views are as they were matched."""
    pixels = surface.points.pixels
    n_views, n = pixels.shape[:2]
    across, variances = np.tile(np.eye(2), (n_views, n, 1, 1)), np.zeros((n_views, n, 3))
    for v, field in enumerate(surface.fields):
        if field is not None:
            cells = field.cells_of(pixels[surface.template])
            across[v] = field.matches.affine[cells]
            variances[v] = field.found[cells][:, COVARIANCE]
    step = next(field.step_px for field in surface.fields if field is not None)
    return NewPoints(pixels, across, variances, surface.points.points, surface.points.covariances, step)


def points_of_image(pixels: Array) -> NewPoints:
    """Places (M, 2) px of a single view: 2-D mode."""
    n = len(pixels)
    unit, unknown = np.tile(np.eye(2), (1, n, 1, 1)), np.full((n, 3), np.nan)
    places = np.asarray(pixels, dtype=np.float64)[None]
    return NewPoints(places, unit, np.zeros((1, n, 3)), unknown, np.full((n, 3, 3), np.nan))


def no_points(n_views: int, spacing_px: float) -> NewPoints:
    """Nothing to follow."""
    views = np.zeros((n_views, 0, 2)), np.zeros((n_views, 0, 2, 2)), np.zeros((n_views, 0, 3))
    return NewPoints(*views, np.zeros((0, 3)), np.zeros((0, 3, 3)), spacing_px)


def with_room(pixels: Array, image: Image, patch_px: int) -> Mask:
    """(M,) places (M, 2) px that a key patch fits around."""
    height, width = image.shape[:2]
    reach, (x, y) = key_side(patch_px // 2) // 2, np.round(pixels).T
    room: Mask = (x >= reach) & (y >= reach) & (x + reach < width) & (y + reach < height)
    return room


def check_room(pixels: Array, names: Sequence[str], image: Image, patch_px: int) -> None:
    """Refuses given places that no key patch fits around.

    Raises:
        MatchingError: names the first one.
    """
    for k in np.flatnonzero(~with_room(pixels, image, patch_px)).tolist():
        raise MatchingError(
            f"point {names[k]} at [{pixels[k, 0]:g}, {pixels[k, 1]:g}]: a patch of {patch_px} px around it is not "
            f"within the image of {image.shape[1]} x {image.shape[0]} px; choose a place farther from the border"
        )


def chosen_evenly(n: int, wanted: int, seed: int = 0) -> Integers:
    """Rows of `wanted` of n points, spread at random but always the same."""
    order = np.random.default_rng(seed).permutation(n)
    return np.sort(order[:wanted])


def given_points(surface: Surface, measurement: SurfaceMeasurement, at: Array, names: Sequence[str]) -> NewPoints:
    """Places given by hand, matched into the other views from the nearest measured points of a surface.

    Args:
        surface: measured in the frame; no filter of its points needed.
        measurement: how it was measured.
        at: (M, 2) px in the template.
        names: of the points, for messages.

    Raises:
        MatchingError: a point is not matched in as many views as a surface's points must be; why is said.
    """
    n_views, n = len(surface.views), len(at)
    pixels, variances = np.full((n_views, n, 2), np.nan), np.zeros((n_views, n, 3))
    across, faults = np.tile(np.eye(2), (n_views, n, 1, 1)), [""] * n
    pixels[surface.template] = at
    template = measurement.matching.prepared(surface.views[surface.template].grey)
    for v, field in enumerate(surface.fields):
        if field is None:
            continue
        if not field.matched.any():
            faults = [f'in view "{surface.views[v].camera.name}": nothing matched'] * n
            continue
        matches = _from_nearest(field, measurement, (template, surface.views[v].grey), at)
        good = measurement.growth.good(matches)
        pixels[v, good] = matches.pixels[good]
        across[v, good], variances[v, good] = matches.affine[good], matches.found[good][:, COVARIANCE]
        for row, fault in enumerate(measurement.growth.faults(matches)):
            faults[row] = f'in view "{surface.views[v].camera.name}": {fault}' if fault else faults[row]
    cameras = [view.camera for view in surface.views]
    needed = measurement.min_views or n_views
    n_seen = np.isfinite(pixels[..., 0]).sum(axis=0)
    for k in np.flatnonzero(n_seen < needed).tolist():
        raise MatchingError(
            f"point {names[k]} at [{at[k, 0]:g}, {at[k, 1]:g}]: seen by {n_seen[k]} of {needed} views; {faults[k]}: "
            "choose a place of more texture, on a surface that all views show"
        )
    places = _intersected(Rig(tuple(cameras)), surface.template, pixels, variances)
    return NewPoints(pixels, across, variances, *places, measurement.growth.step_px)


def _intersected(rig: Rig, template: int, pixels: Array, variances: Array) -> tuple[Array, Array]:
    """Positions (M, 3) and covariances (M, 3, 3) of matched points, weighted as those of a surface are.

    Half of a match's variances (V, M, 3) is the template's, half the search image's; see `points.surfaces.points`.
    """
    shares, others = variances / 2, np.isfinite(pixels[..., 0])
    others[template] = False
    shares[template] = (shares * others[..., None]).sum(axis=0) / np.maximum(others.sum(axis=0), 1)[:, None]
    positions, covariances = rig.triangulate(pixels)
    intersect_rays(rig.packed, pixels, shares, positions, covariances, np.zeros(len(positions)))
    return positions, covariances


def _from_nearest(
    field: MatchField, measurement: SurfaceMeasurement, images: tuple[PatchImage, Array32], at: Array
) -> Matches:
    cells = np.flatnonzero(field.matched)
    _, nearest = cKDTree(field.at[cells]).query(at)
    found = cells[np.asarray(nearest)]
    affine = field.matches.affine[found]
    start = field.found[found, :2] + np.einsum("nij,nj->ni", affine, at - field.at[found])
    search = measurement.matching.prepared(images[1])
    return measurement.matching.match(images[0], search, at, start, affine)


def textured_places(grey: Image, spacing_px: int) -> Array:
    """Places (M, 2) of an image that can be followed, at least so far apart: 2-D mode without given points."""
    found = cv2.goodFeaturesToTrack(grey, maxCorners=0, qualityLevel=_WEAKEST, minDistance=float(spacing_px))
    if found is None:
        raise MatchingError("the first image has no texture to follow points on: was the lens covered?")
    return np.asarray(found, dtype=np.float64).reshape(-1, 2)


# Of the strongest corner: lower than any that matching follows, so that it decides.
_WEAKEST = 0.005


@component
class Density:
    """The paper's density check (section 2.3.2, figure 9), made every few frames."""

    every_frames: int = pydantic.Field(default=10, ge=1)
    """Frames between two checks; each measures the surface anew, which takes as long as following for some frames."""

    gap: float = pydantic.Field(default=1.5, gt=0)
    """New points are born where none is nearer than this many times the spacing of the measured surface."""

    merge: float = pydantic.Field(default=0.3, ge=0, lt=1)
    """Of two points nearer than this many times the spacing in every view, the younger one ends; 0 keeps all."""

    forget_frames: int | None = pydantic.Field(default=250, ge=1)
    """Points hidden for so many frames are given up; None never gives up."""

    def new_places(self, points: Points, new: NewPoints) -> Mask:
        """(M,) new points where no point is, nor where neighbours expect a hidden one."""
        hidden = np.flatnonzero(~points.alive)
        free = np.ones(len(new.positions), dtype=np.bool_)
        for v in range(points.n_views):
            places = np.concatenate([points.pixels[v][points.alive], expected(points, points.pixels, hidden, v).pixels])
            places = places[np.isfinite(places).all(axis=1)]
            seen = np.flatnonzero(np.isfinite(new.pixels[v]).all(axis=1))
            if len(places) and len(seen):
                gaps, _ = cKDTree(places).query(new.pixels[v][seen])
                free[seen] &= np.asarray(gaps) > self.gap * new.spacing_px
        return free

    def kept(self, points: Points, spacing_px: float) -> Mask:
        """(N,) points that go on: neither merged with an older one nor forgotten."""
        kept = np.ones(len(points), dtype=np.bool_)
        if self.forget_frames is not None:
            kept &= points.since <= self.forget_frames
        if self.merge > 0 and np.isfinite(spacing_px):
            kept[_younger(points.pixels, self.merge * spacing_px)] = False
        return kept


def _younger(pixels: Array, reach_px: float) -> Integers:
    """Rows of the younger of two points that lie together in all views that show both."""
    together: set[tuple[int, int]] = set()
    for view in pixels:
        seen = np.flatnonzero(np.isfinite(view).all(axis=1))
        if len(seen) > 1:
            together |= {(int(seen[a]), int(seen[b])) for a, b in cKDTree(view[seen]).query_pairs(reach_px)}
    return np.unique([max(pair) for pair in together if _always_near(pixels, pair, reach_px)]).astype(np.int64)


def _always_near(pixels: Array, pair: tuple[int, int], reach_px: float) -> bool:
    gaps = np.linalg.norm(pixels[:, pair[0]] - pixels[:, pair[1]], axis=1)
    return bool((gaps[np.isfinite(gaps)] <= reach_px).all())


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
