"""A picture of what cameras see: the floor from above, and cameras, common space and the person's way in space."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from scipy.ndimage import gaussian_filter

from tracker.bodies.body import BodyModel
from tracker.bodies.limbs import smallness
from tracker.cameras.camera import Camera
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array
from tracker.synthesis.simulation.common_volume import Floor, sizes, way_of

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
