"""Pictures that several kinds of evidence draw alike of what they saw."""

from __future__ import annotations

import cv2
import numpy as np

from tracker.foundation.arrays import Array, Image, Mask

UNKNOWN = (150, 80, 0)
"""BGR, a dark blue: where nothing is known."""

# BGR: near enough, and too far.
_NEAR, _FAR = (80, 220, 80), (40, 40, 230)


def gaps_picture(image: Image, shown: Array, carried: Array, wrong: Mask) -> Image:
    """Points where the image shows them, each with a line to where the pose has it, on the darkened image.

    Args:
        image: (H, W, 3) BGR.
        shown: (N, 2) px.
        carried: (N, 2) where the pose has the points, px.
        wrong: (N,) those that are too far away, drawn red; the others are green.
    """
    picture: Image = (0.5 * image).astype(np.uint8)
    there = np.isfinite(shown).all(axis=1) & np.isfinite(carried).all(axis=1)
    # no line is longer than this, or OpenCV's whole numbers overflow
    ends = np.clip(np.rint(np.stack([shown, carried], axis=1)[there]), -(2.0**15), 2.0**15).astype(int)
    for (a, b), off in zip(ends.tolist(), wrong[there], strict=True):
        shade = _FAR if off else _NEAR
        cv2.line(picture, a, b, shade, 1, cv2.LINE_AA)
        cv2.circle(picture, a, 2, shade, -1, cv2.LINE_AA)
    return picture
