"""Least squares matching: surfaces measured from two or more images (D'Apuzzo, Plaenkers, Fua 2000)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, Self

import cv2
import numpy as np
import pydantic
from numpy.typing import ArrayLike

from tracker.foundation.arrays import Array, Array32, Image, Integers, Mask, frozen
from tracker.foundation.configuration.components import component
from tracker.foundation.errors import ConfigError
from tracker.kernels.patches import (
    CORRELATION,
    COVARIANCE,
    DRIFTED,
    MATCHED,
    N_FOUND,
    NOT_CONVERGED,
    OUTSIDE,
    SIGMA0,
    WARP,
    WEAK,
    Noise,
    Rule,
    SplineImage,
    match_patches,
)


@dataclass(frozen=True)
class NoisePowers:
    """Powers of white noise of variance 1 in what a match compares."""

    residual: float
    """In the difference of a template at whole pixels and a search patch anywhere between pixels."""

    gradient_of_template: float
    """In a derivative of the template, at whole pixels, per px^2."""

    gradient_of_search: float
    """In a derivative of the search image, anywhere between pixels, per px^2."""


def gaussian_taps(sigma_px: float) -> Array:
    """Taps of the Gaussian that images are smoothed with, reaching four sigmas; one tap for no smoothing."""
    if sigma_px <= 0:
        return np.ones(1)
    reach = max(1, round(4 * sigma_px))
    taps = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma_px) ** 2)
    normalized: Array = taps / taps.sum()
    return normalized


def spline_taps(reach: int = 12) -> Array:
    """Taps that turn grey values into cubic B-spline coefficients.

    They are ``sqrt(3) z^|k|`` with z = sqrt(3) - 2 (Unser 1999), cut where they fall below the resolution of single
    precision: 31 of them with the smoothing cost a seventh of the recursive filter of scipy.
    """
    taps: Array = np.sqrt(3) * (np.sqrt(3) - 2) ** np.abs(np.arange(-reach, reach + 1))
    return taps


def noise_powers(sigma_px: float, n_frequencies: int = 256, n_fractions: int = 32) -> NoisePowers:
    """Integrates the squared responses of smoothing and cubic B-splines over frequencies and pixel fractions."""
    omega = 2 * np.pi * (np.arange(n_frequencies) + 0.5) / n_frequencies
    taps = gaussian_taps(sigma_px)
    reach = np.arange(len(taps)) - len(taps) // 2
    smoothing = (taps * np.cos(np.outer(omega, reach))).sum(axis=1)
    prefiltered = smoothing / ((2 + np.cos(omega)) / 3)
    fractions = np.arange(n_fractions) / n_fractions
    values = np.array([_power(prefiltered, omega, _weights(f)) for f in fractions])
    slopes = np.array([_power(prefiltered, omega, _slopes(f)) for f in fractions])
    return NoisePowers(
        residual=float(values[0] ** 2 + values.mean() ** 2),
        gradient_of_template=float(slopes[0] * values[0]),
        gradient_of_search=float(slopes.mean() * values.mean()),
    )


def _power(prefiltered: Array, omega: Array, weights: Array) -> float:
    response = np.abs(np.exp(1j * np.outer(omega, np.arange(-1, 3))) @ weights) * prefiltered
    return float((response**2).mean())


def _weights(f: float) -> Array:
    """The four cubic B-splines that reach a point a fraction beyond a pixel."""
    return np.array([(1 - f) ** 3, 4 - 6 * f**2 + 3 * f**3, 1 + 3 * f + 3 * f**2 - 3 * f**3, f**3]) / 6


def _slopes(f: float) -> Array:
    return np.array([-((1 - f) ** 2), 3 * f**2 - 4 * f, 1 + 2 * f - 3 * f**2, f**2]) / 2


FAILURES = {
    NOT_CONVERGED: "did not converge",
    DRIFTED: "drifted farther than max_shift_px",
    OUTSIDE: "reached out of an image",
    WEAK: "too little texture",
}
"""Why a match ended without a result, in words."""


@dataclass(frozen=True)
class PatchImage:
    """An image made ready for matching."""

    coefficients: Array32
    """(h * w,) cubic B-spline coefficients of the smoothed image, row by row."""

    size: tuple[int, int]
    """Width and height, px."""

    @property
    def packed(self) -> SplineImage:
        """As the kernels want it."""
        return self.coefficients, *self.size


@dataclass(frozen=True)
class Matches:
    """N matched patches."""

    at: Array
    """(N, 2) centres of the template patches, px."""

    found: Array
    """(N, 15) columns as in `tracker.kernels.patches`."""

    ended: Integers
    """(N,) how each match ended, 0 for a match."""

    @property
    def good(self) -> Mask:
        """(N,) matches that converged."""
        good: Mask = self.ended == MATCHED
        return good

    @property
    def pixels(self) -> Array:
        """(N, 2) centres of the patches in the search image, px."""
        return self.found[:, :2]

    @property
    def affine(self) -> Array:
        """(N, 2, 2) template offsets to search offsets."""
        return self.found[:, 2:6].reshape(-1, 2, 2)

    @property
    def stretch(self) -> Array:
        """(N,) by what factor each patch is stretched or compressed most; infinite for mirrored ones."""
        longest, shortest = np.linalg.svd(self.affine, compute_uv=False).T
        with np.errstate(divide="ignore"):
            most = np.maximum(longest, 1 / shortest)
        return np.where(np.linalg.det(self.affine) > 0, most, np.inf)

    @property
    def sigma0(self) -> Array:
        """(N,) a-posteriori standard deviation of unit weight, grey levels of the smoothed images."""
        return self.found[:, SIGMA0]

    @property
    def covariances(self) -> Array:
        """(N, 2, 2) of the centres in the search image, px^2."""
        xx, yy, xy = self.found[:, COVARIANCE].T
        return np.stack([xx, xy, xy, yy], axis=-1).reshape(-1, 2, 2)

    @property
    def sigmas(self) -> Array:
        """(N, 2) standard deviations of the shifts in x and y, px."""
        deviations: Array = np.sqrt(self.found[:, COVARIANCE][:, :2])
        return deviations

    @property
    def correlation(self) -> Array:
        """(N,) of the two patches after matching."""
        return self.found[:, CORRELATION]

    def select(self, which: Mask | Integers) -> Matches:
        """The chosen ones."""
        return Matches(self.at[which], self.found[which], self.ended[which])


@component
class LeastSquaresMatching:
    """Patches matched by an affine transformation and a linear change of brightness, with honest precision."""

    patch_px: int = pydantic.Field(default=13, ge=5, le=63)
    """Side of the square patch, odd, px."""

    form: Literal["inverse_compositional", "classical"] = "inverse_compositional"
    """`classical` linearizes the search image at every iteration, as Gruen (1985): same result, half as fast."""

    smoothing_px: float = pydantic.Field(default=0.8, ge=0, le=5)
    """Standard deviation of the Gaussian that both images are smoothed with, against interpolation bias; 0 for none."""

    prior_sd: float | None = pydantic.Field(default=None, gt=0)
    """Standard deviation of the affine terms around their start, for weak texture (0.01); None for free terms."""

    noise_grey: float = pydantic.Field(default=1.5, gt=0)
    """Standard deviation of the image noise that the prior is weighed against, grey levels."""

    max_iterations: int = pydantic.Field(default=20, ge=2)
    """A match that takes longer fails."""

    tolerance_px: float = pydantic.Field(default=0.01, gt=0)
    """Iterations end when the corners of the patch have less than this left to go, px."""

    max_shift_px: float = pydantic.Field(default=3.0, gt=0)
    """A match that moves farther from its start fails, px."""

    @pydantic.model_validator(mode="after")
    def _check_odd(self) -> LeastSquaresMatching:
        if self.patch_px % 2 == 0:
            raise ValueError(f"patch_px = {self.patch_px}: expected an odd number, a patch has a centre pixel")
        return self

    def prepared(self, image: Image | Array32) -> PatchImage:
        """An image (h, w), grey, smoothed and turned into spline coefficients."""
        grey = np.ascontiguousarray(image, dtype=np.float32)
        splines = cv2.sepFilter2D(grey, -1, self._taps, self._taps, borderType=cv2.BORDER_REFLECT_101)
        return PatchImage(frozen(splines.ravel(), np.float32), (grey.shape[1], grey.shape[0]))

    def with_patch(self, patch_px: int) -> Self:
        """The same with another patch."""
        return replace(self, patch_px=patch_px)

    def match(
        self, template: PatchImage, search: PatchImage, at: ArrayLike, start: ArrayLike, affine: ArrayLike | None = None
    ) -> Matches:
        """Finds template patches in the search image.

        Args:
            template, search: from `prepared`.
            at: (N, 2) centres of the template patches, px; whole pixels are matched fastest.
            start: (N, 2) approximate centres in the search image, px.
            affine: (N, 2, 2) approximate affine transformations, None for none; the prior's centre.

        Raises:
            ConfigError: the arrays do not belong together.
        """
        at = np.ascontiguousarray(at, dtype=np.float64)
        found = np.zeros((len(at), N_FOUND))
        found[:, WARP] = 0, 0, 1, 0, 0, 1
        if at.shape != (len(at), 2) or np.shape(start) != at.shape:
            raise ConfigError(
                f"template centres {at.shape} and starts {np.shape(start)} found, (N, 2) expected for both"
            )
        found[:, :2] = start
        if affine is not None:
            found[:, 2:6] = np.reshape(affine, (len(at), 4))
        ended = np.zeros(len(at), dtype=np.int64)
        match_patches(template.packed, search.packed, at, found, ended, self.rule, self.noise)
        return Matches(at, found, ended)

    @property
    def rule(self) -> Rule:
        """As the kernels want it."""
        weight = 0.0
        if self.prior_sd is not None:
            weight = self._powers.residual * (self.noise_grey / self.prior_sd) ** 2
        classical = self.form == "classical"
        return self.patch_px // 2, self.max_iterations, self.tolerance_px, self.max_shift_px, weight, classical

    @property
    def noise(self) -> Noise:
        """As the kernels want it."""
        powers = self._powers
        of_gradient = powers.gradient_of_search if self.form == "classical" else powers.gradient_of_template
        return powers.residual, of_gradient, frozen(gaussian_taps(self.smoothing_px), np.float32)

    @cached_property
    def _taps(self) -> Array:
        """Smoothing and spline prefilter in one, symmetric (n,)."""
        return np.convolve(gaussian_taps(self.smoothing_px), spline_taps())

    @cached_property
    def _powers(self) -> NoisePowers:
        return noise_powers(self.smoothing_px)
