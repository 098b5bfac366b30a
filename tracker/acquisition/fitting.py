"""Shape and poses together: Gauss-Newton on oriented correspondences between model contours and the images."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from tracker.acquisition._residuals import Bodies, Direct, Lasting, Rows, height_row, look_rows, mark_rows, part_slopes
from tracker.acquisition._surface_points import Tied, Tracks, surface_rows, tied
from tracker.acquisition.clouds import Look
from tracker.acquisition.fit_task import ALIKE, Task, free_at, prior_of, room_of
from tracker.acquisition.shape_space import ShapeSpace
from tracker.bodies.body import BodyModel
from tracker.foundation.arrays import Array, frozen

# The step of least quadratic cost within bounds, by an active set.
#
# Block principal pivoting: all unknowns that break a condition change sides at once, and one at a time as soon as that
# does not make them fewer (Judice & Pires 1994, for bounds on both sides). A step costs a few Cholesky decompositions;
# bounded least squares by singular values took a quarter of a fit.

_PATIENCE = 10
"""Exchanges of all unknowns at once that may fail to lessen the broken conditions, before one at a time is exchanged,
which ends for certain (Judice & Pires: 10)."""


def bounded_step(matrix: Array, vector: Array, lower: Array, upper: Array) -> Array:
    """The minimum of ``x^T A x / 2 + b^T x`` with ``lower <= x <= upper``.

    Args:
        matrix: (n, n) symmetric and positive definite.
        vector: (n,)
        lower: (n,) bounds, perhaps infinite.
        upper: (n,) above the lower ones.

    Returns:
        (n,)
    """
    scale = 1 / np.sqrt(np.diag(matrix))
    matrix, vector, room = matrix * np.outer(scale, scale), vector * scale, (lower, upper)
    lower, upper = lower / scale, upper / scale
    side, fewest, left = np.zeros(len(vector), dtype=np.int8), len(vector) + 1, _PATIENCE
    while True:
        x = np.where(side > 0, upper, np.where(side < 0, lower, 0.0))
        free = side == 0
        if free.any():
            pull = vector[free] + matrix[np.ix_(free, ~free)] @ x[~free]
            x[free] = -cho_solve(cho_factor(matrix[np.ix_(free, free)]), pull)
        slope = matrix @ x + vector
        slack = _ROUNDING * (1 + np.abs(vector))
        wanted = np.where(free & (x > upper), 1, np.where(free & (x < lower), -1, side))
        wanted = np.where(~free & (side * slope > slack), 0, wanted).astype(np.int8)
        broken = np.flatnonzero(wanted != side)
        if not len(broken):
            return np.asarray(np.clip(x * scale, *room), dtype=np.float64)
        if len(broken) < fewest:
            fewest, left = len(broken), _PATIENCE
        else:
            left -= 1
        changed = broken if left > 0 else broken[-1:]
        side[changed] = wanted[changed]


_ROUNDING = 1e-12
"""Of a slope: below it an unknown at its bound may stay there."""


@dataclass(frozen=True)
class Fit:
    """A shape and the poses it was found with."""

    space: ShapeSpace
    looks: tuple[Look, ...]
    shape: Array
    """(S,) in units of the shape space."""

    poses: Array
    """(Q,) all pose values, rad and m."""

    covariance: Array
    """(S, S) of the shape."""

    rows: tuple[Rows, ...] = ()
    """Correspondences of each look, in the last step."""

    @property
    def body(self) -> BodyModel:
        """The body found."""
        return self.space.body(self.shape)

    def pose(self, look: int) -> Array:
        """(dof,) the pose in a look."""
        q: Array = self.poses[self.looks[look].columns]
        return q


def fit(task: Task, shape: Array, poses: Array, free: Sequence[str] = ("pose", "size", "form")) -> Fit:
    """Fits shape and poses from a start.

    Args:
        task: what is fitted to what.
        shape: (S,) start.
        poses: (Q,) start; the prior of the poses is around it.
        free: what may move in the end: `pose` alone, with `size` (lengths, girths), with `form` (everything).
    """
    settings, start = task.settings, poses
    gates = np.geomspace(settings.gate_m, settings.final_gate_m, settings.iterations)
    kinds = [free_at(k / settings.iterations, settings.rigid_share, free) for k in range(settings.iterations)]
    matrix = np.zeros((0, 0))
    rows: tuple[Rows, ...] = ()
    variance = settings.noise_m**2
    for k, (gate, kind) in enumerate(zip(gates, kinds, strict=True)):
        task.progress("fitting shape and pose", k, settings.iterations)
        body, neighbours = task.space.body(shape), task.space.neighbours(shape)
        steps = task.space.steps(shape)
        bodies = (body, neighbours, steps)
        rows = tuple(_rows(task, look, bodies, poses[look.columns], gate) for look in task.looks)
        matrix, vector, variance = _equations(task, rows, bodies, poses, gate)
        prior, pull = prior_of(task, (shape, poses - start), poses, kind)
        room = room_of(task, body, shape, poses)
        step = bounded_step(matrix + variance * prior, vector + variance * pull, *room)
        shape, poses = shape + step[: len(shape)], poses + step[len(shape) :]
    task.progress("fitting shape and pose", settings.iterations, settings.iterations)
    prior, _ = prior_of(task, (shape, poses - start), poses, kinds[-1], ALIKE)
    covariance = np.asarray(np.linalg.inv(matrix / variance + prior), dtype=np.float64)
    return Fit(task.space, task.looks, frozen(shape), frozen(poses), covariance[: len(shape), : len(shape)], rows)


def _rows(task: Task, look: Look, bodies: Bodies, q: Array, gate_m: float) -> Rows:
    rows = look_rows(look, bodies, q, task.synthesis, (gate_m, task.settings.direction_deg))
    # Each length counts twice, from the model to the image and back.
    weights = rows.lengths_m / (2 * task.settings.correlation_m) / (1 + (rows.residuals / (0.5 * gate_m)) ** 2) ** 2
    weights = np.where(rows.inner, task.settings.edge_weight, 1.0) * weights
    rows = replace(rows, weights=weights)
    if look.cloud is not None:
        noise = task.settings.noise_m, task.settings.correlation_m
        rows = rows.joined(surface_rows(look.cloud, bodies[0], q, (gate_m, task.settings.facing_deg), noise))
    return rows


def _direct(task: Task, k: int, bodies: Bodies, q: Array) -> Iterator[Direct]:
    """Residuals of look k that are no contour's: clicked joints, and with the first one a height that was given."""
    noise_m = task.settings.noise_m
    if task.looks[k].marks:
        # A click weighs as its standard deviation says, against that of a contour.
        yield mark_rows(task.looks[k], bodies, q, noise_m / task.settings.click_px)
    if k == 0 and task.stature_m is not None:
        yield height_row(bodies, task.stature_m, noise_m / task.settings.stature_sigma_m)


