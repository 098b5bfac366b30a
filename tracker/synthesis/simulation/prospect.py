"""Expected accuracy of cameras before filming: sigmas, gain of each view, hidden parts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from math import comb
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from scipy.ndimage import gaussian_filter

from tracker.bodies.body import BodyModel
from tracker.bodies.contours import PX_PER_OBSERVATION
from tracker.bodies.limbs import smallness
from tracker.bodies.scene import Scene
from tracker.cameras.camera import Camera
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array
from tracker.synthesis import Synthesis
from tracker.synthesis.simulation.common_volume import Floor, by_segment, sizes, visible_shares, way_of

PRIOR_DEG, PRIOR_M = 15.0, 0.15
"""Standard deviations of angles and places before the images are looked at: the defaults of `estimation.twist_icp`."""

_MOST_SUBSETS = 300
"""Subsets of one size that are looked through; of more views, the least useful are left out one by one."""


def view_information(scene: Scene, poses: Array, synthesis: Synthesis, edge_px: float) -> Array:
    """Information that each view gives of one person's pose.

    The contour of the visible parts is taken to be found with an error along its normal that is independent every
    `PX_PER_OBSERVATION` px, as the tracking takes it (D'Apuzzo's normal equations, as in `tracking.estimation`).

    Args:
        scene: the person alone, and the rig.
        poses: (B, dof) rad and m.
        synthesis: traces the contours.
        edge_px: standard deviation of an edge position, px.

    Returns:
        (B, V, dof, dof) in 1/rad^2 and 1/m^2.
    """
    body = scene.persons[0].body
    traced = synthesis.contours(scene, 0, poses)
    found = np.zeros((len(poses), len(scene.rig), body.dof, body.dof))
    for b, q in enumerate(poses):
        for v, camera in enumerate(scene.rig.cameras):
            n = int(traced.counts[b, v])
            points = traced.points[b, v, :n].astype(np.float64)
            samples = traced.positions[b, v, :n].astype(np.float64)
            motion = body.point_jacobian(q, points, body.part_parameters[traced.parts[b, v, :n]])
            across = np.einsum("ni,nij->nj", samples[:, 2:4], camera.project_jacobian(points))
            rows = np.einsum("nj,njd->nd", across, motion)
            found[b, v] = (rows * samples[:, 4:5]).T @ rows / (PX_PER_OBSERVATION * edge_px**2)
    return found


def covariances(body: BodyModel, information: Array, views: Sequence[int]) -> Array:
    """Covariances (B, dof, dof) of poses seen by some views.

    The refinement's prior, 15 degrees and 0.15 m, holds parameters that no view shows.

    Args:
        body: the person.
        information: (B, V, dof, dof) of `view_information`.
        views: numbers of the views.
    """
    spread = np.where(body.rotates, np.radians(PRIOR_DEG), PRIOR_M)
    total = information[:, list(views)].sum(axis=1) + np.diag(1 / spread**2)
    covariance: Array = np.linalg.inv(total)
    return covariance


def joint_sigmas(body: BodyModel, poses: Array, covariance: Array) -> Array:
    """Standard deviations (B, L) of all landmarks, metres: the root of the mean squared distance from the truth."""
    ends = np.array([mark.parameter for mark in body.landmarks])
    sigmas = np.zeros((len(poses), len(ends)))
    for b, q in enumerate(poses):
        motion = body.point_jacobian(q, body.landmarks_in_world(q), ends)
        sigmas[b] = np.sqrt(np.einsum("lid,de,lie->l", motion, covariance[b], motion))
    return sigmas


def best_views(body: BodyModel, poses: Array, information: Array) -> dict[int, tuple[int, ...]]:
    """For every number of views, from 2 to all, the views that together measure the joints best.

    If there are too many subsets of a size, the next larger one is left without its least useful view.

    Args:
        body: the person.
        poses: (B, dof).
        information: (B, V, dof, dof) of `view_information`.
    """
    n_views = information.shape[1]
    found: dict[int, tuple[int, ...]] = {n_views: tuple(range(n_views))}

    def error(views: Sequence[int]) -> float:
        sigmas = joint_sigmas(body, poses, covariances(body, information, views))
        return float(np.sqrt(np.mean(sigmas**2)))

    for n in range(n_views - 1, 1, -1):
        if comb(n_views, n) > _MOST_SUBSETS:
            subsets = [tuple(v for v in found[n + 1] if v != left_out) for left_out in found[n + 1]]
        else:
            subsets = list(combinations(range(n_views), n))
        found[n] = min(subsets, key=error)
    return dict(sorted(found.items()))


SHOWN = 0.25
"""Share of a segment's surface that a view must show to locate it."""

