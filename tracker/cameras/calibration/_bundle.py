"""Self-calibrating bundle adjustment: cameras and objects of least reprojection error (Brown 1971).

Levenberg-Marquardt on the normal equations reduced to the cameras; gross errors are weighed down by Cauchy's function
while the solution is far off, and left out once the noise is known.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.special import stdtrit

from tracker.cameras.calibration._objects import Boards, CalibrationObjects, moved
from tracker.foundation.arrays import Array, Integers, Mask
from tracker.foundation.errors import CalibrationError
from tracker.kernels.adjustment import N_OBJECT, Objects, Observed, reduce_normal, residuals_of
from tracker.kernels.rows import BundleUnknowns

# A bound: who reaches it has not converged, and is told so.
_MOST_STEPS = 40


@dataclass(frozen=True)
class Observations:
    """Images of the objects' points, those of an object one after another."""

    views: Integers
    """(N,) camera."""

    points: Integers
    """(N,) point."""

    pixels: Array
    """(N, 2) px."""

    velocities: Array
    """(N, 2) velocity of the image, px per frame; 0 where it is not known."""

    def __len__(self) -> int:
        return len(self.views)

    def chosen(self, these: Mask) -> Observations:
        """Rows of a mask (N,)."""
        return Observations(self.views[these], self.points[these], self.pixels[these], self.velocities[these])

    def counted(self, used: Mask, n_points: int) -> Integers:
        """(P,) number of used observations of each point."""
        return np.bincount(self.points[used], minlength=n_points).astype(np.int64)


@dataclass(frozen=True)
class State:
    """Unknowns of an adjustment."""

    cameras: Array
    """(V, 26), see `tracker.cameras.calibration._objects`."""

    objects: CalibrationObjects


@dataclass(frozen=True)
class Noise:
    """Weights of residuals."""

    sigma_px: float
    """Standard deviation of an image coordinate."""

    cauchy_px: float = np.inf
    """Length of a residual that has half the weight; infinite for plain least squares."""

    used: Mask | None = None
    """(N,) observations that count; None for all."""

    def weights(self, residuals: Array) -> Array:
        """(N,) weights of the observations, 1/px^2."""
        squares = np.einsum("ni,ni->n", residuals, residuals) / self.cauchy_px**2
        weights = np.where(np.isfinite(squares), 1 / (1 + squares), 0.0) / self.sigma_px**2
        return weights if self.used is None else weights * self.used

    def squares(self, residuals: Array) -> Array:
        """(N,) robust squares in standard deviations; an image behind the camera counts as 1000 px off."""
        squares = np.einsum("ni,ni->n", residuals, residuals)
        squares = np.where(np.isfinite(squares), squares, 1e6)
        if np.isfinite(self.cauchy_px):
            squares = self.cauchy_px**2 * np.log1p(squares / self.cauchy_px**2)
        used = 1.0 if self.used is None else self.used
        weighted: Array = squares * used / self.sigma_px**2
        return weighted


def residuals(state: State, observations: Observations) -> Array:
    """(N, 2) observed minus projected, px; NaN behind the camera."""
    result = np.empty((len(observations), 2))
    points = np.ascontiguousarray(state.objects.points)
    residuals_of(state.cameras, points, _observed(observations, np.ones(len(observations))), result)
    return result


def _observed(observations: Observations, weights: Array) -> Observed:
    """The columns as the kernels are compiled ahead for: contiguous."""
    views, points = (np.ascontiguousarray(column) for column in (observations.views, observations.points))
    pixels, velocities = (np.ascontiguousarray(column) for column in (observations.pixels, observations.velocities))
    return views, points, pixels, velocities, weights