def _tied(task: Task, tracks: Tracks, bodies: Bodies, poses: Array, gate_m: float) -> Tied:
    noise = task.settings.noise_m, task.settings.correlation_m
    return tied(tracks, bodies, poses, [look.columns for look in task.looks], gate_m, noise)


def _equations(
    task: Task, rows: Sequence[Rows], bodies: Bodies, poses: Array, gate_m: float
) -> tuple[Array, Array, float]:
    """J^T W J, J^T W r and the variance of a residual, m^2."""
    n_shape, n = len(bodies[2]), len(bodies[2]) + len(poses)
    matrix, vector, squares, total = np.zeros((n, n)), np.zeros(n), 0.0, 0.0
    lasting = Lasting(n, task.settings.lasting)
    for look, one in zip(task.looks, rows, strict=True):
        q = poses[look.columns]
        slopes = part_slopes(bodies, q)
        own, pull = _summed(one, slopes)
        unknowns = np.concatenate([np.arange(n_shape), n_shape + look.columns])
        lasting.add(one, slopes, unknowns)
        squares += float((one.weights * one.residuals**2).sum())
        total += float(one.weights.sum())
        matrix[np.ix_(unknowns, unknowns)] += own
        vector[unknowns] += pull
    matrix, vector = lasting.taken_from(matrix, vector)
    for k, look in enumerate(task.looks):
        unknowns = np.concatenate([np.arange(n_shape), n_shape + look.columns])
        for direct in _direct(task, k, bodies, poses[look.columns]):
            matrix[np.ix_(unknowns, unknowns)] += direct.jacobian.T @ direct.jacobian
            vector[unknowns] += direct.jacobian.T @ direct.residuals
            squares += float((direct.residuals**2).sum())
            total += len(direct.residuals)
    if task.tracks is not None:
        found = _tied(task, task.tracks, bodies, poses, gate_m)
        matrix, vector = matrix + found.matrix, vector + found.vector
        squares, total = squares + found.squares, total + found.total
    return matrix, vector, max(task.settings.noise_m**2, squares / total if total else 0.0)


def _summed(rows: Rows, slopes: Array) -> tuple[Array, Array]:
    """J^T W J and J^T W r of a look's rows; the sums over the points of a part come first."""
    n = slopes.shape[-1]
    matrix, vector = np.zeros((n, n)), np.zeros(n)
    for p in np.unique(rows.parts):
        mine = rows.parts == p
        asks = rows.asks[mine]
        weighted = asks * rows.weights[mine, None]
        matrix += slopes[p].T @ (weighted.T @ asks) @ slopes[p]
        vector += (rows.residuals[mine] @ weighted) @ slopes[p]
    return matrix, vector
