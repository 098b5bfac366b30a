"""Acquisition from points: shape and poses from surface points, silhouettes and trajectories of one or more moments.

D'Apuzzo, Plaenkers, Fua 2000, section 3: points on the surface and its outline are what a body model is fitted to;
Plaenkers & D'Apuzzo 1999 fit metaballs, here the parts are superquadrics.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
import pydantic
from scipy.spatial import cKDTree

from tracker.acquisition._surface_points import Tracks, outside
from tracker.acquisition.clouds import Cloud, Look, Mark, cloud_of
from tracker.acquisition.fitting import Fit, FitSettings, Task, fit
from tracker.acquisition.shape_space import ShapePrior, ShapeSpace
from tracker.bodies.body import BodyModel
from tracker.bodies.body.surface import surface_of
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, frozen
from tracker.foundation.configuration.components import component
from tracker.foundation.errors import SequenceError
from tracker.foundation.progress import Progress, silent
from tracker.images.sight import Observation
from tracker.points.following.tables import PointTable
from tracker.synthesis.cpu import CpuSynthesis

_HEADINGS_DEG = np.arange(0, 360, 45)
"""Directions that the person may face: those between are within reach of the steps."""

_ARMS_DEG, _LEGS_DEG = (8.0, 40.0, 85.0), 6.0
"""Abductions that are tried: hanging arms, A-pose, T-pose; feet a little apart."""

_SPACING_M = 0.05
"""Of the points that starts are moved to: 700 of a whole body."""

_START_GATES_M = np.geomspace(0.4, 0.06, 14)
"""Of the steps from a start: half of the first is how far an arm may be from where it is looked for."""

_START_MOST_M = 0.1
"""Distance from which a point is simply wrong."""

_PRIOR_DEG, _PRIOR_M, _NOISE_M = 40.0, 1.0, 0.03
"""Standard deviations of angles and shifts about a start, and of points while the shape is not yet right."""

_OTHER_DEG = 60.0
"""A heading farther off than this is another one."""

_POINTS_TO_MODEL = 2.0
"""What a point off the model counts more than a place of the model without a point: points may be partial."""


@dataclass(frozen=True)
class Posed:
    """A posture among points."""

    q: Array
    """(dof,) rad and m."""

    distance_m: float
    """Mean of the distances from points to model and from model to points, clamped at 0.1 m."""

    heading_deg: float
    """Direction faced, from x towards y, degrees."""


def standing_among(body: BodyModel, cloud: Cloud, heading_deg: float | None = None) -> tuple[Posed, ...]:
    """The posture of all starts that fits the points best, and the best one that faces elsewhere.

    Args:
        body: the body in about the right size.
        cloud: points of most of one person.
        heading_deg: direction faced, within 60 degrees; None for any.
    """
    coarse = cloud_of(cloud.points, cloud.sigmas, _SPACING_M)
    surface, tree = surface_of(body, 7, 10).points, cKDTree(coarse.points)
    found = []
    for q in _starts(body, coarse, surface):
        moved = moved_to(body, q, coarse, _START_GATES_M)
        faced = float(np.degrees(moved[body.root.turn])) % 360
        if heading_deg is None or _apart_deg(faced, heading_deg) <= _OTHER_DEG:
            found.append(Posed(moved, _misfit(body, moved, coarse, tree), faced))
    if not found:
        return ()
    best = min(found, key=lambda one: one.distance_m)
    others = [one for one in found if _apart_deg(one.heading_deg, best.heading_deg) > _OTHER_DEG]
    return best, *sorted(others, key=lambda one: one.distance_m)[:1]


def _apart_deg(one: float, other: float) -> float:
    return abs((one - other + 180) % 360 - 180)


def moved_to(body: BodyModel, start: Array, cloud: Cloud, gates_m: Array) -> Array:
    """A pose (dof,) moved by Gauss-Newton steps until the body's outside lies on the points.

    Args:
        body: the body.
        start: (dof,) rad and m.
        cloud: the points.
        gates_m: one a step: a point half as far off has a quarter of its weight, metres.
    """
    q = start
    prior = np.where(body.rotates, np.radians(_PRIOR_DEG), _PRIOR_M) ** -2.0
    for gate_m in gates_m:
        part, feet, normals = outside(body.world_from_part(q), body.shapes, cloud.points)
        gap = ((feet - cloud.points) * normals).sum(axis=1)
        weights = (1 + (gap / (0.5 * gate_m)) ** 2) ** -2.0
        weights *= np.abs((normals * cloud.normals).sum(axis=1)) > 0.5
        jacobian = np.einsum("ni,nij->nj", normals, body.point_jacobian(q, feet, body.part_parameters[part]))
        weighted = weights[:, None] * jacobian / _NOISE_M**2
        matrix, vector = jacobian.T @ weighted + np.diag(prior), weighted.T @ gap + prior * (q - start)
        q = body.clamped(q - np.linalg.solve(matrix, vector))
    return q


def _starts(body: BodyModel, cloud: Cloud, surface: Array) -> Iterator[Array]:
    """Poses (dof,) whose middle is that of the points."""
    root, middle = body.root, _middle(cloud.points)
    arms = [k for name in ("arm_abduction",) for k in _columns(body, name)]
    for heading_deg, arms_deg in product(_HEADINGS_DEG, _ARMS_DEG if arms else (0.0,)):
        q = body.rest()
        q[arms] = np.radians(arms_deg)
        q[_columns(body, "leg_abduction")] = np.radians(_LEGS_DEG)
        q[root.turn] = np.radians(heading_deg)
        q[root.shifts] += middle - _middle(surface)
        yield body.clamped(q)


def _columns(body: BodyModel, name: str) -> list[int]:
    """Columns of a parameter on both sides; none where the body has no such."""
    return [body.names.index(own) for own in body.mirror.meant(name, body.names)]


def _middle(points: Array) -> Array:
    """Of the box around all but a few points, (3,) metres."""
    low, high = np.percentile(points, [1, 99], axis=0)
    middle: Array = (low + high) / 2
    return middle


def _misfit(body: BodyModel, q: Array, cloud: Cloud, tree: cKDTree) -> float:
    _, feet, _ = outside(body.world_from_part(q), body.shapes, cloud.points)
    there = np.linalg.norm(feet - cloud.points, axis=1)
    back = np.asarray(tree.query(_outer_grid(body, q))[0])
    one, other = (float(np.minimum(gaps, _START_MOST_M).mean()) for gaps in (there, back))
    return (_POINTS_TO_MODEL * one + other) / (_POINTS_TO_MODEL + 1)


def _outer_grid(body: BodyModel, q: Array) -> Array:
    """Places (N, 3) of all parts' surfaces that lie in no other part, metres."""
    placed, points = body.world_from_part(q), []
    eta, omega = np.linspace(-1.3, 1.3, 6)[:, None], np.linspace(-np.pi, np.pi, 9)[:-1]
    for part, own in zip(body.parts, placed, strict=True):
        local, _ = part.shape.surface(eta, omega)
        points.append(local.reshape(-1, 3) @ own[:3, :3].T + own[:3, 3])
    every = np.concatenate(points)
    carriers = np.repeat(np.arange(len(points)), [len(one) for one in points])
    grid: Array = every[outside(placed, body.shapes, every)[0] == carriers]
    return grid


