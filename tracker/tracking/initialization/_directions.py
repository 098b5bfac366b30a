"""How well contours lie on image edges of their own direction: a score for thousands of poses in clutter.

After directional chamfer matching (Liu, Tuzel, Veeraraghavan, Chellappa: Fast directional chamfer matching, CVPR 2010):
one distance image for each of a few edge directions. Of the distance in a contour's own direction the mean over all
directions is taken: where texture has edges of every direction, and where there are none, nothing is gained or lost.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from tracker.bodies.contours import Contours
from tracker.cameras.frame import Frame
from tracker.foundation.arrays import Array, Array32, Image, Integers
from tracker.images.operations.edges import canny, gradient

# 22.5 degrees each, about what a coarse pose is off: a choice.
_DIRECTIONS = 8
# Thresholds of the edge detector are those of `ContourAnalysis`.
_LOW, _HIGH = 3.0, 7.0
_LONGER_SIDE = 360


@dataclass(frozen=True)
class DirectionImages:
    """Of each view and edge direction, how much nearer the next edge is than in an average direction."""

    gains: tuple[Array32 | None, ...]
    """(D, h, w) -1 to 1 of each view, positive where an edge of that direction is near; None for a missing view."""

    scales: tuple[float, ...]
    """Pixels of the gains in a pixel of the view."""

    @property
    def empty(self) -> bool:
        """Whether no view has an edge."""
        return not any(gains is not None and gains.any() for gains in self.gains)

    def scores(self, contours: Contours, first_part: int = 0) -> Array:
        """(B, V) mean gain of each pose's contour in each view; 0 for what chance would give.

        Args:
            contours: of B poses.
            first_part: parts before it are of others, and their contours do not count.
        """
        found = np.zeros((contours.n_poses, len(self.gains)))
        for v, gains in enumerate(self.gains):
            if gains is None:
                continue
            n = int(contours.counts[:, v].max(initial=0))
            # The samples behind the valid ones hold anything.
            valid = np.arange(n) < contours.counts[:, v, None]
            x, y, dx, dy, weights = np.where(valid, np.moveaxis(contours.positions[:, v, :n], -1, 0), np.float32(0))
            if first_part:
                weights = np.where(contours.parts[:, v, :n] >= first_part, weights, np.float32(0))
            direction = np.floor(np.arctan2(dy, dx) * (_DIRECTIONS / np.pi) + 0.5).astype(np.int64) % _DIRECTIONS
            row, column = _whole(y * self.scales[v], gains.shape[1]), _whole(x * self.scales[v], gains.shape[2])
            total = (weights * gains[direction, row, column]).sum(axis=1)
            found[:, v] = total / np.maximum(weights.sum(axis=1), 1.0)
        return found


def direction_images(frame: Frame, reach: float) -> DirectionImages:
    """The edges of a frame.

    Args:
        frame: the images.
        reach: distance at which an edge gains nothing, in shares of an image's longer side.
    """
    gains, scales = [], []
    for image in frame.images:
        scale = 1.0 if image is None else min(_LONGER_SIDE / max(image.shape[:2]), 1.0)
        gains.append(None if image is None else _gains(image, scale, reach * max(image.shape[:2]) * scale))
        scales.append(scale)
    return DirectionImages(tuple(gains), tuple(scales))


def _gains(image: Image, scale: float, reach_px: float) -> Array32:
    small = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA) if scale < 1 else image
    slopes = gradient(small, 1.0)
    rows, columns = np.nonzero(canny(slopes, _LOW, _HIGH))
    angle = np.arctan2(slopes.dy[rows, columns], slopes.dx[rows, columns]) * (_DIRECTIONS / np.pi)
    near = np.empty((_DIRECTIONS, *small.shape[:2]), dtype=np.float32)
    for k in range(_DIRECTIONS):
        off = np.abs((angle - k + _DIRECTIONS / 2) % _DIRECTIONS - _DIRECTIONS / 2)
        empty = np.ones(small.shape[:2], dtype=np.uint8)
        # Every edge counts in the two directions next to its own.
        empty[rows[off <= 1], columns[off <= 1]] = 0
        distance = cv2.distanceTransform(empty, cv2.DIST_L2, 3) if not empty.all() else np.float32(reach_px)
        near[k] = 1 - np.minimum(distance, np.float32(reach_px)) / np.float32(reach_px)
    gains: Array32 = near - near.mean(axis=0)
    return gains


def _whole(values: Array32, size: int) -> Integers:
    whole: Integers = np.clip(values.astype(np.int64), 0, size - 1)
    return whole
