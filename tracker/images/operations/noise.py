"""Noise of a camera that stands still, and images smoothed against it."""

from __future__ import annotations

import cv2
import numpy as np

from tracker.foundation.arrays import Image, Integers

# A sixteenth of the pixels is enough.
_SAMPLING = 4
# Median of the absolute values of a normal distribution of standard deviation 1.
_MEDIAN = 0.6745


def noise_grey(before: Image, after: Image) -> float:
    """Standard deviation of the noise in two images (h, w, 3) one after the other, grey levels of its worst channel.

    Most of the images has to be still; light that flickers as a whole is none of it. What a codec takes for the same is
    without noise to it.
    """
    now, then = (image[::_SAMPLING, ::_SAMPLING].astype(np.int16) for image in (after, before))
    change = (now - then).reshape(-1, before.shape[-1])
    middle = max(_median(np.abs(one - int(np.median(one)))) for one in change.T)
    return middle / _MEDIAN / float(np.sqrt(2))


def _median(values: Integers) -> float:
    """Median of magnitudes (N,) that were rounded, as finely as if they had not been: each has a width of one."""
    counts = np.bincount(values)
    counts = np.insert(counts, 0, 0).astype(np.float64)
    # of 0 there is but the half that is positive
    edges = np.insert(np.arange(len(counts) - 1) + 0.5, 0, 0.0)
    return float(np.interp(counts.sum() / 2, np.cumsum(counts), edges))


def smoothed(image: Image, sigma_px: float) -> Image:
    """The image (h, w, 3) smoothed by a Gaussian; as it is for 0."""
    if sigma_px == 0:
        return image
    smooth: Image = cv2.GaussianBlur(image, (0, 0), sigma_px)
    return smooth
