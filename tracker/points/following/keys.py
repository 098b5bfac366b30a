"""Key patches of followed points in one view, and their matches."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tracker.foundation.arrays import Array, Array32, Integers, Mask
from tracker.kernels.patches import COVARIANCE, N_FOUND, cut_keys, key_side, match_keys
from tracker.points.surfaces.matching import LeastSquaresMatching, Matches, PatchImage


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