_MOST_M = 0.05
"""A point farther off than this is simply wrong, whichever way the body faces, metres."""

_GATES_M = np.geomspace(0.2, 0.05, 10)
"""Of the steps from one moment's pose to the next one's."""


@component
class PointSettings:
    """Settings of an acquisition from surface points."""

    prior: ShapePrior = ShapePrior()
    """Differences between persons."""

    fit: FitSettings = FitSettings(
        iterations=16, gate_m=0.1, final_gate_m=0.03, pose_deg=15.0, pose_m=0.1, rigid_share=0.25
    )
    """The refinement of shape and poses."""

    spacing_m: float = pydantic.Field(default=0.015, gt=0.001, lt=0.1)
    """Points are thinned to this distance, metres."""

    tracks_spacing_m: float = pydantic.Field(default=0.03, gt=0.001, lt=0.2)
    """Trajectories are thinned to this distance, metres."""

    least_explained: float = pydantic.Field(default=0.7, gt=0, lt=1)
    """Least share of the points within twice the last gate's half: below it the person was not found."""

    heading_deg: float | None = None
    """Direction that the person faces in the first moment, from x towards y, degrees, within 60; None to find it."""

    least_lead: float = pydantic.Field(default=0.1, ge=0, lt=1)
    """A body must fit the points better by this share than one with another heading; otherwise the heading must be
    given."""


