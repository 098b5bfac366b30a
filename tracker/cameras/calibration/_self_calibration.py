"""The whole adjustment: finds gross errors, gives the precision, and names and holds undetermined parameters."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tracker.cameras.calibration._adjustment import Adjustment, Measure, cluster_robust, precision, undetermined
from tracker.cameras.calibration._bundle import (
    Noise,
    Observations,
    State,
    adjust,
    noise_of,
    normal_equations,
    residuals,
)
from tracker.cameras.calibration._objects import GROUPS, STATE_COLUMNS, Bars, camera_of
from tracker.foundation.arrays import Array, Mask
from tracker.foundation.errors import CalibrationError, nearest
from tracker.kernels.rows import BundleCameraRow, BundleUnknowns

# All pairs of eight cameras; beyond, more pairs hardly change the medians and cost time.
_MOST_PAIRS = 28


def with_consensus(state: State, observations: Observations, sigma_px: float) -> State:
    """Moves each bar end to the place that most of its images agree with.

    Least squares of an end with one gross error among three images may be caught by it; so every pair of rays makes a
    proposal, and the one with the least robust sum of squares over all images is taken.

    Args:
        state: cameras near the truth, and bars.
        observations: images of the ends.
        sigma_px: noise of an image coordinate.
    """
    points = state.objects.points
    directions = _directions(state, observations, len(points))
    centres = state.cameras[:, BundleCameraRow.CENTRE]
    best, least = points, _disagreement(state, observations, sigma_px, points)
    for i, j in itertools.islice(itertools.combinations(range(len(centres)), 2), _MOST_PAIRS):
        proposed = _between_rays(centres[i], directions[i], centres[j], directions[j])
        proposed = np.where(np.isfinite(proposed), proposed, points)
        found = _disagreement(state, observations, sigma_px, proposed)
        # what is only as good as before stays: the bar's length has had its say there
        better = found < least - 1.0
        best, least = np.where(better[:, None], proposed, best), np.where(better, found, least)
    moved = Bars(best.reshape(-1, 2, 3), *_bar(state))
    return State(state.cameras, moved)


def _bar(state: State) -> tuple[float, float]:
    assert isinstance(state.objects, Bars)
    return state.objects.length_m, state.objects.sigma_m


def _directions(state: State, observations: Observations, n_points: int) -> Array:
    """(V, P, 3) unit rays of the images, NaN where there is none."""
    directions = np.full((len(state.cameras), n_points, 3), np.nan)
    for v, row in enumerate(state.cameras):
        mine = observations.views == v
        camera = camera_of(row, "", (10**6, 10**6))
        directions[v, observations.points[mine]] = camera.rays(observations.pixels[mine])
    return directions


def _between_rays(start: Array, along: Array, other_start: Array, other_along: Array) -> Array:
    """(P, 3) middle of the shortest line between rays (P, 3); NaN for parallel ones and behind the cameras."""
    base = other_start - start
    cosine = np.einsum("pi,pi->p", along, other_along)
    a, b = along @ base, other_along @ base
    with np.errstate(divide="ignore", invalid="ignore"):
        sine = 1 - cosine**2
        depth, other_depth = (a - cosine * b) / sine, (cosine * a - b) / sine
    good = (depth > 0.01) & (other_depth > 0.01)
    middle = (start + depth[:, None] * along + other_start + other_depth[:, None] * other_along) / 2
    result: Array = np.where(good[:, None], middle, np.nan)
    return result


def _disagreement(state: State, observations: Observations, sigma_px: float, points: Array) -> Array:
    """(P,) robust sum of squares of each point's images, in standard deviations."""
    tried = State(state.cameras, Bars(points.reshape(-1, 2, 3), *_bar(state)))
    squares = np.minimum(Noise(sigma_px).squares(residuals(tried, observations)), 50.0)
    return np.asarray(np.bincount(observations.points, squares, minlength=len(points)), dtype=np.float64)


