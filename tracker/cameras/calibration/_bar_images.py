"""The two targets of a reference bar in all views and frames: detected, followed and distinguished."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import cv2
import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.special import erfc

from tracker.cameras.calibration._targets import Target, find_targets, grey, measure_target
from tracker.cameras.frame import Views
from tracker.foundation.arrays import Array, Integers
from tracker.foundation.errors import CalibrationError
from tracker.foundation.progress import Progress

# Balls as targets: a shaded sphere before a known background, fitted to the grey levels by least squares.
#
# Lit from one side, a ball has no outline of its own where it is as dark as what lies behind; an ellipse through its
# edges would be drawn to the lit side. So the grey levels themselves are explained: those of the background outside,
# and inside a shade that is linear in the surface's normal (Lambert), found along with place and size.

# Background around a ball to tell its level by (a choice), and a bound of the steps.
_MARGIN_PX, _N_STEPS = 4.0, 25
_LEAST_SCALE = 3.0
"""Grey levels that a difference may have at least without counting as another object's."""


def measure_sphere(
    image: Array, background: Array, start: tuple[float, float], radius: float, contrast: float
) -> Target | None:
    """Fits a ball near a start.

    Args:
        image: (h, w) grey levels.
        background: (h, w) the same without ball.
        start: pixel x, y, a few pixels off at most.
        radius: about its half diameter, px.
        contrast: least difference of its brightest part to the background, grey levels.

    Returns:
        The target, or None where no ball explains the picture.
    """
    window = _window(image.shape, start, 1.6 * radius + _MARGIN_PX)
    if window is None:
        return None
    rows, columns = np.mgrid[window]
    seen, behind = image[window].ravel(), background[window].ravel()
    pixels = np.column_stack([columns.ravel(), rows.ravel()]).astype(np.float64)
    guess = np.array([*start, radius, 0.7])
    fitted = _fit(guess, pixels, seen, behind)
    x, y, size, _ = fitted
    model, shade = _render(fitted, pixels, behind, seen, np.ones(len(seen)))
    inside = np.hypot(pixels[:, 0] - x, pixels[:, 1] - y) < size
    if not 0.4 * radius < size < 2.5 * radius or np.hypot(x - start[0], y - start[1]) > 1.5 * radius + 2:
        return None
    if not inside.any() or np.max(shade[inside] - behind[inside]) < contrast:
        return None
    error = float(np.median(np.abs(seen - model)[inside]))
    rms = error / contrast
    return Target((float(x), float(y)), (float(size), float(size)), contrast, rms) if rms < 0.5 else None


def _window(shape: tuple[int, ...], centre: tuple[float, float], reach: float) -> tuple[slice, slice] | None:
    low, high = np.floor(np.array(centre) - reach).astype(int), np.ceil(np.array(centre) + reach).astype(int) + 1
    if (low < 0).any() or high[0] > shape[1] or high[1] > shape[0]:
        return None
    return slice(low[1], high[1]), slice(low[0], high[0])


def _render(geometry: Array, pixels: Array, behind: Array, seen: Array, weights: Array) -> tuple[Array, Array]:
    """Grey levels (N,) of ball and background, and of the ball alone with the shade that explains the picture best."""
    x, y, radius, blur = geometry
    u, v = (pixels[:, 0] - x) / radius, (pixels[:, 1] - y) / radius
    distance = np.hypot(u, v)
    cover = 0.5 * erfc((distance - 1) * radius / (np.sqrt(2) * blur))
    limit = np.minimum(1.0, 0.98 / np.maximum(distance, 1e-9))
    normal = np.column_stack([np.ones_like(u), u * limit, v * limit, np.sqrt(1 - np.minimum(distance, 0.98) ** 2)])
    design = normal * cover[:, None]
    root = np.sqrt(weights)
    levels = np.linalg.lstsq(design * root[:, None], (seen - behind * (1 - cover)) * root, rcond=None)[0]
    shade = normal @ levels
    return behind * (1 - cover) + shade * cover, shade


