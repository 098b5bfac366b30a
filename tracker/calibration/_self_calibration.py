"""The whole adjustment: gross errors found, precision told, and what cannot be determined named and held."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tracker.arrays import Array, Mask
from tracker.calibration._bundle import (
    Noise,
    Observations,
    State,
    adjust,
    noise_of,
    normal_equations,
    residuals,
)
from tracker.calibration._consensus import exchange_swapped_ends, with_consensus
from tracker.calibration._correlated import scatter
from tracker.calibration._objects import Bars, Boards
from tracker.calibration._states import GROUPS, PARAMETERS, UNITS, camera_of, rigid_motions
from tracker.camera import Camera
from tracker.errors import CalibrationError, nearest
from tracker.kernels.rows import bundle_camera
from tracker.kernels.rows import bundle_unknown as unknown
from tracker.kernels.rows.bundle_unknown import N_UNKNOWNS

NamedSize = tuple[str, tuple[int, int]]
"""Name and image size, px."""

_REJECTED_AT = 4.0
"""A residual longer than so many standard deviations is a gross error; 3 of 10 000 right ones are."""

_STATE_OFFSET = 6
"""The unknown k >= 6 is the number k + 6 of a camera's state."""


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

    def __str__(self) -> str:
        if self.turns_back_px is not None:
            return (
                f'camera "{self.camera}": with {self.parameter} the distortion turns back {self.turns_back_px:.0f} px '
                "from the principal point, inside the image: held at 0; show the board near the corners"
            )
        return (
            f'camera "{self.camera}": {self.parameter} cannot be determined (standard error {self.sigma:.2g}, '
            f"{self.limit:.2g} at most; correlation {self.correlation:+.3f} with {self.partner}): held"
        )


@dataclass(frozen=True)
class Adjustment:
    """An adjusted rig, with everything that tells how good it is."""

    names: tuple[str, ...]
    sizes: tuple[tuple[int, int], ...]
    state: State
    observations: Observations
    used: Mask
    """(N,) observations that are no gross errors."""

    exchanged: Mask
    """(N,) observations whose bar had its ends exchanged in that view."""

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
    """By how much the board seems not to be flat, or not as printed; 0 if within the noise."""

    @property
    def cameras(self) -> tuple[Camera, ...]:
        """The calibrated cameras."""
        states = zip(self.state.cameras, self.names, self.sizes, strict=True)
        return tuple(camera_of(state, name, size) for state, name, size in states)

    @property
    def sigmas(self) -> Array:
        """(V, 17) standard errors, in `UNITS`."""
        return np.sqrt(np.diag(self.covariance)).reshape(-1, N_UNKNOWNS)

    def rms_px(self, view: int) -> float:
        """RMS image coordinate residual of a view without its gross errors, px."""
        errors = self.errors[self.used & (self.observations.views == view)]
        return float(np.sqrt(np.mean(errors**2))) if len(errors) else float("nan")

    def correlations(self, at_least: float) -> list[tuple[float, str, str]]:
        """Correlated parameters of one camera, the highest first: correlation and the two names."""
        found = []
        for v, name in enumerate(self.names):
            block = _correlation(self.covariance)[v * N_UNKNOWNS :, v * N_UNKNOWNS :]
            for i in range(N_UNKNOWNS):
                for j in range(i):
                    if abs(block[i, j]) >= at_least:
                        pair = f"{name}: {PARAMETERS[j]}", PARAMETERS[i]
                        found.append((float(block[i, j]), *pair))
        return sorted(found, key=lambda entry: -abs(entry[0]))


def chosen_unknowns(groups: Sequence[str], n_cameras: int) -> Mask:
    """(V, 17) unknowns of the named groups; time offsets are relative to the first camera.

    Raises:
        CalibrationError: there is no such group.
    """
    free = np.zeros((n_cameras, N_UNKNOWNS), dtype=np.bool_)
    for group in ("exterior", *groups):
        if group not in GROUPS:
            raise CalibrationError(f'no group of parameters "{group}"; {nearest(group, GROUPS)}')
        free[:, GROUPS[group]] = True
    free[0, GROUPS["time_offset"]] = False
    return free


def self_calibrated(
    start: State,
    observations: Observations,
    wanted: Mask,
    sigma_px: float,
    views: Sequence[tuple[str, tuple[int, int]]],
) -> Adjustment:
    """Adjusts cameras and objects, without gross errors and without parameters that cannot be determined.

    Args:
        start: near the solution.
        observations: images of the objects' points.
        wanted: (V, 17) unknowns to determine if that can be done.
        sigma_px: a-priori standard deviation of an image coordinate.
        views: name and image size of each camera.

    Raises:
        CalibrationError: too few observations fit together.
    """
    names = tuple(name for name, _ in views)
    state, observations, exchanged = _robust(start, observations, wanted, sigma_px)
    state, used = _without_gross_errors(state, observations, wanted, sigma_px)
    _check_enough(observations, used, names)
    free, held = wanted.copy(), []
    while True:
        covariance, s0, redundancy = precision(state, observations, used, free, sigma_px)
        worst = _least_determined(state, free, covariance, views)
        worst = worst or _turning_back(state, free, views)
        if worst is None:
            break
        (view, k), entry = worst
        free[view, k] = False
        held.append(entry)
        cameras = state.cameras.copy()
        cameras[view, k + _STATE_OFFSET] = start.cameras[view, k + _STATE_OFFSET] if k < 9 else 0.0
        state, _ = adjust(replace(state, cameras=cameras), observations, free, Noise(sigma_px, used=used))
    covariance, inflation, bent_m = _honest(covariance, state, observations, used / sigma_px**2, free)
    errors = residuals(state, observations)
    errors[observations.counted(used, len(state.objects.points))[observations.points] == 0] = np.nan
    return Adjustment(
        names, tuple(size for _, size in views), state, observations, used, exchanged, errors,
        sigma_px, s0, redundancy, covariance, free, tuple(held), inflation, bent_m,
    )  # fmt: skip