def exchange_swapped_ends(state: State, observations: Observations, sigma_px: float) -> tuple[Observations, Mask]:
    """Exchanges the two ends of a bar in a view where that makes them fit better.

    Args:
        state: cameras and bars (points 2g and 2g + 1 are the ends of bar g).
        observations: sorted by bar, end and view.
        sigma_px: noise; differences below it do not count.

    Returns:
        The observations, and (N,) which of them were exchanged.
    """
    n_views = len(state.cameras)
    keys = (observations.points // 2) * n_views + observations.views
    first_end = observations.points % 2 == 0
    position = np.full((keys.max() + 1, 2), -1)
    position[keys, 1 - first_end] = np.arange(len(keys))
    both = position[(position >= 0).all(axis=1)]
    errors = residuals(state, observations)
    a, b = both.T
    across = observations.pixels[a] - observations.pixels[b]
    # the other's pixel minus the own projection
    swapped_a, swapped_b = errors[a] - across, errors[b] + across
    robust = Noise(sigma_px, 5 * sigma_px)
    plain = robust.squares(errors[a]) + robust.squares(errors[b])
    turned = robust.squares(swapped_a) + robust.squares(swapped_b)
    a, b = both[turned < plain - 1].T
    pixels, velocities = observations.pixels.copy(), observations.velocities.copy()
    for values in (pixels, velocities):
        values[a], values[b] = values[b].copy(), values[a].copy()
    exchanged = np.zeros(len(observations), dtype=np.bool_)
    exchanged[a] = exchanged[b] = True
    return replace(observations, pixels=pixels, velocities=velocities), exchanged


# Cameras that do not expose together: seen from a target's image, which then runs ahead or behind.

_OFFSET = GROUPS["time_offset"][0]
# Free-running cameras are up to half a frame apart; by fewer than 20 moving points nothing is told: a choice.
_ALLOWED_FRAMES, _FEWEST_MOVING = 0.5, 20

NOTICED_FRAMES, NOTICED_SIGMAS = 0.03, 5.0
"""Time offset from which on it is determined with the rest, so that it does not spoil them."""


def time_offsets(state: State, observations: Observations, sigma_px: float) -> tuple[Array, Array]:
    """Delay of each camera against the others' median, frames, and the standard errors.

    The image of a target at the time of exposure is shifted by lag times velocity; the lag is adjusted along with the
    exterior orientations, camera constants and first radial distortions.

    Args:
        state: cameras and bars near the solution.
        observations: images with velocities; still ones say nothing.
        sigma_px: noise of an image coordinate.

    Returns:
        (V,) offsets and (V,) their standard errors, 0 of a view that is itself the median; NaN where nothing moves.
    """
    free = np.zeros((len(state.cameras), BundleUnknowns.N_UNKNOWNS), dtype=np.bool_)
    free[:, [*GROUPS["exterior"], *GROUPS["camera_constant"], 11]] = True
    free[1:, _OFFSET] = True
    speeds = np.linalg.norm(observations.velocities, axis=1)
    moving = np.bincount(observations.views, speeds > 1.0, minlength=len(free))
    if moving.min() < _FEWEST_MOVING:
        return np.full(len(free), np.nan), np.full(len(free), np.nan)
    for _ in range(3):
        scale = max(_noisiest(residuals(state, observations), observations, len(free)), sigma_px)
        observations, _ = exchange_swapped_ends(state, observations, scale)
        noise = Noise(scale, 3 * scale, used=speeds > 0)
        state, _ = adjust(state, observations, free, noise, tolerance=1e-3)
        state = with_consensus(state, observations, scale)
    errors = residuals(state, observations)
    scale = max(noise_of(errors), sigma_px)
    counted = observations.counted(speeds > 0, len(state.objects.points))
    equations = normal_equations(state, observations, Noise(scale, 3 * scale, used=speeds > 0).weights(errors), counted)
    columns = free.ravel()
    inverse = np.linalg.pinv(equations.normal[np.ix_(columns, columns)], hermitian=True, rcond=1e-13)
    covariance = np.zeros((len(columns), len(columns)))
    covariance[np.ix_(columns, columns)] = inverse
    return _beside_median(state.cameras[:, BundleCameraRow.DELAY], covariance)


def _beside_median(offsets: Array, covariance: Array) -> tuple[Array, Array]:
    """Offsets (V,) less their median, and the standard errors (V,) of that, from the covariance (17V, 17V).

    Those of the offsets themselves are against the first camera, whose own is 0 by definition.
    """
    order, n = np.argsort(offsets), len(offsets)
    less = np.eye(n) - np.eye(n)[order[[(n - 1) // 2, n // 2]]].mean(axis=0)
    own = covariance[_OFFSET :: BundleUnknowns.N_UNKNOWNS, _OFFSET :: BundleUnknowns.N_UNKNOWNS]
    return less @ offsets, np.sqrt(np.maximum(np.einsum("vi,ij,vj->v", less, own, less), 0.0))


def _noisiest(errors: Array, observations: Observations, n_views: int) -> float:
    """Noise of the view that fits worst, px: judged by the others', a late view would be all gross errors."""
    return max(noise_of(errors, observations.views == v) for v in range(n_views))


def check_synchronized(names: Sequence[str], offsets: Array, sigmas: Array) -> None:
    """Refuses views that are off by half a frame or more.

    Raises:
        CalibrationError: names the views and their offsets.
    """
    late = [v for v in range(len(names)) if abs(offsets[v]) > max(_ALLOWED_FRAMES, 4 * sigmas[v])]
    if (
        len(names) == 2
        and np.isfinite(offsets).all()
        and abs(offsets[1] - offsets[0]) > max(_ALLOWED_FRAMES, 4 * sigmas.sum())
    ):
        late = [1]
        offsets = offsets - offsets[0]
    if not late:
        return
    words = [f'"{names[v]}" is {abs(offsets[v]):.1f} frames {"late" if offsets[v] > 0 else "early"}' for v in late]
    table = ", ".join(f"{names[v]} = {-round(offsets[v])}" for v in late)
    raise CalibrationError(
        f"the views are not synchronized: {' and '.join(words)} compared with the others; start the cameras "
        f"together, or set offsets = {{ {table} }} in [views]"
    )


def lag_advice(adjustment: Adjustment) -> tuple[str, ...]:
    """Says which cameras expose noticeably, and beyond doubt, before or after the others."""
    return tuple(
        f"camera {name} exposes {abs(lag):.2f} frames {'after' if lag > 0 else 'before'} the others; the calibration "
        "allows for it, tracking cannot"
        for name, lag, sigma in _lags(adjustment)
        if abs(lag) - NOTICED_SIGMAS * sigma > NOTICED_FRAMES
    )


def lag_measures(adjustment: Adjustment) -> tuple[Measure, ...]:
    """The time offset of every camera where they were determined, else nothing."""
    return tuple(
        Measure(f"time offset of {name}", lag, "frames", "behind the others") for name, lag, _ in _lags(adjustment)
    )


def _lags(adjustment: Adjustment) -> list[tuple[str, float, float]]:
    """Name, time offset behind the others and its standard error, frames, of every camera; none if not determined."""
    if not adjustment.free[:, BundleUnknowns.DELAY].any():
        return []
    lags, sigmas = _beside_median(adjustment.state.cameras[:, BundleCameraRow.DELAY], adjustment.covariance)
    return list(zip(adjustment.names, lags.tolist(), sigmas.tolist(), strict=True))


_REJECTED_AT = 4.0
"""A residual longer than so many standard deviations is a gross error; 3 of 10 000 right ones are."""


def chosen_unknowns(groups: Sequence[str], n_cameras: int) -> Mask:
    """(V, 17) unknowns of the named groups; time offsets are relative to the first camera.

    Raises:
        CalibrationError: there is no such group.
    """
    free = np.zeros((n_cameras, BundleUnknowns.N_UNKNOWNS), dtype=np.bool_)
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
        worst = undetermined(state, free, covariance, views)
        if worst is None:
            break
        (view, k), entry = worst
        free[view, k] = False
        held.append(entry)
        cameras = state.cameras.copy()
        column = STATE_COLUMNS[k]
        cameras[view, column] = start.cameras[view, column] if entry.at_start else 0.0
        state, _ = adjust(replace(state, cameras=cameras), observations, free, Noise(sigma_px, used=used))
    covariance, inflation, bent_m = cluster_robust(covariance, state, observations, used / sigma_px**2, free)
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
    """Leaves out images that say nothing: they fit wherever their object is, and would pass for redundancy."""
    counted = observations.counted(used, len(state.objects.points))
    return used & state.objects.determined(counted)[observations.points]


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
