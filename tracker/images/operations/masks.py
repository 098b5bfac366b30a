"""Masks: made wider, opened, and the major axis of what they cover."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from tracker.foundation.arrays import Array, Mask


def grown(mask: Mask, radius_px: float) -> Mask:
    """A mask (h, w) with all that is within a radius of it, rounded to pixels and at least one."""
    size = 2 * max(1, round(radius_px)) + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    found: Mask = cv2.dilate(mask.astype(np.uint8), disc) > 0
    return found


# Opening with it takes noise away, and the seam between light and shade: single pixels and lines of one.
_SQUARE = np.ones((2, 2), np.uint8)


def opened(mask: Mask) -> Mask:
    """(h, w) all squares of 2x2 pixels that lie in a mask: without single pixels and lines of one.

    `cv2.MORPH_OPEN` erodes and dilates with an even square at the same anchor, which moves the mask by a pixel down and
    to the right, out of itself.
    """
    last, first = (1, 1), (0, 0)
    # beside the image nothing is set: a line of one along its border is no square
    left = cv2.erode(mask.astype(np.uint8), _SQUARE, anchor=last, borderType=cv2.BORDER_CONSTANT, borderValue=0)
    found: Mask = cv2.dilate(left, _SQUARE, anchor=first) > 0
    return found


# Major axis of an image region by iterated principal component analysis (paper, section 4.1, figure 5).


@dataclass(frozen=True)
class PrincipalAxis:
    """Major axis of a point set."""

    centre: Array
    """(2,) mean, px."""

    direction: Array
    """(2,) unit vector along the axis, pointing up in the image."""

    half_length: float
    """Largest distance of a kept point from the centre along the axis, px."""

    @property
    def ends(self) -> Array:
        """(2, 2) lower and upper end point, px."""
        reach = self.half_length * self.direction
        ends: Array = np.array([self.centre - reach, self.centre + reach])
        return ends


def region_points(mask: Mask, most: int = 20000) -> Array:
    """Pixel positions (N, 2) of a region, evenly thinned to at most `most`."""
    points = cv2.findNonZero(mask.astype(np.uint8))
    if points is None:
        return np.zeros((0, 2))
    flat: Array = points.reshape(-1, 2).astype(np.float64)
    if len(flat) <= most:
        return flat
    picked: Array = flat[((np.arange(most) + 0.5) * len(flat) / most).astype(np.int64)]
    return picked


def iterated_axes(points: Array, lateral_sigmas: float = 2.0, iterations: int = 10) -> tuple[PrincipalAxis, ...]:
    """Successive major axes, each after removing the points that lie lateral to the one before.

    A strip of even width keeps all its points at 2 standard deviations (its edge is at 1.7), while arms and
    other lateral noise fall outside and are removed turn by turn.

    Args:
        points: (N, 2) positions, px; at least three.
        lateral_sigmas: points farther from the axis than this many standard deviations are removed.
        iterations: most axes.

    Returns:
        The axes in the order found; the last one is the result.
    """
    kept, axes = points, []
    for _ in range(iterations):
        centre = kept.mean(axis=0)
        offsets = kept - centre
        _, vectors = np.linalg.eigh(offsets.T @ offsets)
        direction = vectors[:, 1] if vectors[1, 1] <= 0 else -vectors[:, 1]
        along = offsets @ direction
        axes.append(PrincipalAxis(centre, direction, float(np.abs(along).max())))
        lateral = np.abs(offsets @ vectors[:, 0])
        near = lateral <= lateral_sigmas * np.sqrt((lateral**2).mean())
        if near.all() or near.sum() < 3:
            break
        kept = kept[near]
    return tuple(axes)