NEARLY = 1.5
"""Times the error of all cameras that fewer may have and still do."""

_POSES = 20
"""Poses of the movement that are looked at."""


@dataclass(frozen=True)
class Views:
    """Accuracy of some of the cameras."""

    names: tuple[str, ...]
    sigma_mm: float
    """Root mean square over joints and frames of the standard deviation of a joint."""

    worst_joint: str
    worst_mm: float
    """Its standard deviation, root mean square over the frames."""

    worst_angle: str
    worst_deg: float


@dataclass(frozen=True)
class Prospect:
    """Expected accuracy for one person and movement."""

    joints_mm: dict[str, tuple[float, float]]
    """Joint -> its standard deviation, root mean square over the frames, and the largest."""

    parameters: dict[str, tuple[float, float]]
    """Pose parameter with its unit -> the same, degrees or millimetres."""

    all_views: Views
    without: dict[str, Views]
    """View -> what the others reach; empty with two views."""

    fewest: dict[int, Views]
    """Number of cameras -> the best so many."""

    visible: dict[str, dict[str, float]]
    """Segment -> view -> share of its surface that is seen, averaged over the frames."""

    hidden: dict[str, float]
    """Segment -> share of the frames in which fewer than two views show a quarter of it."""

    @property
    def enough(self) -> int:
        """The fewest cameras whose error is within `NEARLY` times that of all."""
        return min(n for n, views in self.fewest.items() if views.sigma_mm <= NEARLY * self.all_views.sigma_mm)

    def as_dict(self) -> dict[str, Any]:
        """Plain values."""

        def plain(views: Views) -> dict[str, Any]:
            return {**vars(views), "names": list(views.names)}

        return {
            "joints_sigma_mm": {name: {"rms": rms, "worst": worst} for name, (rms, worst) in self.joints_mm.items()},
            "parameters_sigma": {name: {"rms": rms, "worst": worst} for name, (rms, worst) in self.parameters.items()},
            "all_views": plain(self.all_views),
            "without": {name: plain(views) for name, views in self.without.items()},
            "fewest": {str(n): plain(views) for n, views in self.fewest.items()},
            "enough": self.enough,
            "visible": self.visible,
            "hidden": self.hidden,
        }


def prospect(scene: Scene, poses: Array, synthesis: Synthesis, edge_px: float) -> Prospect:
    """Looks ahead.

    Args:
        scene: one person, and the rig of two or more cameras.
        poses: (T, dof) of the movement.
        synthesis: traces contours and paints parts.
        edge_px: standard deviation of an edge position, px.
    """
    body, names = scene.persons[0].body, scene.rig.names
    chosen = poses[np.unique(np.linspace(0, len(poses) - 1, _POSES).round().astype(int))]
    information = view_information(scene, chosen, synthesis, edge_px)
    reported = list(body.reported)

    def reached(views: tuple[int, ...]) -> tuple[Views, Array, Array]:
        covariance = covariances(body, information, views)
        joints = 1000 * joint_sigmas(body, chosen, covariance)[:, reported]
        own = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)) * np.where(body.rotates, np.degrees(1.0), 1000.0)
        by_joint, by_angle = _rms(joints), np.where(body.rotates, _rms(own), 0.0)
        j, a = int(by_joint.argmax()), int(by_angle.argmax())
        found = Views(
            tuple(names[v] for v in views),
            float(np.sqrt(np.mean(joints**2))),
            body.landmark_names[reported[j]],
            float(by_joint[j]),
            body.names[a],
            float(by_angle[a]),
        )
        return found, joints, own

    everything = tuple(range(len(names)))
    all_views, joints, own = reached(everything)
    units = ["deg" if rotates else "mm" for rotates in body.rotates]
    segments = by_segment(body, visible_shares(scene, chosen, synthesis))
    return Prospect(
        joints_mm={body.landmark_names[mark]: pair for mark, pair in zip(reported, _rms_and_most(joints), strict=True)},
        parameters={
            f"{name}_{unit}": pair for name, unit, pair in zip(body.names, units, _rms_and_most(own), strict=True)
        },
        all_views=all_views,
        without={name: reached(tuple(one for one in everything if one != v))[0] for v, name in enumerate(names)}
        if len(names) > 2
        else {},
        fewest={n: reached(views)[0] for n, views in best_views(body, chosen, information).items()},
        visible={
            name: dict(zip(names, shares.mean(axis=0).tolist(), strict=True)) for name, shares in segments.items()
        },
        hidden={name: float(np.mean((shares >= SHOWN).sum(axis=1) < 2)) for name, shares in segments.items()},
    )


