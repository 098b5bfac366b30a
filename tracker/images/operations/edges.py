"""Edge points with sub-pixel positions, linked into chains and split into constant-curvature segments."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from tracker.foundation.arrays import Array32, Image, Integers, Mask
from tracker.kernels.edges import Slopes, chamfer_distances, strongest_slopes, trace_segments


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


@dataclass(frozen=True)
class Gradient:
    """Gradient of an image as a Sobel filter gives it: whole numbers, from which few pixels are looked up."""

    dx: Slopes
    """(h, w) along x, eighths of a grey level per px."""

    dy: Slopes
    """(h, w) along y, eighths of a grey level per px."""

    @property
    def slopes(self) -> Array32:
        """(h, w, 2) along x and y, grey levels per px."""
        return np.stack([self.dx, self.dy], axis=-1).astype(np.float32) / np.float32(8)


def gradient(image: Image, sigma_px: float) -> Gradient:
    """Image gradient of the colour channel that changes most.

    Args:
        image: grey (h, w) or BGR (h, w, 3).
        sigma_px: standard deviation of the Gaussian smoothing, px; 0 for none.
    """
    smooth = cv2.GaussianBlur(image, (0, 0), sigma_px) if sigma_px > 0 else np.ascontiguousarray(image)
    if image.ndim == 2:
        return Gradient(*cv2.spatialGradient(smooth))
    dx, dy = np.empty(image.shape[:2], dtype=np.int16), np.empty(image.shape[:2], dtype=np.int16)
    strongest_slopes(smooth, dx, dy)
    return Gradient(dx, dy)


def canny(gradients: Gradient, low: float, high: float) -> Image:
    """Canny edge map (h, w) from a gradient image; thresholds in grey levels per pixel."""
    edges: Image = cv2.Canny(gradients.dx, gradients.dy, low * 8.0, high * 8.0, L2gradient=True)
    return edges


def segment_edges(
    edges: Image, gradients: Gradient, rule: tuple[int, float, int], near: Image | None = None
) -> EdgeSegments:
    """Links an edge map into chains and splits these into segments of constant curvature.

    Args:
        edges: (h, w) non-zero at edge pixels.
        gradients: (h, w) image gradient.
        rule: see `tracker.kernels.edges.split_segments`.
        near: (h, w) non-zero where edges matter; None for everywhere.

    Returns:
        The segments that are long enough, and have a pixel that matters.
    """
    n_edges = cv2.countNonZero(edges)
    positions = np.empty((n_edges, 2), dtype=np.float32)
    directions = np.empty((n_edges, 2), dtype=np.float32)
    segments = np.empty(n_edges, dtype=np.int64)
    found = positions, directions, segments
    framed = cv2.copyMakeBorder(edges, 1, 1, 1, 1, cv2.BORDER_CONSTANT)
    near = np.zeros((0, 0), dtype=np.uint8) if near is None else near
    n, n_segments = trace_segments(framed, (gradients.dx, gradients.dy), rule, near, found)
    return EdgeSegments(positions[:n], directions[:n], segments[:n], n_segments)


def distance_to(mask: Mask) -> Array32:
    """(H, W) distance of every pixel to the nearest one of a mask (H, W), px."""
    gap: Array32 = cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, 3)
    return gap


def chamfer_image(points: Array32, size: tuple[int, int], reach: float) -> Array32:
    """Distance of every pixel to the nearest point, clamped.

    Args:
        points: (N, 2) px of the region.
        size: width and height of the region, px.
        reach: largest value, px.

    Returns:
        (h, w) px.
    """
    # Halves go up, not to even numbers: the result must not depend on where the region begins.
    pixels = np.clip(np.floor(points + np.float32(0.5)).astype(np.int32), 0, np.array(size, dtype=np.int32) - 1)
    distance = np.empty(size[::-1], dtype=np.float32)
    chamfer_distances(pixels, reach, distance)
    return distance
