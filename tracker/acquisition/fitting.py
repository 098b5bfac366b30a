"""Shape and poses together: Gauss-Newton on oriented correspondences between model contours and the images."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pydantic
from scipy.linalg import cho_factor, cho_solve

from tracker.acquisition._residuals import Bodies, Direct, Lasting, Rows, height_row, look_rows, mark_rows, part_slopes
from tracker.acquisition._surface_points import Tied, Tracks, surface_rows, tied
from tracker.acquisition.clouds import Look
from tracker.acquisition.shape_space import ShapeSpace
from tracker.bodies.body import BodyModel
from tracker.foundation.arrays import Array, frozen
from tracker.foundation.configuration.components import component
from tracker.foundation.progress import Progress, silent
from tracker.synthesis import Synthesis


@component
class FitSettings:
    """Settings of the fit of shape and poses."""

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

    lasting: float = pydantic.Field(default=0.0, ge=0, lt=1)
    """Share of that variance that stays on the body from look to look and from view to view, as clothes do."""

    stature_sigma_m: float = pydantic.Field(default=0.005, gt=0)
    """Standard deviation of a height that was given, metres."""

    click_px: float = pydantic.Field(default=3.0, gt=0)
    """Standard deviation of a clicked point, px."""


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


def prior_of(
    task: Task, offsets: tuple[Array, Array], poses: Array, kind: str, alike: float = 0.0
) -> tuple[Array, Array]:
    """Information matrix (n, n) of the priors and its product with the offsets from them (n,).

    Args:
        task: with the links between pose values.
        offsets: of the shape, and of the poses from their start.
        poses: (Q,) themselves.
        kind: of shape parameters that may move, see `free_at`.
        alike: standard deviation of an offset that the poses of all looks share, over that of each pose.
    """
    shape, moved = offsets
    n_shape = len(shape)
    matrix = np.zeros((n_shape + len(poses), n_shape + len(poses)))
    matrix[:n_shape, :n_shape] = np.linalg.inv(_shape_covariance(task.space, kind))
    matrix[n_shape:, n_shape:] = _around_start(task, len(poses), alike)
    pull = matrix @ np.concatenate([shape, moved])
    usual, unusual = _usual(task, poses)
    matrix[n_shape:, n_shape:] += usual
    pull[n_shape:] += unusual
    for a, b, sigma in task.links:
        i, j = n_shape + a, n_shape + b
        gap = (poses[a] - poses[b]) / sigma**2
        pull[i] += gap
        pull[j] -= gap
        matrix[[i, j], [i, j]] += 1 / sigma**2
        matrix[[i, j], [j, i]] -= 1 / sigma**2
    return matrix, pull


ALIKE = 2.0
"""How far all looks may be off alike, over how far each is off (`prior_of`), as the covariance of a body has it.

Poses were found with one body, and what is wrong of it bends a joint the same way in each: twelve looks are no twelve
witnesses. With the scaled body arms and legs are 1 to 11 degrees off in all looks alike. The fit itself holds each
pose, which was found by more than contours: let go, the same looks were 27 mm off instead of 23, and an elbow 7 degrees
instead of 1: docs/lab/sure_bodies.md."""


def _around_start(task: Task, n: int, alike: float) -> Array:
    """(n, n) information of the poses around their start."""
    if task.pose_sigmas is not None:
        return np.diag(1 / task.pose_sigmas**2)
    rotates = task.space.general.rotates
    own = 1 / np.where(rotates, np.radians(task.settings.pose_deg), task.settings.pose_m) ** 2
    matrix, looks = np.zeros((n, n)), np.array([look.columns for look in task.looks])
    shared = alike**2 / (1 + len(looks) * alike**2)
    for column, weight in zip(looks.T, own, strict=True):
        matrix[np.ix_(column, column)] = weight * (np.eye(len(column)) - shared)
    return matrix


def _usual(task: Task, poses: Array) -> tuple[Array, Array]:
    """Information (Q, Q) of how persons usually are, on the mean over the looks, and its pull (Q,)."""
    matrix, pull = np.zeros((len(poses), len(poses))), np.zeros(len(poses))
    if task.pose_sigmas is None:
        body, looks = task.space.general, np.array([look.columns for look in task.looks])
        for k in np.flatnonzero(np.isfinite(body.spreads)):
            column, weight = looks[:, k], 1 / (len(looks) * body.spreads[k]) ** 2
            matrix[np.ix_(column, column)] = weight
            pull[column] = weight * (poses[column] - body.rest()[k]).sum()
    return matrix, pull


def free_at(progress: float, rigid_share: float, free: Sequence[str]) -> str:
    """The most that may move after a share of the steps."""
    order = ["pose", "size", "form"]
    wanted = min(int(progress / rigid_share) if rigid_share > 0 else 2, 2)
    return order[min(wanted, max(order.index(kind) for kind in free))]


def _shape_covariance(space: ShapeSpace, kind: str) -> Array:
    """(S, S) of the prior; tiny for what must not move yet."""
    if kind == "form":
        return space.covariance
    moves = np.array(
        [kind == "size" and (one.part is None or ".radius" in one.name) for one in space.parameters], dtype=np.bool_
    )
    shares = np.where(moves, 1.0, _HELD / space.sigmas)
    held: Array = shares[:, None] * space.covariance * shares
    return held


_HELD = 1e-7
"""Standard deviation of what does not move."""


def room_of(task: Task, body: BodyModel, shape: Array, poses: Array) -> tuple[Array, Array]:
    """How far every unknown may move down and up."""
    low, high = np.full(len(poses), -np.inf), np.full(len(poses), np.inf)
    for look in task.looks:
        low[look.columns], high[look.columns] = body.limits.T
    lower = np.concatenate([task.space.limits[:, 0] - shape, np.minimum(low - poses, 0)])
    upper = np.concatenate([task.space.limits[:, 1] - shape, np.maximum(high - poses, 0)])
    return np.minimum(lower, -1e-12), np.maximum(upper, 1e-12)


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
