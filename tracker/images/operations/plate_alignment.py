"""A clean plate fitted to images that were taken with the camera turned, zoomed or cut a little otherwise."""

from __future__ import annotations

import cv2
import numpy as np

from tracker.foundation.arrays import Array, Image

# px: features of larger pictures are noise, and cost time.
_FEATURES_WIDTH = 960
# Stricter than the 0.8 of Lowe 2004, section 7.1: one wrong plate is worse than one refused.
_RATIO = 0.75
# Of the small picture: a choice.
_OFF_PX = 2.0
LEAST_INLIERS = 40
"""Features in common under which a plate does not belong to an image."""

# Every ninth pixel is enough for 24 levels of grey.
_THIN, _LEVELS = 3, 24


def aligned(plate: Image, image: Image) -> tuple[Image, int]:
    """The plate as the image's camera sees it, in the image's light.

    A camera that only turned or zoomed maps one picture to the other by a homography, whatever the scene; it is
    found from features (Lowe, IJCV 2004) of which most agree (MAGSAC, Barath et al., CVPR 2020), so that what has
    moved does not matter. Each channel then gets the image's brightness, by a curve of its own.

    Args:
        plate: (h', w', 3) BGR, of any size.
        image: (h, w, 3) BGR.

    Returns:
        (h, w, 3) the plate, with the image itself beyond its border; and the number of features that agree. Under
        `LEAST_INLIERS` it is not to be trusted.
    """
    points, others = _matches(plate, image)
    if len(points) < LEAST_INLIERS:
        return image.copy(), len(points)
    homography, agree = cv2.findHomography(points, others, cv2.USAC_MAGSAC, _OFF_PX, maxIters=5000)
    n_agree = 0 if homography is None else int(agree.sum())
    if n_agree < LEAST_INLIERS:
        return image.copy(), n_agree
    size = image.shape[1], image.shape[0]
    warped = cv2.warpPerspective(plate, homography, size, flags=cv2.INTER_AREA, borderMode=cv2.BORDER_REPLICATE)
    inner = np.full(plate.shape[:2], 255, dtype=np.uint8)
    covered = cv2.warpPerspective(cv2.erode(inner, np.ones((5, 5)), borderValue=0), homography, size) > 250
    lit = _in_light_of(warped, image, covered)
    fitted: Image = np.where(covered[..., None], lit, image)
    return fitted, n_agree


def _matches(plate: Image, image: Image) -> tuple[Array, Array]:
    """Positions (N, 2) of features that look the same, px in each picture."""
    found = []
    for picture in (plate, image):
        scale = min(1.0, _FEATURES_WIDTH / max(picture.shape[:2]))
        small = cv2.resize(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), None, fx=scale, fy=scale)
        marks, looks = cv2.SIFT.create(6000).detectAndCompute(small, None)
        # pixel centres are integers: the picture begins at -0.5
        places = (np.array([mark.pt for mark in marks]).reshape(-1, 2) + 0.5) / scale - 0.5
        found.append((places, looks))
    (places, looks), (others, their_looks) = found
    if looks is None or their_looks is None or len(their_looks) < 2:
        return np.zeros((0, 2)), np.zeros((0, 2))
    pairs = [
        pair[0]
        for pair in cv2.BFMatcher().knnMatch(looks, their_looks, k=2)
        if len(pair) == 2 and pair[0].distance < _RATIO * pair[1].distance
    ]
    return places[[pair.queryIdx for pair in pairs]], others[[pair.trainIdx for pair in pairs]]


def _in_light_of(plate: Image, image: Image, covered: Array) -> Image:
    """The plate with the grey levels of each channel mapped to those that the image mostly shows in their place."""
    lit = np.empty_like(plate)
    thin = (slice(None, None, _THIN),) * 2
    for c in range(3):
        old, new = plate[..., c][thin][covered[thin]], image[..., c][thin][covered[thin]]
        edges = np.unique(np.quantile(old, np.linspace(0, 1, _LEVELS + 1))) if len(old) else np.zeros(0)
        if len(edges) < 3:
            lit[..., c] = plate[..., c]
            continue
        bins = np.clip(np.searchsorted(edges, old, side="right") - 1, 0, len(edges) - 2)
        used = np.unique(bins)
        levels = [float(np.median(old[bins == b])) for b in used]
        shown = np.maximum.accumulate([float(np.median(new[bins == b])) for b in used])
        lit[..., c] = np.round(np.interp(np.arange(256), levels, shown)).astype(np.uint8)[plate[..., c]]
    return lit
