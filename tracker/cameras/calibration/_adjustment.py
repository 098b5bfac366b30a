"""An adjusted rig: its cameras and objects, and how good it is, parameter by parameter and view by view."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from tracker.cameras.calibration._bundle import Observations, State, normal_equations, residuals, scatter
from tracker.cameras.calibration._objects import (
    PARAMETERS,
    STATE_COLUMNS,
    UNITS,
    Boards,
    camera_of,
    rigid_motions,
    transformed,
)
from tracker.cameras.camera import Camera
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, Image, Mask
from tracker.foundation.errors import CalibrationError
from tracker.kernels.rows import BundleCameraRow, BundleUnknowns


def precision(
    state: State, observations: Observations, used: Mask, free: Mask, sigma_px: float
) -> tuple[Array, float, int]:
    """Covariance (17V, 17V) of the cameras scaled by s0, s0, and the redundancy."""
    objects = state.objects
    counted = observations.counted(used, len(objects.points))
    errors = residuals(state, observations)[used] / sigma_px
    conditions = objects.conditions(counted)[2]
    datum = 0 if objects.fixes_datum else 6
    redundancy = 2 * len(errors) + len(conditions) - int(free.sum()) + datum - objects.n_unknowns(counted)
    if redundancy < 1:
        raise CalibrationError(f"{2 * len(errors)} image coordinates are not enough for the unknowns: record more")
    s0 = float(np.sqrt((np.sum(errors**2) + conditions @ conditions) / redundancy))
    equations = normal_equations(state, observations, used / sigma_px**2, counted)
    chosen = free.ravel()
    covariance = np.zeros(equations.normal.shape)
    loose = None if objects.fixes_datum else rigid_motions(state.cameras)[chosen]
    covariance[np.ix_(chosen, chosen)] = s0**2 * _inverse(equations.normal[np.ix_(chosen, chosen)], loose)
    return covariance, s0, redundancy


def cluster_robust(
    covariance: Array, state: State, observations: Observations, weights: Array, free: Mask
) -> tuple[Array, float, float]:
    """Covariance with standard errors that the scatter of a board's positions bears out; see `_correlated`.

    Returns:
        Covariance (17V, 17V), by how much standard errors grew, and how bent the board is, metres.
    """
    chosen = free.ravel()
    if not isinstance(state.objects, Boards) or not chosen.any():
        return covariance, 1.0, 0.0
    loose = rigid_motions(state.cameras)[chosen]
    found = scatter(state, observations, weights, free, lambda normal: _inverse(normal, loose))
    before = np.diag(covariance)[chosen]
    grown = np.sqrt(np.maximum(np.diag(found.covariance) / np.maximum(before, 1e-300), 1.0))
    factors = np.ones(len(chosen))
    factors[chosen] = grown
    return factors[:, None] * covariance * factors, float(np.median(grown)), found.bent_m


def correlation(covariance: Array) -> Array:
    """(U, U) correlations of unknowns with a covariance (U, U); 0 of those held."""
    sigmas = np.sqrt(np.diag(covariance))
    scale = np.where(sigmas > 0, 1 / np.where(sigmas > 0, sigmas, 1.0), 0.0)
    normalized: Array = scale[:, None] * covariance * scale
    return normalized


def _inverse(normal: Array, loose: Array | None) -> Array:
    """Inverse of a normal matrix, under inner constraints on the motions that it leaves open."""
    scale = 1 / np.sqrt(np.maximum(np.diag(normal), 1e-300))
    scaled = scale[:, None] * normal * scale
    n, n_loose = len(normal), 0 if loose is None else loose.shape[1]
    bordered = np.zeros((n + n_loose, n + n_loose))
    bordered[:n, :n] = scaled
    if loose is not None:
        # the condition is that of the unscaled unknowns: loose^T x = 0
        border = loose * scale[:, None]
        border /= np.linalg.norm(border, axis=0)
        bordered[:n, n:], bordered[n:, :n] = border, border.T
    try:
        inverse = np.linalg.inv(bordered)[:n, :n]
    except np.linalg.LinAlgError:
        inverse = np.linalg.pinv(bordered, hermitian=True)[:n, :n]
        np.fill_diagonal(inverse, np.maximum(np.diag(inverse), 1e6))
    result: Array = scale[:, None] * (inverse + inverse.T) / 2 * scale
    np.fill_diagonal(result, np.abs(np.diag(result)))
    return result


# Parameters of the cameras that the images do not determine: those to hold, and why.

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
    """The parameter from which it is inseparable."""

    correlation: float
    turns_back_px: float | None = None
    """Distance from the principal point at which the lens would image two directions in one place; None if nowhere."""

    at_start: bool = False
    """Whether it is held at the start of the adjustment, not at 0: its usual value is another one."""

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
    """The additional or interior parameter whose standard error exceeds its limit most, if one does."""
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
    """The highest radial term of a camera whose distortion turns back inside the image, as it may with few views."""
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


@dataclass(frozen=True)
class Adjustment:
    """An adjusted rig, with its precision."""

    names: tuple[str, ...]
    sizes: tuple[tuple[int, int], ...]
    state: State
    observations: Observations
    used: Mask
    """(N,) observations that are no gross errors."""

    exchanged: Mask
    """(N,) observations with the bar's ends exchanged in that view."""

    errors: Array
    """(N, 2) observed minus projected, px; NaN where a point is not determined."""

    sigma_px: float
    """A-priori standard deviation of an image coordinate."""

    s0: float
    """Standard deviation of unit weight: noise found over noise assumed."""

    redundancy: int
    covariance: Array
    """(17V, 17V) of the cameras' unknowns, scaled by s0; 0 for those held. The datum is the rig's own mean."""

    free: Mask
    """(V, 17) unknowns that were determined."""

    held: tuple[Held, ...]
    inflation: float = 1.0
    """Standard errors over those of independent residuals, the median: more than 1 if pictures of a board disagree."""

    bent_m: float = 0.0
    """Deformation of the board, or difference from its print; 0 if within the noise."""

    @property
    def cameras(self) -> tuple[Camera, ...]:
        """The calibrated cameras."""
        states = zip(self.state.cameras, self.names, self.sizes, strict=True)
        return tuple(camera_of(state, name, size) for state, name, size in states)

    @property
    def sigmas(self) -> Array:
        """(V, 17) standard errors, in `UNITS`."""
        return np.sqrt(np.diag(self.covariance)).reshape(-1, BundleUnknowns.N_UNKNOWNS)

    def in_world(self, motion: Array) -> Adjustment:
        """The same adjustment in another frame, with the standard errors along its axes.

        Args:
            motion: (4, 4) from the present frame to the other one.
        """
        cameras = self.state.cameras.copy()
        turned = cameras[:, BundleCameraRow.ROTATION].reshape(-1, 3, 3) @ motion[:3, :3].T
        cameras[:, BundleCameraRow.ROTATION] = turned.reshape(-1, 9)
        cameras[:, BundleCameraRow.CENTRE] = transformed(motion, cameras[:, BundleCameraRow.CENTRE])
        # the rotations are about the cameras' own axes, which move along
        slope = np.eye(BundleUnknowns.N_UNKNOWNS)
        slope[BundleUnknowns.CENTRE, BundleUnknowns.CENTRE] = motion[:3, :3]
        slopes = np.kron(np.eye(len(cameras)), slope)
        covariance = slopes @ self.covariance @ slopes.T
        np.fill_diagonal(covariance, np.maximum(np.diag(covariance), 0.0))  # of one camera they are 0 but for rounding
        return replace(self, state=State(cameras, self.state.objects.in_world(motion)), covariance=covariance)

    def rms_px(self, view: int) -> float:
        """RMS image coordinate residual of a view without its gross errors, px."""
        errors = self.errors[self.used & (self.observations.views == view)]
        return float(np.sqrt(np.mean(errors**2))) if len(errors) else float("nan")

    def correlations(self, at_least: float) -> list[tuple[float, str, str]]:
        """Correlated parameters of one camera, the highest first: correlation and the two names."""
        found = []
        for v, name in enumerate(self.names):
            block = correlation(self.covariance)[v * BundleUnknowns.N_UNKNOWNS :, v * BundleUnknowns.N_UNKNOWNS :]
            for i in range(BundleUnknowns.N_UNKNOWNS):
                for j in range(i):
                    if abs(block[i, j]) >= at_least:
                        pair = f"{name}: {PARAMETERS[j]}", PARAMETERS[i]
                        found.append((float(block[i, j]), *pair))
        return sorted(found, key=lambda entry: -abs(entry[0]))