def _robust(start: State, observations: Observations, free: Mask, sigma_px: float) -> tuple[State, Observations, Mask]:
    """Adjusts with gross errors weighed down, exchanging swapped ends on the way."""
    state, exchanged = start, np.zeros(len(observations), dtype=np.bool_)
    for _ in range(3):
        scale = max(noise_of(residuals(state, observations)), sigma_px)
        if isinstance(state.objects, Bars):
            state = with_consensus(state, observations, scale)
            observations, turned = exchange_swapped_ends(state, observations, scale)
            exchanged ^= turned
            state = with_consensus(state, observations, scale) if turned.any() else state
        state, _ = adjust(state, observations, free, Noise(sigma_px, 3 * scale), tolerance=1e-3)
    return state, observations, exchanged


def _without_gross_errors(state: State, observations: Observations, free: Mask, sigma_px: float) -> tuple[State, Mask]:
    """Least squares over the observations that are no gross errors."""
    used = np.zeros(len(observations), dtype=np.bool_)
    for _ in range(6):
        errors = residuals(state, observations)
        scale = max(noise_of(errors), sigma_px)
        before, used = used, np.asarray(np.einsum("ni,ni->n", errors, errors) < (_REJECTED_AT * scale) ** 2)
        used = _checkable(used, state, observations)
        if (used == before).all():
            break
        state, _ = adjust(state, observations, free, Noise(sigma_px, used=used), tolerance=1e-6)
    return state, used


def _checkable(used: Mask, state: State, observations: Observations) -> Mask:
    """Leaves out the only image of a bar's end: it says nothing."""
    if not isinstance(state.objects, Bars):
        return used
    return used & (observations.counted(used, len(state.objects.points))[observations.points] >= 2)


def _check_enough(observations: Observations, used: Mask, names: tuple[str, ...]) -> None:
    for v, name in enumerate(names):
        mine = observations.views == v
        share = used[mine].mean() if mine.any() else 0.0
        if used[mine].sum() < 20 or share < 0.4:
            raise CalibrationError(
                f'camera "{name}": {int(used[mine].sum())} of {int(mine.sum())} images of targets fit the other '
                "cameras, expected at least 20 and 40 %: is it synchronized, is its focal length right to 10 %, and "
                "are its targets the ones meant?"
            )


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


def _honest(
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
    row = _correlation(covariance)[view * N_UNKNOWNS + k]
    row[view * N_UNKNOWNS + k] = 0.0
    other = int(np.abs(row).argmax())
    partner = PARAMETERS[other % N_UNKNOWNS]
    if other // N_UNKNOWNS != view:
        partner += f' of camera "{names[other // N_UNKNOWNS]}"'
    entry = Held(names[view], PARAMETERS[k], float(sigmas[view, k]), float(limits[view, k]), partner, float(row[other]))
    return (int(view), int(k)), entry


def _turning_back(state: State, free: Mask, views: Sequence[NamedSize]) -> tuple[tuple[int, int], Held] | None:
    """The highest radial term of a camera whose distortion turns back inside the image, as of few views it may."""
    for view, (row, (name, size)) in enumerate(zip(state.cameras, views, strict=True)):
        turns_px = camera_of(row, name, size).turns_back_px
        terms = [k for k in (unknown.K3, unknown.K2, unknown.K1) if free[view, k]]
        if turns_px is not None and terms:
            return (view, terms[0]), Held(name, PARAMETERS[terms[0]], 0.0, 0.0, "", 0.0, turns_px)
    return None


def _limits(camera: Array, size: tuple[int, int]) -> Array:
    """(17,) by how much cameras differ from the nominal one: with a larger standard error, that is the better guess.

    Radial distortion is judged by its effect near the corners, 3 % of the distance from the centre for each term.
    """
    radius = 0.4 * float(np.hypot(*size)) / camera[bundle_camera.C]
    limits = np.full(N_UNKNOWNS, np.inf)
    limits[unknown.C], limits[[unknown.CX, unknown.CY]] = 0.05 * camera[bundle_camera.C], 0.02 * camera[bundle_camera.C]
    limits[unknown.AFFINITY], limits[unknown.SHEAR] = 0.005, 0.002
    limits[[unknown.K1, unknown.K2, unknown.K3]] = 0.03 / radius ** np.array([2, 4, 6])
    limits[[unknown.P1, unknown.P2]] = 0.003
    limits[unknown.DELAY] = 0.3
    return limits


def _correlation(covariance: Array) -> Array:
    sigmas = np.sqrt(np.diag(covariance))
    scale = np.where(sigmas > 0, 1 / np.where(sigmas > 0, sigmas, 1.0), 0.0)
    correlation: Array = scale[:, None] * covariance * scale
    return correlation


def parameter_table(adjustment: Adjustment, view: int) -> list[tuple[str, float, float, str, bool]]:
    """Rows of a camera's unknowns: name, value, standard error, unit, determined; rotations have no value."""
    state = adjustment.state.cameras[view]
    kept = state[[*range(bundle_camera.X, bundle_camera.K4), bundle_camera.DELAY]]
    values = np.concatenate([np.full(3, np.nan), kept])
    rows = zip(PARAMETERS, values, adjustment.sigmas[view], UNITS, adjustment.free[view], strict=True)
    return [(name, float(value), float(sigma), unit, bool(free)) for name, value, sigma, unit, free in rows]
