"""What shape and poses are fitted to, and what is known of both before: settings, links and how far they may move."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import pydantic

from tracker.acquisition._surface_points import Tracks
from tracker.acquisition.clouds import Look
from tracker.acquisition.shape_space import ShapeSpace
from tracker.bodies.body import BodyModel
from tracker.foundation.arrays import Array
from tracker.foundation.configuration.components import component
from tracker.foundation.progress import Progress, silent
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
