"""Which parameters of the cameras the images do not determine: those to hold, and why."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tracker.cameras.calibration._bundle import State
from tracker.cameras.calibration._precision import correlation
from tracker.cameras.calibration._states import PARAMETERS, camera_of
from tracker.foundation.arrays import Array, Mask
from tracker.kernels.rows import BundleCameraRow, BundleUnknowns

NamedSize = tuple[str, tuple[int, int]]
"""Name and image size, px."""


@dataclass(frozen=True)
class Held:
    """A parameter that the images do not determine and that was therefore held."""

    camera: str
    parameter: str
    sigma: float
    """Standard error that it had."""

    limit: float
    """Standard error from which on it counts as undeterminable."""

    partner: str
    """The parameter it could not be told from."""

    correlation: float
    turns_back_px: float | None = None
    """Distance from the principal point at which the lens would image two directions in one place; None if nowhere."""

    at_start: bool = False
    """Whether it is held where the adjustment began, not at 0: what has a usual value that is another."""

    def __str__(self) -> str:
        place = "where the adjustment began" if self.at_start else "at 0"
        if self.turns_back_px is not None:
            return (
                f'camera "{self.camera}": with {self.parameter} the distortion turns back {self.turns_back_px:.0f} px '
                f"from the principal point, inside the image: held {place}; show the board near the corners"
            )
        return (
            f'camera "{self.camera}": {self.parameter} cannot be determined (standard error {self.sigma:.2g}, '
            f"{self.limit:.2g} at most; correlation {self.correlation:+.3f} with {self.partner}): held {place}"
        )


def undetermined(
    state: State, free: Mask, covariance: Array, views: Sequence[NamedSize]
) -> tuple[tuple[int, int], Held] | None:
    """The next parameter to hold, as view and unknown, and why; None if all that are free are determined.

    Args:
        state: adjusted cameras and objects.
        free: (V, 17) unknowns that are not held yet.
        covariance: (17V, 17V) of the unknowns.
        views: name and image size of each camera.
    """
    return _least_determined(state, free, covariance, views) or _turning_back(state, free, views)


def _least_determined(
    state: State, free: Mask, covariance: Array, views: Sequence[NamedSize]
) -> tuple[tuple[int, int], Held] | None:
    """The additional or interior parameter whose standard error is largest beside what it may be, if too large."""
    names = [name for name, _ in views]
    sigmas = np.sqrt(np.diag(covariance)).reshape(free.shape)
    limits = np.stack([_limits(row, size) for row, (_, size) in zip(state.cameras, views, strict=True)])
    ratios = np.where(free, sigmas / limits, 0.0)
    if not (ratios > 1).any():
        return None
    view, k = np.unravel_index(int(ratios.argmax()), ratios.shape)
    row = correlation(covariance)[view * BundleUnknowns.N_UNKNOWNS + k]
    row[view * BundleUnknowns.N_UNKNOWNS + k] = 0.0
    other = int(np.abs(row).argmax())
    partner = PARAMETERS[other % BundleUnknowns.N_UNKNOWNS]
    if partner.startswith("centre"):
        partner = "centre"  # along which axis, the adjustment's own frame has it, which is not the world
    if other // BundleUnknowns.N_UNKNOWNS != view:
        partner += f' of camera "{names[other // BundleUnknowns.N_UNKNOWNS]}"'
    told = PARAMETERS[k], float(sigmas[view, k]), float(limits[view, k]), partner, float(row[other])
    return (int(view), int(k)), Held(names[view], *told, at_start=_has_its_own(state.cameras[view], int(k)))


def _turning_back(state: State, free: Mask, views: Sequence[NamedSize]) -> tuple[tuple[int, int], Held] | None:
    """The highest radial term of a camera whose distortion turns back inside the image, as of few views it may."""
    for view, (row, (name, size)) in enumerate(zip(state.cameras, views, strict=True)):
        turns_px = camera_of(row, name, size).turns_back_px
        terms = [k for k in (BundleUnknowns.K3, BundleUnknowns.K2, BundleUnknowns.K1) if free[view, k]]
        if turns_px is not None and terms:
            told = PARAMETERS[terms[0]], 0.0, 0.0, "", 0.0, turns_px, _has_its_own(row, terms[0])
            return (view, terms[0]), Held(name, *told)
    return None


def _has_its_own(camera: Array, k: int) -> bool:
    """Whether the usual value of an unknown is that of the start: without its numerator a wide lens is no lens."""
    radial = k in (BundleUnknowns.K1, BundleUnknowns.K2, BundleUnknowns.K3)
    wide = bool(camera[BundleCameraRow.K4 : BundleCameraRow.DELAY].any())
    return k in (BundleUnknowns.C, BundleUnknowns.CX, BundleUnknowns.CY) or (radial and wide)


def _limits(camera: Array, size: tuple[int, int]) -> Array:
    """(17,) by how much cameras differ from the nominal one: with a larger standard error, that is the better guess.

    Radial distortion is judged by its effect near the corners, 3 % of the distance from the centre for each term.
    """
    radius = 0.4 * float(np.hypot(*size)) / camera[BundleCameraRow.C]
    limits = np.full(BundleUnknowns.N_UNKNOWNS, np.inf)
    limits[BundleUnknowns.C], limits[[BundleUnknowns.CX, BundleUnknowns.CY]] = (
        0.05 * camera[BundleCameraRow.C],
        0.02 * camera[BundleCameraRow.C],
    )
    limits[BundleUnknowns.AFFINITY], limits[BundleUnknowns.SHEAR] = 0.005, 0.002
    limits[[BundleUnknowns.K1, BundleUnknowns.K2, BundleUnknowns.K3]] = 0.03 / radius ** np.array([2, 4, 6])
    limits[[BundleUnknowns.P1, BundleUnknowns.P2]] = 0.003
    limits[BundleUnknowns.DELAY] = 0.3
    return limits
