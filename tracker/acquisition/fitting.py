"""Shape and poses together: Gauss-Newton on oriented correspondences between model contours and the images."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.optimize import lsq_linear

from tracker.acquisition._residuals import Bodies, Rows, height_row, look_rows, mark_rows
from tracker.acquisition._surface_rows import surface_rows
from tracker.acquisition._tied import Tied, Tracks, tied
from tracker.acquisition.fit_task import Task, free_at, pose_sigmas, prior_of, room_of, shape_sigmas
from tracker.acquisition.looks import Look
from tracker.acquisition.shape_space import ShapeSpace
from tracker.arrays import Array, frozen
from tracker.body import BodyModel


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
    sigmas = pose_sigmas(task)
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
        if task.stature_m is not None:
            height = height_row(bodies, task.stature_m, settings.noise_m / settings.stature_sigma_m)
            rows = (rows[0].joined(height), *rows[1:])
        found = None if task.tracks is None else _tied(task, task.tracks, bodies, poses, gate)
        matrix, vector, variance = _equations(task, rows, found, len(shape), len(poses))
        prior, pull = prior_of(task, (shape, poses - start, poses), (shape_sigmas(task.space, kind), sigmas))
        room = room_of(task, body, shape, poses)
        step = _bounded(matrix + variance * prior, vector + variance * pull, room)
        shape, poses = shape + step[: len(shape)], poses + step[len(shape) :]
    task.progress("fitting shape and pose", settings.iterations, settings.iterations)
    prior, _ = prior_of(task, (shape, poses - start, poses), (shape_sigmas(task.space, kinds[-1]), sigmas))
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
        rows = rows.joined(surface_rows(look.cloud, bodies, q, (gate_m, task.settings.facing_deg), noise))
    if look.marks:
        # A click weighs as its standard deviation says, against that of a contour.
        rows = rows.joined(mark_rows(look, bodies, q, task.settings.noise_m / task.settings.click_px))
    return rows


def _tied(task: Task, tracks: Tracks, bodies: Bodies, poses: Array, gate_m: float) -> Tied:
    noise = task.settings.noise_m, task.settings.correlation_m
    return tied(tracks, bodies, poses, [look.columns for look in task.looks], gate_m, noise)


def _equations(
    task: Task, rows: Sequence[Rows], found: Tied | None, n_shape: int, n_pose: int
) -> tuple[Array, Array, float]:
    """J^T W J, J^T W r and the variance of a residual, m^2."""
    n = n_shape + n_pose
    matrix, vector, squares, total = np.zeros((n, n)), np.zeros(n), 0.0, 0.0
    if found is not None:
        matrix, vector, squares, total = found.matrix, found.vector, found.squares, found.total
    for look, one in zip(task.looks, rows, strict=True):
        unknowns = np.concatenate([np.arange(n_shape), n_shape + look.columns])
        weighted = one.jacobian * one.weights[:, None]
        matrix[np.ix_(unknowns, unknowns)] += weighted.T @ one.jacobian
        vector[unknowns] += weighted.T @ one.residuals
        squares += float((one.weights * one.residuals**2).sum())
        total += float(one.weights.sum())
    return matrix, vector, max(task.settings.noise_m**2, squares / total if total else 0.0)


def _bounded(matrix: Array, vector: Array, room: tuple[Array, Array]) -> Array:
    """The step of least quadratic cost within bounds."""
    scale = 1 / np.sqrt(np.diag(matrix))
    upper = cholesky(matrix * np.outer(scale, scale))
    target = -solve_triangular(upper, vector * scale, trans="T")
    lower, higher = room[0] / scale, room[1] / scale
    free = solve_triangular(upper, target)
    if (free >= lower).all() and (free <= higher).all():
        return np.asarray(free * scale, dtype=np.float64)
    found = lsq_linear(upper, target, (lower, higher), method="bvls", max_iter=200)
    return np.asarray(found.x * scale, dtype=np.float64)
