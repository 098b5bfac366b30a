"""Edge points with sub-pixel positions, linked into chains and split into constant-curvature segments."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from tracker.arrays import Array32, Image, Integers
from tracker.kernels.linking import edge_profile, link_edges, split_segments


@dataclass(frozen=True)
class EdgeSegments:
    """Edge points of an image region, segment after segment."""

    points: Array32
    """(N, 2) positions, px of the region."""

    directions: Array32
    """(N, 2) unit image gradients."""

    segments: Integers
    """(N,) segment of each point; ascending."""

    n_segments: int


def gradient(image: Image, sigma_px: float) -> Array32:
    """Image gradient (h, w, 2) of the colour channel that changes most, grey levels per pixel.

    Args:
        image: grey (h, w) or BGR (h, w, 3).
        sigma_px: standard deviation of the Gaussian smoothing, px; 0 for none.
    """
    smooth = cv2.GaussianBlur(image, (0, 0), sigma_px) if sigma_px > 0 else image
    dx = cv2.Sobel(smooth, cv2.CV_16S, 1, 0)
    dy = cv2.Sobel(smooth, cv2.CV_16S, 0, 1)
    if image.ndim == 3:
        dx, dy = _strongest(dx, dy)
    return np.stack([dx, dy], axis=-1).astype(np.float32) / 8.0


def _strongest(dx: NDArray[np.int16], dy: NDArray[np.int16]) -> tuple[NDArray[np.int16], NDArray[np.int16]]:
    """Per pixel, the channel (h, w, 3) with the largest gradient."""
    channels = zip(cv2.split(dx), cv2.split(dy), strict=True)
    best_x, best_y = next(channels)
    best = np.abs(best_x) + np.abs(best_y)
    for other_x, other_y in channels:
        strength = np.abs(other_x) + np.abs(other_y)
        larger = strength > best
        np.copyto(best_x, other_x, where=larger)
        np.copyto(best_y, other_y, where=larger)
        np.maximum(best, strength, out=best)
    return best_x, best_y


def canny(gradients: Array32, low: float, high: float) -> Image:
    """Canny edge map (h, w) from a gradient image (h, w, 2); thresholds in grey levels per pixel."""
    scaled = np.clip(gradients * 8.0, -32000, 32000).astype(np.int16)
    dx, dy = np.ascontiguousarray(scaled[..., 0]), np.ascontiguousarray(scaled[..., 1])
    edges: Image = cv2.Canny(dx, dy, low * 8.0, high * 8.0, L2gradient=True)
    return edges


def segment_edges(edges: Image, gradients: Array32, rule: tuple[int, float, int]) -> EdgeSegments:
    """Links an edge map into chains and splits these into segments of constant curvature.

    Args:
        edges: (h, w) non-zero at edge pixels.
        gradients: (h, w, 2) image gradient.
        rule: see `tracker.kernels.linking.split_segments`.

    Returns:
        The segments that are long enough.
    """
    n_edges = cv2.countNonZero(edges)
    points = np.empty((n_edges, 2), dtype=np.int64)
    starts = np.empty(n_edges + 1, dtype=np.int64)
    segments = np.empty(n_edges, dtype=np.int64)
    n_chains = link_edges(edges.copy(), points, starts)
    n_segments = split_segments(points, starts, n_chains, rule, segments)
    kept = segments >= 0
    points, segments = points[kept], segments[kept]
    positions = np.empty((len(points), 2), dtype=np.float32)
    directions = np.empty((len(points), 2), dtype=np.float32)
    edge_profile(points, gradients, positions, directions)
    return EdgeSegments(positions, directions, segments, n_segments)


def chamfer_image(points: Array32, size: tuple[int, int], reach: float) -> Array32:
    """Distance of every pixel to the nearest point, clamped.

    Args:
        points: (N, 2) px of the region.
        size: width and height of the region, px.
        reach: largest value, px.

    Returns:
        (h, w) px.
    """
    free = np.full(size[::-1], 255, dtype=np.uint8)
    if len(points) == 0:
        return np.full(size[::-1], reach, dtype=np.float32)
    # Halves go up, not to even numbers: the result must not depend on where the region begins.
    pixels = np.clip(np.floor(points + np.float32(0.5)).astype(np.int64), 0, (size[0] - 1, size[1] - 1))
    free[pixels[:, 1], pixels[:, 0]] = 0
    distance = cv2.distanceTransform(free, cv2.DIST_L2, 5)
    clamped: Array32 = np.minimum(distance, np.float32(reach))
    return clamped