def parameter_table(adjustment: Adjustment, view: int) -> list[tuple[str, float, float, str, bool]]:
    """Rows of a camera's unknowns: name, value, standard error, unit, determined; rotations have no value."""
    state = adjustment.state.cameras[view]
    values = np.where(np.array(STATE_COLUMNS) < 0, np.nan, state[list(STATE_COLUMNS)])
    rows = zip(PARAMETERS, values, adjustment.sigmas[view], UNITS, adjustment.free[view], strict=True)
    return [(name, float(value), float(sigma), unit, bool(free)) for name, value, sigma, unit, free in rows]


# A calibrated rig with all that tells how good it is.


@dataclass(frozen=True)
class Measure:
    """A figure that judges a calibration, in words a user understands."""

    name: str
    value: float
    unit: str
    meaning: str


@dataclass(frozen=True)
class Calibrated:
    """Outcome of a calibration."""

    kind: str
    """Component that made it, for instance `reference_bar`."""

    adjustment: Adjustment
    """The bundle adjustment, in the chosen world frame."""

    n_objects: int
    """Bar positions, board poses or points."""

    measures: tuple[Measure, ...]
    """Figures such as the RMS error of hold-out bars."""

    advice: tuple[str, ...] = ()
    """Advice for a better recording."""

    world: str = ""
    """Source of the world frame."""

    scale: str = ""
    """Source of the scale, for instance `square_m = 0.054`."""

    found_out: str = ""
    """Settings that were open and were found, in the form of a configuration."""

    pictures: dict[str, Image] = field(default_factory=dict)
    """A picture of each view with what was found in it."""

    points: Array | None = None
    """(P, 3) adjusted points of the objects in the world, metres; NaN where not determined."""

    @cached_property
    def rig(self) -> Rig:
        """The cameras in the chosen world frame."""
        return Rig(self.adjustment.cameras)