@dataclass(frozen=True)
class Moment:
    """Data of a person at one time."""

    cloud: Cloud
    rig: Rig
    """Cameras of the silhouettes, or of pictures of the points."""

    outlines: Observation | None = None
    marks: tuple[Mark, ...] = ()
    q: Array | None = None
    """(dof,) the start pose, where it is given."""

    frame: int = 0
    """Number among those of the trajectories."""


@dataclass(frozen=True)
class FromPoints:
    """Outcome of an acquisition."""

    fit: Fit
    explained: tuple[float, ...]
    """Share of each moment's points on the model's surface."""

    before: tuple[float, ...]
    """The same with the model begun with, only posed."""

    rms_mm: float
    """Of the distances of points on the surface, millimetres."""

    n_tracks: int
    """Trajectories that hold parts together."""


def acquire_from_points(
    space: ShapeSpace,
    moments: Sequence[Moment],
    settings: PointSettings,
    trajectories: PointTable | None = None,
    stature_m: float | None = None,
    progress: Progress = silent,
) -> FromPoints:
    """Acquires a body; the first moment is searched unless its pose is given, the others begin where it ends.

    Args:
        space: the ways in which the body may differ.
        moments: the points.
        settings: priors and steps.
        trajectories: of followed points, in the world of the points.
        stature_m: the person's height, where it is known.
        progress: gets the progress.

    Raises:
        SequenceError: the body does not fit the points, or a moment is no frame of the trajectories.
    """
    progress("finding the person")
    body = space.body(np.zeros(len(space.names)))
    columns = [k * body.dof + np.arange(body.dof, dtype=np.int64) for k in range(len(moments))]
    looks = tuple(
        Look(one.rig, own, one.outlines, None, one.marks, one.cloud) for one, own in zip(moments, columns, strict=True)
    )
    tracks = None if trajectories is None else tracks_of(trajectories, moments, settings.tracks_spacing_m)
    task = Task(space, looks, CpuSynthesis(), settings.fit, None, tracks, (), stature_m, progress)
    sized, found = _surest(task, moments, settings)
    near_m = settings.fit.final_gate_m
    explained, gaps = _explained(found, near_m)
    _check(explained, near_m, settings)
    rms_mm = 1000 * float(np.sqrt(np.mean(gaps[gaps < near_m] ** 2)))
    n_tracks = 0 if tracks is None else int((np.isfinite(tracks.places[..., 0]).sum(axis=0) > 1).sum())
    return FromPoints(found, explained, _explained(sized, near_m)[0], rms_mm, n_tracks)


