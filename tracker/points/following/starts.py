"""Where followed points are looked for in the next frame."""

from __future__ import annotations

import cv2
import numpy as np
from scipy.spatial import cKDTree

from tracker.foundation.arrays import Array, Image, Integers

# OpenCV's defaults of pyramidal Lucas-Kanade.
_WINDOW_PX, _LEVELS = 21, 3
# Followed by optical flow; the others start where the five nearest of these lead.
_N_LEADERS, _FOLLOWED_LEADERS = 400, 5
# px, half the side of what is correlated: a choice.
_CORRELATED_HALF = 6


def predicted(pixels: Array, before: Array) -> Array:
    """Linear prediction (N, 2) from the two frames before; at rest where only one is known (paper, 2.3.1, step 1)."""
    moved = 2 * pixels - before
    return np.where(np.isfinite(moved), moved, pixels)


def flow(previous: Image, image: Image, pixels: Array, start: Array) -> Array:
    """(N, 2) pixels followed by pyramidal Lucas-Kanade; NaN where it fails."""
    found = np.full(pixels.shape, np.nan)
    known = np.isfinite(pixels).all(axis=1) & np.isfinite(start).all(axis=1)
    if not known.any():
        return found
    at, to = (np.ascontiguousarray(values[known], dtype=np.float32)[:, None] for values in (pixels, start))
    window = _WINDOW_PX, _WINDOW_PX
    moved, status, _ = cv2.calcOpticalFlowPyrLK(
        previous, image, at, to.copy(), winSize=window, maxLevel=_LEVELS, flags=cv2.OPTFLOW_USE_INITIAL_FLOW
    )
    found[known] = np.where(status > 0, moved[:, 0], np.nan)
    return found


def led(previous: Image, image: Image, pixels: Array, start: Array, ids: Integers) -> Array:
    """Starts (N, 2) corrected by what the flow of a few leaders says near each point.

    400 points are followed by Lucas-Kanade; the others take the median correction of the five nearest of these to
    their own linear prediction. With 10 000 points that costs a tenth of the flow of all.
    """
    known = np.flatnonzero(np.isfinite(start).all(axis=1))
    # A fixed shuffle of the ids: leaders are spread evenly, and are the same when a run is resumed.
    order = np.argsort((ids[known] * 2654435761) % 2**32, kind="stable")
    leaders = known[order[:_N_LEADERS]]
    moved = flow(previous, image, pixels[leaders], start[leaders])
    usable = np.isfinite(moved).all(axis=1)
    leaders, moved = leaders[usable], moved[usable]
    if len(leaders) < _FOLLOWED_LEADERS:
        corrected = start.copy()
        corrected[leaders] = moved
        return corrected
    correction = moved - start[leaders]
    _, near = cKDTree(pixels[leaders]).query(pixels[known], k=_FOLLOWED_LEADERS)
    corrected = start.copy()
    corrected[known] += np.median(correction[np.asarray(near)], axis=1)
    corrected[leaders] = moved
    return corrected


def correlated(previous: Image, image: Image, pixels: Array, start: Array, reach_px: int) -> Array:
    """Place (N, 2) of the best cross-correlation in a box around each start (paper, section 2.3.1, step 2)."""
    found = np.full(pixels.shape, np.nan)
    half, height, width = _CORRELATED_HALF, *image.shape
    known = np.flatnonzero(np.isfinite(pixels).all(axis=1) & np.isfinite(start).all(axis=1))
    for k in known:
        (x, y), (u, v) = np.round(pixels[k]).astype(int), np.round(start[k]).astype(int)
        wide = half + reach_px
        if not (half <= x < width - half and half <= y < height - half):
            continue
        if not (wide <= u < width - wide and wide <= v < height - wide):
            continue
        patch = previous[y - half : y + half + 1, x - half : x + half + 1]
        box = image[v - wide : v + wide + 1, u - wide : u + wide + 1]
        row, column = divmod(int(cv2.matchTemplate(box, patch, cv2.TM_CCOEFF_NORMED).argmax()), 2 * reach_px + 1)
        found[k] = pixels[k] - (x, y) + (u - reach_px + column, v - reach_px + row)
    return found
