"""Shape and poses together: Gauss-Newton on oriented correspondences between model contours and the images."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pydantic
from scipy.linalg import cholesky, solve_triangular
from scipy.optimize import lsq_linear

from tracker.acquisition._residuals import Bodies, Rows, height_row, look_rows, mark_rows
from tracker.acquisition._surface_rows import surface_rows
from tracker.acquisition._tied import Tied, Tracks, tied
from tracker.acquisition.looks import Look
from tracker.acquisition.shape_space import ShapeSpace
from tracker.arrays import Array, frozen
from tracker.body import BodyModel
from tracker.components import component
from tracker.progress import Progress, silent
from tracker.synthesis import Synthesis


@component
class FitSettings:
    """How shape and poses are fitted."""

    iterations: int = pydantic.Field(default=24, ge=2)
    """Gauss-Newton steps."""

    gate_m: float = pydantic.Field(default=0.12, gt=0)
    """Largest distance of a pair of model and image contour at the start, metres at the person."""

    final_gate_m: float = pydantic.Field(default=0.025, gt=0)
    """The same at the end, metres."""

    direction_deg: float = pydantic.Field(default=40.0, gt=0, le=90)
    """Largest angle between the normals of a pair, degrees."""

    facing_deg: float = pydantic.Field(default=60.0, gt=0, le=90)
    """Largest angle between the normals of a measured surface point and of the model's surface, degrees: the one comes
    from twelve neighbours, on a forearm from a third of its way around."""

    rigid_share: float = pydantic.Field(default=0.3, ge=0, le=1)
    """Share of the steps in which only the pose moves; in as many more also lengths and girths; then everything."""

    edge_weight: float = pydantic.Field(default=0.5, ge=0)
    """Weight of edges inside the silhouette against its outline."""

    pose_deg: float = pydantic.Field(default=15.0, gt=0)
    """Standard deviation of an angle around the start, degrees."""

    pose_m: float = pydantic.Field(default=0.3, gt=0)
    """Standard deviation of a translation around the start, metres."""

    noise_m: float = pydantic.Field(default=0.005, gt=0)
    """Least standard deviation of a contour against the model, metres: clothes and muscles are no superquadrics."""

    correlation_m: float = pydantic.Field(default=0.1, gt=0)
    """Length of contour over which it departs from the model alike, metres: so much counts as one observation."""

    stature_sigma_m: float = pydantic.Field(default=0.005, gt=0)
    """Standard deviation of a height that was given, metres."""

    click_px: float = pydantic.Field(default=3.0, gt=0)
    """Standard deviation of a clicked point, px."""


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


@dataclass(frozen=True)
class Task:
    """Everything that stays the same while fitting."""

    space: ShapeSpace
    looks: tuple[Look, ...]
    synthesis: Synthesis
    settings: FitSettings = field(default_factory=FitSettings)
    pose_sigmas: Array | None = None
    """(Q,) standard deviations around the start; None for those of the settings."""

    tracks: Tracks | None = None
    """Points that were followed from look to look."""

    links: tuple[tuple[int, int, float], ...] = ()
    """Pairs of pose values that differ by a standard deviation only."""

    stature_m: float | None = None
    """Height of the person, if it is known, metres."""

    progress: Progress = silent


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
    sigmas = _pose_sigmas(task)
    kinds = [_free_at(k / settings.iterations, settings.rigid_share, free) for k in range(settings.iterations)]
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
        prior, pull = _prior(task, (shape, poses - start, poses), (shape_sigmas(task.space, kind), sigmas))
        room = _room(task, body, shape, poses)
        step = _bounded(matrix + variance * prior, vector + variance * pull, room)
        shape, poses = shape + step[: len(shape)], poses + step[len(shape) :]
    task.progress("fitting shape and pose", settings.iterations, settings.iterations)
    prior, _ = _prior(task, (shape, poses - start, poses), (shape_sigmas(task.space, kinds[-1]), sigmas))
    covariance = np.asarray(np.linalg.inv(matrix / variance + prior), dtype=np.float64)
    return Fit(task.space, task.looks, frozen(shape), frozen(poses), covariance[: len(shape), : len(shape)], rows)


def _prior(task: Task, offsets: tuple[Array, Array, Array], sigmas: tuple[Array, Array]) -> tuple[Array, Array]:
    """Information matrix (n, n) of the priors and its product with the offsets from them (n,).

    Args:
        task: with the links between pose values.
        offsets: of the shape, of the poses from their start, and the poses themselves.
        sigmas: standard deviations of shape and poses.
    """
    shape, moved, poses = offsets
    weights = 1 / np.concatenate(sigmas) ** 2
    matrix, pull = np.diag(weights), weights * np.concatenate([shape, moved])
    for a, b, sigma in task.links:
        i, j = len(shape) + a, len(shape) + b
        gap = (poses[a] - poses[b]) / sigma**2
        pull[i] += gap
        pull[j] -= gap
        matrix[[i, j], [i, j]] += 1 / sigma**2
        matrix[[i, j], [j, i]] -= 1 / sigma**2
    return matrix, pull


def _free_at(progress: float, rigid_share: float, free: Sequence[str]) -> str:
    """The most that may move after a share of the steps."""
    order = ["pose", "size", "form"]
    wanted = min(int(progress / rigid_share) if rigid_share > 0 else 2, 2)
    return order[min(wanted, max(order.index(kind) for kind in free))]


def shape_sigmas(space: ShapeSpace, kind: str) -> Array:
    """(S,) the prior's standard deviations; tiny for what must not move yet."""
    held = 1e-7
    if kind == "pose":
        return np.full(len(space.names), held)
    if kind == "form":
        return space.sigmas
    whole = np.array([parameter.part is None or ".radius" in parameter.name for parameter in space.parameters])
    sigmas: Array = np.where(whole, space.sigmas, held)
    return sigmas


def _pose_sigmas(task: Task) -> Array:
    if task.pose_sigmas is not None:
        return task.pose_sigmas
    rotates = task.space.description.build().rotates
    sigmas = np.zeros(1 + max(int(look.columns.max()) for look in task.looks))
    for look in task.looks:
        sigmas[look.columns] = np.where(rotates, np.radians(task.settings.pose_deg), task.settings.pose_m)
    return sigmas


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


def _room(task: Task, body: BodyModel, shape: Array, poses: Array) -> tuple[Array, Array]:
    """How far every unknown may move down and up."""
    low, high = np.full(len(poses), -np.inf), np.full(len(poses), np.inf)
    for look in task.looks:
        low[look.columns], high[look.columns] = body.limits.T
    lower = np.concatenate([task.space.limits[:, 0] - shape, np.minimum(low - poses, 0)])
    upper = np.concatenate([task.space.limits[:, 1] - shape, np.maximum(high - poses, 0)])
    return np.minimum(lower, -1e-12), np.maximum(upper, 1e-12)


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