def _rms(values: Array) -> Array:
    root: Array = np.sqrt(np.mean(values**2, axis=0))
    return root


def _rms_and_most(values: Array) -> list[tuple[float, float]]:
    return list(zip(_rms(values).tolist(), values.max(axis=0).tolist(), strict=True))


# From nobody to everybody: grey, red and orange are not enough, greens are.
_COLOURS = ("0.94", "#f4c7c3", "#fce8b2", "#b7e1cd", "#57bb8a", "#2e8b57")
# Lengths are those of persons; of bodies below 0.8 m a share of them (`tracker.bodies.limbs.smallness`).
_FRUSTUM_M, _LINE_M, _BESIDE_M, _AROUND_M = 1.2, 2.0, 1.5, (1.0, 1.0, 0.2)
"""How long frusta and, from above, their sides are drawn; what is shown beside the cameras and the way: of the floor,
and in space along each axis."""


def volume_figure(rig: Rig, floor: Floor, body: BodyModel, poses: Array, title: str) -> Figure:
    """Draws it.

    Args:
        rig: the cameras.
        floor: what they see.
        body: the person.
        poses: (T, dof) of the movement.
        title: of the picture.
    """
    figure = Figure(figsize=(14.0, 6.6), layout="constrained")
    plan, space = figure.add_subplot(1, 2, 1), figure.add_subplot(1, 2, 2, projection="3d")
    way = way_of(body, poses)[:, :2]
    small = smallness(body)
    box = _around(rig, way, small)
    _plan(figure, plan, rig, floor, box, small)
    _space(space, rig, floor, box, small)
    plan.plot(way[:, 0], way[:, 1], color="black", linewidth=2)
    plan.plot(*way[0], "o", color="black", markersize=5)
    _person(space, body, poses)
    figure.suptitle(title, fontsize=11)
    return figure


def _plan(figure: Figure, axes: Axes, rig: Rig, floor: Floor, box: tuple[Array, Array], small: float) -> None:
    """Cameras that see a whole person who stands there, from above."""
    n = max(len(rig), 2)
    colours = [_COLOURS[min(k, len(_COLOURS) - 1)] for k in range(n + 1)]
    norm = BoundaryNorm(np.arange(n + 2) - 0.5, n + 1)
    image = axes.pcolormesh(floor.x, floor.y, floor.whole, cmap=ListedColormap(colours), norm=norm, shading="nearest")
    figure.colorbar(image, ax=axes, ticks=range(n + 1), shrink=0.7, label="cameras that see the whole body there")
    for camera in rig.cameras:
        x, y, _ = camera.centre
        for column in (0, camera.size[0] - 1):
            ray = camera.rays(np.array([column, camera.size[1] / 2]), clamped=True)[:2]
            end = camera.centre[:2] + small * _LINE_M * ray / max(float(np.linalg.norm(ray)), 1e-9)
            axes.plot([x, end[0]], [y, end[1]], color="#1f4e9c", linewidth=1)
        axes.plot(x, y, "s", color="#1f4e9c", markersize=6)
        axes.annotate(camera.name, (x, y), textcoords="offset points", xytext=(6, 6), fontsize=8, color="#1f4e9c")
    low, high = box
    axes.set_xlim(max(low[0] - small * _BESIDE_M, floor.x[0]), min(high[0] + small * _BESIDE_M, floor.x[-1]))
    axes.set_ylim(max(low[1] - small * _BESIDE_M, floor.y[0]), min(high[1] + small * _BESIDE_M, floor.y[-1]))
    axes.set_aspect("equal")
    axes.set_xlabel("x, m")
    axes.set_ylabel("y, m")
    areas = sizes({k: floor.area_m2(k) for k in (2, 3) if k <= len(rig)}, "m²")
    axes.set_title(f"the whole body is seen by {areas}", fontsize=9)