@dataclass(frozen=True)
class NormalEquations:
    """Reduced equations of the cameras, and what leads back to the objects."""

    normal: Array
    """(17V, 17V)."""

    side: Array
    """(17V,)."""

    inverses: Array
    """(G, 6, 6) inverse normal matrices of the objects."""

    object_sides: Array
    """(G, 6)."""

    couplings: Array
    """(G, V, 6, 17)."""

    def object_steps(self, camera_step: Array) -> Array:
        """(G, 6) steps of the objects that belong to a step (17V,) of the cameras."""
        pulled = np.einsum("gvjk,vk->gj", self.couplings, camera_step.reshape(-1, BundleUnknowns.N_UNKNOWNS))
        steps: Array = np.einsum("gij,gj->gi", self.inverses, self.object_sides - pulled)
        return steps


def normal_equations(
    state: State, observations: Observations, weights: Array, counted: Integers, damping: float = 0.0
) -> NormalEquations:
    """Sums up and reduces the normal equations.

    Args:
        state: cameras and objects.
        observations: N images of points.
        weights: (N,) 1/px^2.
        counted: (P,) number of observations of each point that count.
        damping: Levenberg-Marquardt's.
    """
    objects = state.objects
    priors, prior_sides, _ = objects.conditions(counted)
    n_cameras, n_objects = len(state.cameras), len(priors)
    firsts = np.searchsorted(objects.owners[observations.points], np.arange(n_objects + 1))
    packed: Objects = np.ascontiguousarray(objects.points), objects.slopes, firsts, priors, prior_sides
    n = BundleUnknowns.N_UNKNOWNS * n_cameras
    equations = NormalEquations(
        np.empty((n, n)),
        np.empty(n),
        np.empty((n_objects, N_OBJECT, N_OBJECT)),
        np.empty((n_objects, N_OBJECT)),
        np.empty((n_objects, n_cameras, N_OBJECT, BundleUnknowns.N_UNKNOWNS)),
    )
    reduced = equations.normal, equations.side, equations.inverses, equations.object_sides, equations.couplings
    reduce_normal(state.cameras, packed, _observed(observations, weights), damping, reduced)
    return equations


def adjust(
    state: State, observations: Observations, free: Mask, noise: Noise, tolerance: float = 1e-9
) -> tuple[State, int]:
    """Cameras and objects of least (robust) error.

    Args:
        state: the start.
        observations: images of the objects.
        free: (V, 17) unknowns of the cameras to determine.
        noise: weights of the observations.
        tolerance: gain of a step, as a share of the cost, at which to stop.

    Returns:
        The adjusted state and the number of steps tried.
    """
    counted = observations.counted(_used(noise, observations), len(state.objects.points))
    errors = residuals(state, observations)
    cost, damping = _total(state, noise, errors, counted), 1e-4
    for iteration in range(_MOST_STEPS):
        equations = normal_equations(state, observations, noise.weights(errors), counted, damping)
        step = solved(equations, free.ravel())
        if step is None:
            damping = 10 * max(damping, 1e-6)
            continue
        tried = State(moved(state.cameras, step), state.objects.moved(equations.object_steps(step)))
        tried_errors = residuals(tried, observations)
        tried_cost = _total(tried, noise, tried_errors, counted)
        if tried_cost < cost:
            gain = (cost - tried_cost) / max(cost, 1e-30)
            state, errors, cost, damping = tried, tried_errors, tried_cost, damping / 10
            if gain < tolerance:
                return state, iteration + 1
        elif tried_cost <= cost * (1 + 1e-9) or damping > 1e6:
            return state, iteration + 1
        else:
            damping = 10 * max(damping, 1e-6)
    return state, _MOST_STEPS


def _used(noise: Noise, observations: Observations) -> Mask:
    return np.ones(len(observations), dtype=np.bool_) if noise.used is None else noise.used


def _total(state: State, noise: Noise, errors: Array, counted: Integers) -> float:
    conditions = state.objects.conditions(counted)[2]
    return float(noise.squares(errors).sum()) + float(conditions @ conditions)


