"""Local contrast enhancement for images of poor texture."""

from __future__ import annotations

import cv2
import numpy as np

from tracker.foundation.arrays import Array32, Image


def wallis_filter(grey: Image | Array32, window_px: int, contrast: float, expansion: float) -> Array32:
    """Wallis filter: brings the local mean and the local contrast of an image near to given ones.

    Args:
        grey: image (h, w).
        window_px: side of the square window of the local statistics, odd, px.
        contrast: standard deviation aimed at, grey levels.
        expansion: constant e, below 1: contrast is raised e / (1 - e) times at most, in plain areas; the nearer to 1,
            the more equal the contrast is everywhere, that of noise included.

    Returns:
        (h, w), around 127 grey levels, not cut off to 0 to 255.
    """
    values = grey.astype(np.float32)
    window = window_px, window_px
    mean = cv2.blur(values, window, borderType=cv2.BORDER_REFLECT_101)
    squares = cv2.sqrBoxFilter(values, cv2.CV_32F, window, borderType=cv2.BORDER_REFLECT_101)
    deviation = np.sqrt(np.maximum(squares - mean * mean, 0))
    gain = expansion * contrast / (expansion * deviation + (1 - expansion) * contrast)
    enhanced: Array32 = (values - mean) * gain + expansion * 127 + (1 - expansion) * mean
    return enhanced
