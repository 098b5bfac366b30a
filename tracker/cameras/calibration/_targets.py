"""Bright round targets in images: found as spots that the background lacks, measured by ellipses of least squares."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter1d

from tracker.foundation.arrays import Array, Image, Mask

# A choice: a ray every 7.5 degrees, read eight times a pixel.
_N_RAYS, _STEP_PX = 48, 0.125
# Smoothing of the profiles along the rays: about as much as by lens and sensor.
_EDGE_SMOOTHING_PX = 1.0
# A third of the rays: an ellipse has five unknowns, and a third of an outline still spans it.
_FEWEST_EDGES = 16


@dataclass(frozen=True)
class Target:
    """The image of one target."""

    centre: tuple[float, float]
    """Pixel x, y."""

    axes: tuple[float, float]
    """Half axes, the longer one first, px."""

    contrast: float
    """Grey levels between target and surroundings."""

    rms_px: float
    """Tolerance of the edge points about the ellipse."""


Measure = Callable[[tuple[float, float], float], Target | None]
"""Measures a target near a pixel, of about the given radius."""


def find_targets(brighter: Array, radii_px: tuple[float, float], contrast: float, measured: Measure) -> list[Target]:
    """Bright round spots, the most distinct first.

    Args:
        brighter: (h, w) grey levels above those of the background or the surroundings.
        radii_px: smallest and largest half axes.
        contrast: least value of a target in `brighter`.
        measured: measures a spot.
    """
    spots = (brighter > contrast).astype(np.uint8)
    n, labels, table, _ = cv2.connectedComponentsWithStats(spots, connectivity=8)
    smallest, largest = radii_px
    found = []
    for k in range(1, n):
        x, y, width, height, area = table[k]
        if not (2 * smallest * 0.6 <= max(width, height) <= 2 * largest * 1.6) or area < 2.0 * smallest**2:
            continue
        inside = labels[y : y + height, x : x + width] == k
        start = _core(inside, x, y)
        target = measured(start[:2], start[2])
        if target is not None and smallest <= target.axes[1] and target.axes[0] <= largest:
            found.append(target)
    strong = [target for target in found if target.contrast >= contrast]
    return sorted(strong, key=lambda target: target.rms_px / target.contrast)


def _core(spot: Mask, x: int, y: int) -> tuple[float, float, float]:
    """Centre and radius of the largest disc in a spot, so that what hangs on to a target does not count."""
    depth = cv2.distanceTransform(np.pad(spot.astype(np.uint8), 1), cv2.DIST_L2, 5)
    radius = float(depth.max())
    rows, columns = np.nonzero(depth > 0.7 * radius)
    return float(columns.mean()) - 1 + x, float(rows.mean()) - 1 + y, radius


def measure_target(image: Array, start: tuple[float, float], radius: float) -> Target | None:
    """An ellipse through the edge points of a bright spot, by least squares.

    The edge is where the grey levels along a ray change fastest; points that lie off the ellipse, because a bar
    begins there or another thing touches, are left out.

    Args:
        image: (h, w) grey levels.
        start: a pixel within the spot, x and y.
        radius: about half its extent, px.

    Returns:
        The target, or None where no ellipse fits.
    """
    centre, reach = np.array(start), radius
    for _ in range(3):
        edges, contrast = _edge_points(image, centre, reach)
        ellipse = _robust_ellipse(edges)
        if ellipse is None:
            return None
        middle, axes, rms = ellipse
        if np.linalg.norm(middle - centre) > 2 * reach + 1 or not axes[1] / axes[0] > 0.2:
            return None
        centre, reach = middle, float(np.sqrt(axes[0] * axes[1]))
    if rms > 0.12 + 0.03 * reach:
        return None
    return Target((float(centre[0]), float(centre[1])), axes, contrast, rms)


def _edge_points(image: Array, centre: Array, radius: float) -> tuple[Array, float]:
    """Points (N, 2) of steepest descent along rays from the centre, and the median drop there."""
    angles = np.arange(_N_RAYS) * (2 * np.pi / _N_RAYS)
    distances = np.arange(0.2 * radius, 1.9 * radius + 2.5, _STEP_PX)
    x = centre[0] + np.cos(angles)[:, None] * distances
    y = centre[1] + np.sin(angles)[:, None] * distances
    height, width = image.shape
    inside = (x.max() < width - 2) and (y.max() < height - 2) and x.min() > 1 and y.min() > 1
    if not inside:
        return np.zeros((0, 2)), 0.0
    profile = cv2.remap(image.astype(np.float32), x.astype(np.float32), y.astype(np.float32), cv2.INTER_CUBIC)
    fall = -gaussian_filter1d(profile.astype(np.float64), _EDGE_SMOOTHING_PX / _STEP_PX, axis=1, order=1)
    peak = fall[:, 1:-1].argmax(axis=1) + 1
    rows = np.arange(_N_RAYS)
    before, top, after = fall[rows, peak - 1], fall[rows, peak], fall[rows, peak + 1]
    curvature = before - 2 * top + after
    shift = np.where(curvature < 0, 0.5 * (before - after) / np.minimum(curvature, -1e-12), 0.0)
    steep = (top > 0.4 * np.median(top)) & (peak > 1) & (peak < fall.shape[1] - 2)
    edge = distances[peak] + np.clip(shift, -1, 1) * _STEP_PX
    points = np.column_stack([centre[0] + np.cos(angles) * edge, centre[1] + np.sin(angles) * edge])
    lit = profile[:, : max(1, int(0.3 * radius / _STEP_PX))].mean(axis=1)
    around = profile[rows, np.minimum(peak + int(2 / _STEP_PX), profile.shape[1] - 1)]
    return points[steep], float(np.median(lit - around))


def _robust_ellipse(points: Array) -> tuple[Array, tuple[float, float], float] | None:
    """Centre, half axes and RMS distance of the ellipse through most of the points (N, 2)."""
    kept, fitted = points, None
    for _ in range(4):
        fitted = _ellipse(kept) if len(kept) >= _FEWEST_EDGES else None
        if fitted is None:
            return None
        distances = _distances(points, *fitted)
        spread = 1.4826 * np.median(np.abs(distances))
        chosen = np.abs(distances) < max(3 * spread, 0.03)
        if chosen.sum() == len(kept):
            break
        kept = points[chosen]
    if fitted is None:
        return None
    centre, axes, _ = fitted
    rms = float(np.sqrt(np.mean(_distances(kept, *fitted) ** 2)))
    return centre, axes, rms


def _ellipse(points: Array) -> tuple[Array, tuple[float, float], float] | None:
    """Centre, half axes and angle of the ellipse of least distances, linearized about the mean circle.

    A conic with the constraint a + c = 1 (Bookstein would be biased to flat ellipses), scaled to unit size.
    """
    middle = points.mean(axis=0)
    size = np.sqrt(np.mean(np.sum((points - middle) ** 2, axis=1)))
    x, y = ((points - middle) / size).T
    weights = np.ones(len(x))
    for _ in range(3):
        # a (x^2 - y^2) + b 2xy + c x + d y + e = -(x^2 + y^2), weighted by the inverse gradient
        design = np.column_stack([x * x - y * y, 2 * x * y, x, y, np.ones_like(x)])
        a, b, c, d, e = np.linalg.lstsq(design * weights[:, None], -(x * x + y * y) * weights, rcond=None)[0]
        gradient = np.hypot(2 * (1 + a) * x + 2 * b * y + c, 2 * (1 - a) * y + 2 * b * x + d)
        weights = 1 / np.maximum(gradient, 1e-6)
    form = np.array([[1 + a, b], [b, 1 - a]])
    if np.linalg.det(form) <= 0:
        return None
    centre = np.linalg.solve(2 * form, [-c, -d])
    level = centre @ form @ centre - e
    if level <= 0:
        return None
    values, vectors = np.linalg.eigh(form)
    axes = size * np.sqrt(level / values)
    angle = float(np.arctan2(vectors[1, 0], vectors[0, 0]))
    return middle + size * centre, (float(axes[0]), float(axes[1])), angle


def _distances(points: Array, centre: Array, axes: tuple[float, float], angle: float) -> Array:
    """Signed distances (N,) of points from an ellipse, to first order."""
    cosine, sine = np.cos(angle), np.sin(angle)
    x, y = points[:, 0] - centre[0], points[:, 1] - centre[1]
    u, v = (cosine * x + sine * y) / axes[0], (cosine * y - sine * x) / axes[1]
    radius = np.maximum(np.hypot(u, v), 1e-9)
    slope = np.hypot(u / axes[0], v / axes[1]) / radius
    distances: Array = (radius - 1) / np.maximum(slope, 1e-9)
    return distances


def grey(image: Image) -> Array:
    """(h, w) grey levels of a picture, as numbers that can be subtracted."""
    plain = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    levels: Array = plain.astype(np.float64)
    return levels
