"""Which part of a scene a view shows where, for little time: hulls of contours, the nearest last."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from tracker.arrays import Array, Integers, Mask
from tracker.contours import ViewContours


@dataclass(frozen=True)
class Shown:
    """What a view shows of the scene's parts, in the box around them."""

    corner: Integers
    """(2,) x and y of the box's first pixel."""

    parts: NDArray[np.int16]
    """(H, W) number of the part, -1 for none."""

    def at(self, pixels: Array) -> Integers:
        """(N,) part at pixels (N, 2) of the view; -1 outside the box."""
        x, y = (np.round(pixels).astype(np.int64) - self.corner).T
        height, width = self.parts.shape
        inside = (x >= 0) & (y >= 0) & (x < width) & (y < height)
        found: Integers = np.full(len(pixels), -1, dtype=np.int64)
        found[inside] = self.parts[y[inside], x[inside]]
        return found

    def inner(self, margin_px: int, trusted: Mask) -> Mask:
        """(H, W) pixels of trusted parts with nothing but the same part so far around."""
        window = np.ones((2 * margin_px + 1,) * 2, dtype=np.uint8)
        same = cv2.erode(self.parts, window) == cv2.dilate(self.parts, window)
        inner: Mask = np.append(trusted, False)[self.parts] & same
        return inner


def seen_parts(contours: ViewContours, centre: Array, size: tuple[int, int]) -> Shown:
    """Which part of the scene a view shows where: the hulls of visible contours, the nearest last.

    Good to a pixel or two, for 0.2 ms a view; what lies at the boundaries of parts is not to be asked about. Parts are
    convex in images but for strong tapers.

    Args:
        contours: of the view.
        centre: (3,) of the camera, metres.
        size: width and height, px.
    """
    pixels = np.round(contours.pixels).astype(np.int32)
    if not len(pixels):
        return Shown(np.zeros(2, dtype=np.int64), np.full((1, 1), -1, dtype=np.int16))
    low = np.clip(pixels.min(axis=0), 0, np.array(size) - 1)
    high = np.clip(pixels.max(axis=0), low, np.array(size) - 1)
    picture = np.full((high - low + 1)[::-1], -1, dtype=np.int16)
    counts = np.bincount(contours.parts)
    depths = np.bincount(contours.parts, np.linalg.norm(contours.points - centre, axis=1)) / np.maximum(counts, 1)
    ends, order = np.cumsum(counts), np.argsort(contours.parts, kind="stable")
    for part in np.argsort(-depths):
        if counts[part]:
            hull = cv2.convexHull(pixels[order[ends[part] - counts[part] : ends[part]]] - low)
            cv2.fillConvexPoly(picture, hull.astype(np.int32), int(part))
    return Shown(low.astype(np.int64), picture)
