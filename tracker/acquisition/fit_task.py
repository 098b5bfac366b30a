"""What shape and poses are fitted to, and what is known of both before: settings, links and how far they may move."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import pydantic

from tracker.acquisition._tied import Tracks
from tracker.acquisition.looks import Look
from tracker.acquisition.shape_space import ShapeSpace
from tracker.arrays import Array
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


def prior_of(task: Task, offsets: tuple[Array, Array, Array], sigmas: tuple[Array, Array]) -> tuple[Array, Array]:
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


def free_at(progress: float, rigid_share: float, free: Sequence[str]) -> str:
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


def pose_sigmas(task: Task) -> Array:
    """(Q,) the prior's standard deviations of the poses around their start."""
    if task.pose_sigmas is not None:
        return task.pose_sigmas
    rotates = task.space.description.build().rotates
    sigmas = np.zeros(1 + max(int(look.columns.max()) for look in task.looks))
    for look in task.looks:
        sigmas[look.columns] = np.where(rotates, np.radians(task.settings.pose_deg), task.settings.pose_m)
    return sigmas


def room_of(task: Task, body: BodyModel, shape: Array, poses: Array) -> tuple[Array, Array]:
    """How far every unknown may move down and up."""
    low, high = np.full(len(poses), -np.inf), np.full(len(poses), np.inf)
    for look in task.looks:
        low[look.columns], high[look.columns] = body.limits.T
    lower = np.concatenate([task.space.limits[:, 0] - shape, np.minimum(low - poses, 0)])
    upper = np.concatenate([task.space.limits[:, 1] - shape, np.maximum(high - poses, 0)])
    return np.minimum(lower, -1e-12), np.maximum(upper, 1e-12)