def solved(equations: NormalEquations, free: Mask) -> Array | None:
    """(17V,) step of the cameras, 0 where they are held; None if the equations are singular."""
    step = np.zeros(len(free))
    if not free.any():
        return step
    normal, side = equations.normal[np.ix_(free, free)], equations.side[free]
    diagonal = np.diag(normal)
    if (diagonal <= 0).any():
        return None
    scale = 1 / np.sqrt(diagonal)
    try:
        factor = cho_factor(scale[:, None] * normal * scale, lower=True, check_finite=False)
    except np.linalg.LinAlgError:
        return None
    step[free] = scale * cho_solve(factor, scale * side, check_finite=False)
    return step if np.isfinite(step).all() else None


def noise_of(errors: Array, used: Mask | None = None) -> float:
    """Standard deviation of an image coordinate from (N, 2) residuals, most of them right, px."""
    values = np.abs(errors if used is None else errors[used])
    values = values[np.isfinite(values)]
    if not len(values):
        raise CalibrationError("no observation is left that two views share")
    return 1.4826 * float(np.median(values))


# Standard errors of cameras that boards calibrate: what is independent are the board's positions, not its corners.
#
# The residuals of a picture belong together: blur, a lens that the model does not quite follow and a board that is not
# quite flat shift neighbouring corners alike. Least squares take every corner as independent, and give standard errors
# of a third of the true ones (`tests/test_correlated.py`). They are had from leaving out each position in turn: the
# jackknife over clusters, here of the linearized equations (MacKinnon & White 1985; Bell & McCaffrey 2002).
#
# A board that is bent is bent in all positions, which no scatter tells. The displacements of its corners that would
# explain the residuals are estimated beside the cameras; their effect on these counts as uncertainty.

_CHANCE = 1e-3
"""Probability of taking noise for a deformation of the board, one of four, by Student's t of as many positions. With
seven it is more, because each of them says much about the interior: 1 of 16 flat boards seemed 0.1 mm bent."""

Inverse = Callable[[Array], Array]
"""Inverse of a normal matrix of the cameras' unknowns."""


@dataclass(frozen=True)
class Scatter:
    """Precision of the cameras by the positions of a board."""

    covariance: Array
    """(F, F) of the free unknowns."""

    bent_m: float
    """Largest apparent displacement of the board's corners; 0 if that is within the noise."""


def scatter(state: State, observations: Observations, weights: Array, free: Mask, inverse: Inverse) -> Scatter:
    """Covariance of the cameras' unknowns from leaving out every position of the board in turn.

    Args:
        state: adjusted cameras and boards.
        observations: N images of corners.
        weights: (N,) 1/px^2; 0 for those that were left out.
        free: (V, 17) unknowns that were determined.
        inverse: of their normal matrix (F, F), under the datum of the adjustment.
    """
    boards = state.objects
    assert isinstance(boards, Boards)
    shapes = _deformations(boards)
    images = _changes(state, observations, shapes)
    shown = np.unique(boards.owners[observations.points[weights > 0]])
    equations = [_equations_of(g, state, observations, weights, images, free.ravel()) for g in shown]
    normals, sides = np.stack([normal for normal, _ in equations]), np.stack([side for _, side in equations])
    n = int(free.sum())
    steps = _left_out(normals[:, :n, :n], sides[:, :n], inverse)
    covariance = _jackknifed(steps)

    def with_deformations(normal: Array) -> Array:
        return _bordered(normal, n, inverse)

    whole = with_deformations(normals.sum(axis=0)) @ sides.sum(axis=0)
    spread = np.sqrt(np.diag(_jackknifed(_left_out(normals, sides, with_deformations)))[n:])
    heights = whole[n:]
    if not (np.abs(heights) > stdtrit(len(normals) - 1, 1 - _CHANCE / 2) * spread).any():
        return Scatter(covariance, 0.0)
    bent = np.einsum("k,kpi->pi", heights, shapes)
    return Scatter(covariance + np.outer(whole[:n], whole[:n]), float(np.linalg.norm(bent, axis=1).max()))