def _space(axes: Any, rig: Rig, floor: Floor, box: tuple[Array, Array], small: float) -> None:
    """Frusta, and the edges of what two and three cameras see, at some heights."""
    for camera in rig.cameras:
        for line in _frustum(camera, small * _FRUSTUM_M):
            axes.plot(*line.T, color="#1f4e9c", linewidth=0.9)
        axes.text(*camera.centre, camera.name, fontsize=8, color="#1f4e9c")
    low, high = box
    columns = np.flatnonzero((floor.x >= low[0]) & (floor.x <= high[0]))
    rows = np.flatnonzero((floor.y >= low[1]) & (floor.y <= high[1]))
    for least, colour in ((2, "#e69f00"), (3, "#2e8b57")):
        for level in range(0, len(floor.heights), 3):
            # cells have corners, the space has none
            seen = gaussian_filter((floor.points[level] >= least).astype(float), 1.0)[np.ix_(rows, columns)]
            if least <= len(rig) and 0 < seen.mean() < 1:
                axes.contour(
                    floor.x[columns],
                    floor.y[rows],
                    seen,
                    levels=[0.5],
                    colors=colour,
                    linewidths=0.9,
                    zdir="z",
                    offset=float(floor.heights[level]),
                )
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])
    axes.set_zlim(0.0, max(high[2], floor.heights[-1]))
    axes.set_aspect("equal")
    volumes = sizes({k: floor.volume_m3(k) for k in (2, 3) if k <= len(rig)}, "m³")
    axes.set_title(f"seen by cameras, up to the head: {volumes} (orange 2, green 3)", fontsize=9)


def _around(rig: Rig, way: Array, small: float) -> tuple[Array, Array]:
    """Lowest and highest corner of a box around the cameras and a way on the floor (T, 2), a metre beside them.

    Of a small body a share of it.
    """
    centres = np.stack([camera.centre for camera in rig.cameras])
    inside = np.concatenate([centres, np.column_stack([way, np.full(len(way), centres[0, 2])])])
    reach = small * np.array(_AROUND_M)
    return inside.min(axis=0) - reach, inside.max(axis=0) + reach


def _frustum(camera: Camera, length_m: float) -> list[Array]:
    """Lines (2, 3) from a camera through the corners of its picture, so long, and between their ends."""
    width, height = camera.size
    corners = np.array([(0, 0), (width - 1, 0), (width - 1, height - 1), (0, height - 1)], dtype=np.float64)
    ends = camera.centre + length_m * camera.rays(corners, clamped=True)
    sides = [np.stack([camera.centre, end]) for end in ends]
    return [*sides, *(np.stack([ends[k], ends[(k + 1) % 4]]) for k in range(4))]


def _person(axes: Any, body: BodyModel, poses: Array) -> None:
    """The person at the start, in the middle and at the end, and the way of the root."""
    marks = {name: k for k, name in enumerate(body.landmark_names)}
    for q in (poses[0], poses[len(poses) // 2], poses[-1]):
        points = body.landmarks_in_world(q)
        for start, end in body.links:
            axes.plot(*points[[marks[start], marks[end]]].T, color="black", linewidth=1.5)
    way = way_of(body, poses)
    axes.plot(way[:, 0], way[:, 1], np.zeros(len(way)), color="black", linewidth=1.5)
