"""Measured surfaces as files and as pictures (D'Apuzzo et al. 2000, figures 4 and 5)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from scipy.spatial import cKDTree

from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, Image
from tracker.foundation.files import csv_lines, write_whole
from tracker.points.surfaces.points import SurfacePoints
from tracker.points.surfaces.surface import Surface

_COLUMNS = ("x", "y", "z", "sigma_x", "sigma_y", "sigma_z", "sigma", "residual_px", "red", "green", "blue")


def write_ply(surface: SurfacePoints, path: Path) -> None:
    """Writes points, colours and `sigma` (point error), metres, as binary PLY; replaced as a whole."""
    fields = [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("sigma", "<f4")]
    fields += [("red", "u1"), ("green", "u1"), ("blue", "u1")]
    vertices = np.zeros(len(surface), dtype=fields)
    for axis, name in enumerate("xyz"):
        vertices[name] = surface.points[:, axis]
    vertices["sigma"] = surface.sigma_m
    for k, name in enumerate(("blue", "green", "red")):
        vertices[name] = surface.colours[:, k]
    kinds = {"<f4": "float", "u1": "uchar"}
    header = ["ply", "format binary_little_endian 1.0", "comment metres; sigma: point error, metres"]
    header += [f"element vertex {len(surface)}", *(f"property {kinds[kind]} {name}" for name, kind in fields)]
    write_whole(path, ("\n".join([*header, "end_header"]) + "\n").encode("ascii") + vertices.tobytes())


def write_csv(surface: SurfacePoints, views: Sequence[str], path: Path) -> None:
    """Writes a row for each point: position and standard deviations in metres, colour, pixels in every view."""
    deviations = np.sqrt(np.diagonal(surface.covariances, axis1=1, axis2=2))
    pixels = surface.pixels.transpose(1, 0, 2).reshape(len(surface), -1)
    columns = [*_COLUMNS, *(f"{view}_{axis}" for view in views for axis in "xy")]
    left = np.column_stack([surface.points, deviations, surface.sigma_m, surface.residual_px])
    lines = [csv_lines([columns]).removesuffix("\r\n")]
    for row, colour, seen in zip(left.tolist(), surface.colours[:, ::-1].tolist(), pixels.tolist(), strict=True):
        metres = [f"{value:.7f}" for value in row[:7]]
        places = ["" if value != value else f"{value:.3f}" for value in seen]
        lines.append(",".join([*metres, f"{row[7]:.4f}", *map(str, colour), *places]))
    write_whole(path, ("\n".join(lines) + "\n").encode("utf-8"))


# Pictures of a surface measurement: matched points over the views (paper, figure 4) and the cloud (figure 5).

# Of the longer side in the report, and the width of one in the figure.
_PICTURE_PX = 900
_WIDTH_INCH = 6.0
_COLOURS = "viridis"


def matches_figure(surface: Surface) -> Figure:
    """Every view darkened, with the matched points coloured by the distance of the surface from the template."""
    template = surface.views[surface.template].camera
    depth = template.in_camera(surface.points.points)[:, 2]
    scale = _scale(depth)
    colours = ScalarMappable(scale, _COLOURS).to_rgba(depth, bytes=True)[:, 2::-1]
    pictures = [_with_points(view.picture, surface.points.pixels[v], colours) for v, view in enumerate(surface.views)]
    height = 0.6 + _WIDTH_INCH * max(picture.shape[0] / picture.shape[1] for picture in pictures)
    figure = Figure((_WIDTH_INCH * len(pictures) + 1.2, height), layout="constrained")
    axes = figure.subplots(1, len(pictures), squeeze=False)[0]
    for v, (axis, picture) in enumerate(zip(axes, pictures, strict=True)):
        axis.imshow(picture[..., ::-1])
        axis.set_axis_off()
        name = surface.views[v].camera.name
        axis.set_title(f"{name} (template)" if v == surface.template else name, fontsize=9)
    figure.colorbar(
        ScalarMappable(scale, _COLOURS), ax=axes, label="distance from the template's camera, m", shrink=0.8
    )
    return figure


def _scale(values: Array) -> Normalize:
    low, high = np.percentile(values, (1, 99))
    return Normalize(float(low), float(high))


def _with_points(picture: Image, pixels: Array, colours: Image) -> Image:
    scale = _PICTURE_PX / max(picture.shape[:2])
    smaller = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    grey = cv2.cvtColor(smaller, cv2.COLOR_BGR2GRAY)
    drawn: Image = cv2.cvtColor((grey * 0.6).astype(np.uint8), cv2.COLOR_GRAY2BGR)
    seen = np.isfinite(pixels).all(axis=1)
    places = np.round((pixels[seen] + 0.5) * scale - 0.5).astype(int)
    reach = _dot_reach(places)
    for down in range(-reach, reach + 1):
        for right in range(-reach, reach + 1):
            columns, rows = np.clip(places + np.array([right, down]), 0, np.array(drawn.shape[1::-1]) - 1).T
            drawn[rows, columns] = colours[seen]
    return drawn


def _dot_reach(places: Array) -> int:
    """How large dots may be that hardly touch, px around their centres."""
    if len(places) < 2:
        return 2
    distances, _ = cKDTree(places).query(places, k=2)
    return int(np.clip((np.median(np.asarray(distances)[:, 1]) - 1) // 2, 0, 3))


def cloud_figure(points: SurfacePoints, rig: Rig) -> Figure:
    """The cloud from the cameras' side, from the left and from above, once shaded as seen and once by its sigma."""
    figure = Figure((13, 8.4), layout="constrained")
    axes = figure.subplots(2, 3)
    right, down, away = _directions(points, rig)
    grey = points.colours[:, ::-1] / 255.0
    sigma = 1000 * points.sigma_m
    scale = _scale(sigma)
    shown = (
        ("from the front", right, -down, away),
        ("from the left", away, -down, right),
        ("from above", right, away, down),
    )
    for column, (title, across, up, behind) in enumerate(shown):
        order = np.argsort(-(points.points @ behind))
        place = 1000 * np.stack([points.points @ across, points.points @ up], axis=1)
        place -= np.median(place, axis=0)
        size = max(0.3, 6000 / len(points))
        axes[0, column].scatter(*place[order].T, c=grey[order], s=size, lw=0, rasterized=True)
        axes[1, column].scatter(
            *place[order].T, c=sigma[order], s=size, lw=0, norm=scale, cmap=_COLOURS, rasterized=True
        )
        for axis in axes[:, column]:
            axis.set_aspect("equal")
            axis.locator_params(nbins=4)
            axis.set_facecolor("#303438")
            axis.set_xlim(*_range(place[:, 0]))
            axis.set_ylim(*_range(place[:, 1]))
        axes[0, column].set_title(title)
        axes[1, column].set_xlabel("mm")
    figure.colorbar(ScalarMappable(scale, _COLOURS), ax=axes, label="point error, mm", shrink=0.5)
    return figure


def _range(values: Array) -> tuple[float, float]:
    """What the bulk of the points lies in, with a margin: single stray points must not shrink the rest."""
    low, high = np.percentile(values, (0.5, 99.5))
    margin = 0.1 * (high - low) + 1e-9
    return float(low - margin), float(high + margin)


def _directions(points: SurfacePoints, rig: Rig) -> tuple[Array, Array, Array]:
    """Right, down and away from the cameras, unit vectors in the world."""
    centre = np.mean([camera.centre for camera in rig.cameras], axis=0)
    away = np.median(points.points, axis=0) - centre
    away /= np.linalg.norm(away)
    down = np.mean([camera.camera_from_world[1, :3] for camera in rig.cameras], axis=0)
    down -= (down @ away) * away
    down /= np.linalg.norm(down)
    return np.cross(down, away), down, away