def _fit(guess: Array, pixels: Array, seen: Array, behind: Array) -> Array:
    """Place, radius and blur by Gauss-Newton; the shade is eliminated, other objects are weighed down."""
    geometry, weights = guess, np.ones(len(seen))
    steps = np.array([0.02, 0.02, 0.02, 0.02])
    for _ in range(_N_STEPS):
        error = seen - _render(geometry, pixels, behind, seen, weights)[0]
        scale = max(_LEAST_SCALE, 2.5 * 1.4826 * float(np.median(np.abs(error))))
        weights = 1 / (1 + (error / scale) ** 2) ** 2
        error = seen - _render(geometry, pixels, behind, seen, weights)[0]
        slopes = np.column_stack(
            [
                (_render(geometry + step, pixels, behind, seen, weights)[0] - (seen - error)) / step[k]
                for k, step in enumerate(np.diag(steps))
            ]
        )
        normal = slopes.T @ (slopes * weights[:, None])
        normal += np.diag(1e-3 * np.diag(normal) + 1e-9)
        move = np.clip(np.linalg.solve(normal, slopes.T @ (weights * error)), -0.5, 0.5)
        geometry = geometry + move
        geometry[2:] = np.clip(geometry[2:], (1.0, 0.35), (10 * guess[2], 1.5))
        if np.abs(move[:2]).max() < 1e-3:
            break
    return geometry


# A median is free of the bar where it passes in fewer than half of the images; of many spots the brightest are kept.
_BACKGROUND_FRAMES, _MOST_CANDIDATES = 31, 8
# Frames: a ball that was not seen for longer may be anywhere by then.
_LOST_AFTER = 3
# How far a ball may be from where it is expected: a choice; three times that as long as its velocity is not known.
_GATE_PX = 12.0


@dataclass(frozen=True)
class BarImages:
    """Images of the ends of a bar."""

    names: tuple[str, ...]
    sizes: tuple[tuple[int, int], ...]
    frames: Integers
    """(B,) number of the frame that shows each position."""

    pixels: Array
    """(V, B, 2, 2) px, NaN where an end is not seen; the ends may be exchanged in some views."""

    def velocities(self) -> Array:
        """(V, B, 2, 2) px per frame from neighbours at most two frames away; NaN where they show no steady motion.

        One swapped or wrong image among three would give a velocity of its own making.
        """
        speeds = np.full(self.pixels.shape, np.nan)
        step = np.diff(self.frames)
        slopes = np.diff(self.pixels, axis=1) / step[:, None, None]
        before, after = slopes[:, :-1], slopes[:, 1:]
        mean = (before + after) / 2
        change = np.linalg.norm(after - before, axis=3)
        steady = change < 1.0 + 0.5 * np.linalg.norm(mean, axis=3)
        near = ((step[:-1] <= 2) & (step[1:] <= 2))[:, None]
        speeds[:, 1:-1] = np.where((steady & near)[..., None], mean, np.nan)
        return speeds

    def part(self, chosen: Integers) -> BarImages:
        """Some of the positions."""
        return BarImages(self.names, self.sizes, self.frames[chosen], self.pixels[:, chosen])


class TargetSettings(Protocol):
    """Appearance of targets."""

    @property
    def target(self) -> str: ...
    @property
    def smallest_px(self) -> float: ...
    @property
    def largest_px(self) -> float: ...
    @property
    def contrast(self) -> float: ...


def measure_bar(views: Views, settings: TargetSettings, progress: Progress) -> BarImages:
    """Finds and follows both targets in every view.

    Raises:
        CalibrationError: a view shows no target at all.
    """
    backgrounds = _backgrounds(views, progress)
    candidates: list[list[list[Target]]] = [[] for _ in views.names]
    frames = []
    for k, frame in enumerate(views.frames()):
        progress("finding targets", k + 1, views.n_frames)
        frames.append(frame.index)
        for v, image in enumerate(frame.images):
            found = [] if image is None else _candidates(grey(image), backgrounds[v], settings)
            candidates[v].append(found[:_MOST_CANDIDATES])
    for name, found_in_view in zip(views.names, candidates, strict=True):
        if not any(found_in_view):
            raise CalibrationError(
                f'view "{name}": no {settings.target} target in any of {len(frames)} frames; are the images blank or '
                f"blurred, or the target smaller than {settings.smallest_px:g} px, larger than "
                f"{settings.largest_px:g} px, or less than {settings.contrast:g} grey levels brighter than "
                "what is behind it?"
            )
    followed = np.stack([follow(found) for found in candidates])
    return BarImages(views.names, views.sizes, np.array(frames, dtype=np.int64), followed)


