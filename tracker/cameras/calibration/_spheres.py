"""Balls as targets: a shaded sphere before a known background, fitted to the grey levels by least squares.

Lit from one side, a ball has no outline of its own where it is as dark as what lies behind; an ellipse through its
edges would be drawn to the lit side. So the grey levels themselves are explained: those of the background outside, and
inside a shade that is linear in the surface's normal (Lambert), found along with place and size.
"""

from __future__ import annotations

import numpy as np
from scipy.special import erfc

from tracker.cameras.calibration._targets import Target
from tracker.foundation.arrays import Array

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
