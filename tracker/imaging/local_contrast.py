"""Local contrast enhancement for images of poor texture."""

from __future__ import annotations

import cv2
import numpy as np

from tracker.arrays import Array32, Image


def wallis_filter(grey: Image | Array32, window_px: int, contrast: float, force: float) -> Array32:
    """Wallis filter: brings the local mean and the local contrast of an image near to given ones.

    Args:
        grey: image (h, w).
        window_px: side of the square window of the local statistics, odd, px.
        contrast: standard deviation aimed at, grey levels.
        force: from 0 for no change to nearly 1 for the same contrast everywhere, noise in plain areas included.

    Returns:
        (h, w), around 127 grey levels, not cut off to 0 to 255.
    """
    values = grey.astype(np.float32)
    window = window_px, window_px
    mean = cv2.blur(values, window, borderType=cv2.BORDER_REFLECT_101)
    squares = cv2.sqrBoxFilter(values, cv2.CV_32F, window, borderType=cv2.BORDER_REFLECT_101)
    deviation = np.sqrt(np.maximum(squares - mean * mean, 0))
    gain = force * contrast / (force * deviation + (1 - force) * contrast)
    enhanced: Array32 = (values - mean) * gain + force * 127 + (1 - force) * mean
    return enhanced