def _backgrounds(views: Views, progress: Progress) -> list[Array]:
    """Median (h, w) over frames of each view: what does not move."""
    wanted = set(np.linspace(0, views.n_frames - 1, min(views.n_frames, _BACKGROUND_FRAMES)).astype(int).tolist())
    images: list[list[Array]] = [[] for _ in views.names]
    for k, frame in enumerate(views.frames()):
        progress("looking at the background", k + 1, views.n_frames)
        for v, image in enumerate(frame.images):
            if k in wanted and image is not None:
                images[v].append(grey(image).astype(np.float32))
    for name, found in zip(views.names, images, strict=True):
        if not found:
            raise CalibrationError(f'view "{name}": no image can be read')
    return [np.median(np.stack(found), axis=0).astype(np.float64) for found in images]


def _candidates(image: Array, background: Array, settings: TargetSettings) -> list[Target]:
    def measured(start: tuple[float, float], radius: float) -> Target | None:
        if settings.target == "ball":
            return measure_sphere(image, background, start, radius, settings.contrast)
        return measure_target(image, start, radius)

    radii = settings.smallest_px, settings.largest_px
    brighter = np.asarray(cv2.GaussianBlur(image - background, (0, 0), 0.5), dtype=np.float64)
    return find_targets(brighter, radii, settings.contrast, measured)


def follow(candidates: Sequence[Sequence[Target]]) -> Array:
    """Tells the two targets of one view apart by their motion.

    Each is expected where its last two images lead; who is lost for some frames starts anew and may be exchanged, which
    the adjustment of all views finds out.

    Args:
        candidates: targets of each frame, the most distinct first.

    Returns:
        (T, 2, 2) px, NaN where an end is not seen.
    """
    ends = np.full((len(candidates), 2, 2), np.nan)
    tracks: list[_Track | None] = [None, None]
    for k, found in enumerate(candidates):
        pixels = np.array([target.centre for target in found]).reshape(-1, 2)
        tracks = [track if track is not None and k - track.frame <= _LOST_AFTER else None for track in tracks]
        free = set(range(len(pixels)))
        for end, j in _assigned(tracks, pixels, k):
            tracks[end] = _next(tracks[end], pixels[j], k)
            ends[k, end] = pixels[j]
            free.discard(j)
        for end in (0, 1):
            if tracks[end] is None and free:
                j = min(free)
                free.discard(j)
                tracks[end] = _next(None, pixels[j], k)
                ends[k, end] = pixels[j]
    return ends


@dataclass(frozen=True)
class _Track:
    """The last image of a target and its velocity, px per frame."""

    frame: int
    pixel: Array
    velocity: Array | None

    def expected(self, frame: int) -> Array:
        return self.pixel if self.velocity is None else self.pixel + (frame - self.frame) * self.velocity

    @property
    def gate(self) -> float:
        """Farthest distance from where it is expected, px."""
        if self.velocity is None:
            return 3 * _GATE_PX
        return _GATE_PX + 0.7 * float(np.linalg.norm(self.velocity))


def _next(track: _Track | None, pixel: Array, frame: int) -> _Track:
    velocity = None if track is None else (pixel - track.pixel) / (frame - track.frame)
    return _Track(frame, pixel, velocity)


def _assigned(tracks: Sequence[_Track | None], pixels: Array, frame: int) -> list[tuple[int, int]]:
    """Pairs of track and image that are nearest together."""
    alive = [(end, track) for end, track in enumerate(tracks) if track is not None]
    if not alive or not len(pixels):
        return []
    distances = np.stack([np.linalg.norm(pixels - track.expected(frame), axis=1) for _, track in alive])
    gates = np.array([track.gate for _, track in alive])[:, None]
    rows, columns = linear_sum_assignment(np.where(distances < gates, distances, 1e6))
    return [(alive[i][0], int(j)) for i, j in zip(rows, columns, strict=True) if distances[i, j] < gates[i, 0]]