def _deformations(boards: Boards) -> Array:
    """(4, P, 3) shifts of the corners, at most 1: three ways to bend a board, and a print that is longer than wide."""
    x, y = ((boards.shape - boards.shape.mean(axis=0)) / np.ptp(boards.shape, axis=0).clip(1e-9).max() * 2)[:, :2].T
    none = np.zeros_like(x)
    bends = [np.column_stack([none, none, height]) for height in (x * x, x * y, y * y)]
    return np.stack([*bends, np.column_stack([x, -y, none])])


def _changes(state: State, observations: Observations, shapes: Array) -> Array:
    """(K, N, 2) by how much the images move for a metre of each deformation."""
    boards = state.objects
    assert isinstance(boards, Boards)
    before, step = residuals(state, observations), 1e-6
    changed = [replace(boards, shape=boards.shape + step * shape) for shape in shapes]
    moved = [(before - residuals(State(state.cameras, one), observations)) / step for one in changed]
    return np.nan_to_num(np.stack(moved))


def _equations_of(
    g: int, state: State, observations: Observations, weights: Array, images: Array, free: Mask
) -> tuple[Array, Array]:
    """Normal matrix (F + K, F + K) and right side (F + K,) of one position, its own pose eliminated.

    The adjustment's own equations do all: with the images of a deformation in place of the residuals, their right
    side is the mixed part.
    """
    boards = state.objects
    assert isinstance(boards, Boards)
    points = np.flatnonzero(boards.owners == g)
    mine = boards.owners[observations.points] == g
    own = replace(boards, shape=boards.shape[points], owners=0 * points, poses=boards.poses[g : g + 1])
    alone = State(state.cameras, own)
    rows = observations.chosen(mine)
    rows = replace(rows, points=rows.points - points[0])
    weight, shifts = weights[mine], images[:, mine]
    counted = rows.counted(weight > 0, len(points))
    errors = np.nan_to_num(residuals(alone, rows))
    projected = rows.pixels - errors
    real = normal_equations(alone, rows, weight, counted)
    mixed = [normal_equations(alone, replace(rows, pixels=projected + shift), weight, counted) for shift in shifts]
    poses = np.stack([one.object_sides[0] for one in mixed])
    within = real.inverses[0] @ poses.T
    deformed = np.einsum("kni,n,lni->kl", shifts, weight, shifts) - poses @ within
    side = np.einsum("kni,n,ni->k", shifts, weight, errors) - real.object_sides[0] @ within
    across = np.stack([one.side[free] for one in mixed], axis=1)
    normal = np.block([[real.normal[np.ix_(free, free)], across], [across.T, deformed]])
    return normal, np.concatenate([real.side[free], side])


def _left_out(normals: Array, sides: Array, inverse: Inverse) -> Array:
    """(G, F) solutions without each of the positions."""
    normal, side = normals.sum(axis=0), sides.sum(axis=0)
    pairs = zip(normals, sides, strict=True)
    return np.stack([inverse(normal - mine) @ (side - own) for mine, own in pairs])


def _jackknifed(steps: Array) -> Array:
    n, off = len(steps), steps - steps.mean(axis=0)
    covariance: Array = (n - 1) / n * off.T @ off
    return covariance


def _bordered(normal: Array, n: int, inverse: Inverse) -> Array:
    """Inverse of a matrix whose first n unknowns need a datum, block by block."""
    first, mixed, last = inverse(normal[:n, :n]), normal[:n, n:], normal[n:, n:]
    rest = np.linalg.pinv(last - mixed.T @ first @ mixed, rcond=1e-10, hermitian=True)
    side = first @ mixed @ rest
    return np.block([[first + side @ mixed.T @ first, -side], [-side.T, rest]])
