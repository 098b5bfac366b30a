"""Key patches of followed points in one view, and their matches."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial import cKDTree

from tracker.foundation.arrays import Array, Array32, Image, Integers, Mask
from tracker.kernels.patches import COVARIANCE, N_FOUND, cut_keys, key_side, match_keys
from tracker.points.surfaces import LeastSquaresMatching, Matches, PatchImage


@dataclass
class Keys:
    """The patches that N points are known by. Changed in place: copying all of them for a few new ones takes long.

    A patch lies around whole pixels, which match fastest; the point lies up to half a pixel beside its centre.
    """

    patches: Array32
    """(N, side * side) spline coefficients."""

    offsets: Array
    """(N, 2) of the points from the centres of their patches, px of the key's image."""

    usable: Mask
    """(N,) points that have a patch in this view."""

    @staticmethod
    def empty(n: int, half: int) -> Keys:
        """No patches for n points."""
        return Keys(np.zeros((n, key_side(half) ** 2), np.float32), np.zeros((n, 2)), np.zeros(n, dtype=np.bool_))

    @staticmethod
    def cut(image: PatchImage, pixels: Array, half: int) -> Keys:
        """Patches around pixels (N, 2) of an image; none where these are NaN or near the border."""
        keys = Keys.empty(len(pixels), half)
        known = np.isfinite(pixels).all(axis=1, keepdims=True)
        centres = np.where(known, np.round(pixels), -1.0)
        cut_keys(image.packed, centres.astype(np.int64), half, keys.patches, keys.usable)
        keys.offsets[:] = np.where(keys.usable[:, None], pixels - centres, 0.0)
        return keys

    def select(self, which: Integers | Mask) -> Keys:
        """A copy of the chosen ones."""
        return Keys(self.patches[which], self.offsets[which], self.usable[which])

    def put(self, which: Integers, keys: Keys) -> None:
        """Replaces the chosen ones."""
        self.patches[which], self.offsets[which], self.usable[which] = keys.patches, keys.offsets, keys.usable

    def joined(self, more: Keys) -> Keys:
        """Both one after the other."""
        return Keys(
            np.concatenate([self.patches, more.patches]),
            np.concatenate([self.offsets, more.offsets]),
            np.concatenate([self.usable, more.usable]),
        )


@dataclass(frozen=True)
class Sighting:
    """Where M points were found in an image."""

    pixels: Array
    """(M, 2) px, NaN where not."""

    affine: Array
    """(M, 2, 2) from the keys to the image."""

    variances: Array
    """(M, 3) xx, yy, xy, px^2."""

    @property
    def good(self) -> Mask:
        """(M,) found ones."""
        good: Mask = np.isfinite(self.pixels[:, 0])
        return good

    def select(self, which: Mask | Integers) -> Sighting:
        """The chosen ones."""
        return Sighting(self.pixels[which], self.affine[which], self.variances[which])


@dataclass(frozen=True)
class Quality:
    """Limits of a match; see the fields of `tracker.points.following.following.Following`."""

    max_sigma0_grey: float
    max_sigma_px: float
    min_correlation: float
    max_stretch: float

    def good(self, matches: Matches) -> Mask:
        """(N,) matches within the limits."""
        precise = (matches.sigmas <= self.max_sigma_px).all(axis=1)
        alike = (matches.sigma0 <= self.max_sigma0_grey) & (matches.correlation >= self.min_correlation)
        good: Mask = matches.good & precise & alike & (_stretch(matches.affine) <= self.max_stretch)
        return good


def _stretch(affine: Array) -> Array:
    """(N,) as `Matches.stretch`, in closed form: 30 times as fast as singular values."""
    determinant = np.linalg.det(affine)
    squares = (affine**2).sum(axis=(1, 2))
    with np.errstate(divide="ignore", invalid="ignore"):
        longest = np.sqrt(0.5 * (squares + np.sqrt(np.maximum(squares**2 - 4 * determinant**2, 0.0))))
        return np.where(determinant > 0, np.maximum(longest, longest / determinant), np.inf)


def find_keys(
    matching: LeastSquaresMatching, quality: Quality, keys: Keys, which: Integers, image: PatchImage, *, starts: Starts
) -> Sighting:
    """Looks for the key patches of M points in an image.

    Args:
        matching, quality: how to match, and what to accept.
        keys: of all points.
        which: (M,) the points.
        image: to look in.
        starts: where.

    Returns:
        Where they are; NaN where a point has no key, no start or no good match.
    """
    offsets = keys.offsets[which]
    centres = starts.pixels - np.einsum("nij,nj->ni", starts.affine, offsets)
    tried = np.flatnonzero(keys.usable[which] & np.isfinite(centres).all(axis=1))
    found, ended = np.zeros((len(tried), N_FOUND)), np.zeros(len(tried), dtype=np.int64)
    found[:, :2], found[:, 2:6] = centres[tried], starts.affine[tried].reshape(-1, 4)
    match_keys(keys.patches, which[tried], image.packed, found, ended, matching.rule, matching.noise)
    matches = Matches(centres[tried], found, ended)
    good = quality.good(matches)
    own = tried[good]
    pixels, affine, variances = np.full((len(which), 2), np.nan), starts.affine.copy(), np.full((len(which), 3), np.nan)
    affine[own] = matches.affine[good]
    pixels[own] = found[good, :2] + np.einsum("nij,nj->ni", affine[own], offsets[own])
    variances[own] = found[good, COVARIANCE]
    return Sighting(pixels, affine, variances)


@dataclass(frozen=True)
class Starts:
    """Where M points are expected."""

    pixels: Array
    """(M, 2) px, NaN where not known."""

    affine: Array
    """(M, 2, 2) from the keys to the image."""

    def select(self, which: Integers | Mask) -> Starts:
        """The chosen ones."""
        return Starts(self.pixels[which], self.affine[which])


# Where followed points are looked for in the next frame.

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