def _surest(task: Task, moments: Sequence[Moment], settings: PointSettings) -> tuple[Fit, Fit]:
    """The body only posed and the one fitted, from the start that fits best in the end.

    Raises:
        SequenceError: no start has the given heading, or bodies with two headings fit equally: from the front and from
            behind, a trunk looks the same.
    """
    space = task.space
    shape = np.zeros(len(space.names))
    body = space.body(shape)
    first = moments[0]
    starts: tuple[Posed, ...] = ()
    if first.q is None:
        starts = standing_among(body, first.cloud, settings.heading_deg)
        if not starts:
            raise SequenceError(f"no body that faces {settings.heading_deg:g} degrees fits the points of moment 1")
    begun = [one.q for one in starts] if first.q is None else [body.clamped(first.q)]
    tried = []
    for q in begun:
        sized = fit(task, shape, np.concatenate(_posed(body, q, moments)), ("pose",))
        found = fit(task, sized.shape, sized.poses)
        gaps = np.minimum(_explained(found, settings.fit.final_gate_m)[1], _MOST_M)
        tried.append((float(gaps.mean()), sized, found))
    order = np.argsort([one[0] for one in tried])
    if len(order) > 1:
        lead = 1 - tried[order[0]][0] / tried[order[1]][0]
        if lead < settings.least_lead:
            one, other = (starts[k].heading_deg for k in order)
            raise SequenceError(
                f"the person may face {one:.0f} or {other:.0f} degrees: the first fits the points only {lead:.0%} "
                "better; say which with [acquisition] heading_deg (from x towards y), or give poses as start"
            )
    _, sized, found = tried[order[0]]
    return sized, found


def _posed(body: BodyModel, q: Array, moments: Sequence[Moment]) -> list[Array]:
    """The poses to begin with: as given, or moved on from moment to moment."""
    poses = [q]
    for moment in moments[1:]:
        begun = moved_to(body, poses[-1], moment.cloud, _GATES_M) if moment.q is None else body.clamped(moment.q)
        poses.append(begun)
    return poses


def tracks_of(trajectories: PointTable, moments: Sequence[Moment], spacing_m: float) -> Tracks:
    """The trajectories in the frames of the moments, thinned.

    Raises:
        SequenceError: they lie in an image, or have no such frame.
    """
    if trajectories.flat:
        raise SequenceError("trajectories in the image of one view (2-D mode): a model needs those of points in space")
    rows = [moment.frame - int(trajectories.frames[0]) for moment in moments]
    for moment, row in zip(moments, rows, strict=True):
        if not 0 <= row < len(trajectories.frames):
            first, last = int(trajectories.frames[0]), int(trajectories.frames[-1])
            raise SequenceError(f"no frame {moment.frame} in the trajectories, expected {first} to {last}")
    places = trajectories.positions[rows]
    shown = np.flatnonzero(np.isfinite(places[..., 0]).sum(axis=0) > 1)
    first = np.isfinite(places[:, shown, 0]).argmax(axis=0)
    cubes = np.floor(places[first, shown] / spacing_m).astype(np.int64)
    # the moment that shows a point first is part of its cube: what is seen later does not hide it
    _, kept = np.unique(np.column_stack([first, cubes]), axis=0, return_index=True)
    shown = shown[np.sort(kept)]
    sigmas = np.sqrt(np.trace(trajectories.covariances[rows][:, shown], axis1=2, axis2=3) / 3)
    return Tracks(frozen(places[:, shown]), frozen(sigmas), spacing_m)


def _explained(found: Fit, near_m: float) -> tuple[tuple[float, ...], Array]:
    """Share of each look's points nearer to the surface than a distance, and how far all of them are, metres."""
    body, shares, every = found.body, list[float](), list[Array]()
    for k, look in enumerate(found.looks):
        assert look.cloud is not None
        _, feet, normals = outside(body.world_from_part(found.pose(k)), body.shapes, look.cloud.points)
        gaps = np.abs(((feet - look.cloud.points) * normals).sum(axis=1))
        shares.append(float((gaps < near_m).mean()))
        every.append(gaps)
    return tuple(shares), np.concatenate(every)


def _check(explained: Sequence[float], near_m: float, settings: PointSettings) -> None:
    """Refuses a body that does not lie on the points."""
    worst = int(np.argmin(explained))
    if explained[worst] < settings.least_explained:
        raise SequenceError(
            f"moment {worst + 1}: {explained[worst]:.0%} of the points lie within {1000 * near_m:.0f} mm of the fitted "
            f"body, expected at least {settings.least_explained:.0%}: another person or furniture among the points, a "
            'wrong stature_m, or a posture that was not found: give it with start = "poses.csv"'
        )
