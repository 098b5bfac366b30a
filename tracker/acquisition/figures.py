"""Pictures like the paper's figures 3 and 4: the fit over every view, and the shaded model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from matplotlib.figure import Figure

from tracker.acquisition.result import stature_of
from tracker.bodies.body import BodyModel
from tracker.bodies.scene import Person, Scene
from tracker.cameras.camera import Camera
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, Image, Mask
from tracker.foundation.configuration.components import find
from tracker.foundation.errors import RenderError
from tracker.synthesis.cpu import CpuSynthesis

# Of the picture of the body in the report; its layout has room for this.
_SHADED_PX = (480, 480)


@dataclass(frozen=True)
class Panel:
    """One view of a fit."""

    title: str
    image: Image
    """(H, W, 3) BGR."""

    mask: Mask | None
    camera: Camera
    q: Array
    """(dof,) pose in it."""


def fit_figure(body: BodyModel, panels: Sequence[Panel], title: str) -> tuple[Figure, str]:
    """Contours of the model over the views, differences of the silhouettes, and the model from four directions.

    Args:
        body: the model acquired.
        panels: its views; the pose of the first is shaded.
        title: of the figure.

    Returns:
        The figure, and which renderer shaded it.
    """
    shown, renderer = shaded_views(body, panels[0].q)
    rows = 3 if any(panel.mask is not None for panel in panels) else 2
    figure = Figure(figsize=(13.0, 4.4 * rows), layout="constrained")
    bands = np.asarray(figure.subfigures(rows, 1)).tolist()
    above = [band.subplots(1, len(panels), squeeze=False)[0] for band in bands[:-1]]
    for k, panel in enumerate(panels):
        drawn, difference = _drawn(body, panel)
        above[0][k].imshow(cv2.cvtColor(drawn, cv2.COLOR_BGR2RGB))
        above[0][k].set_title(panel.title, fontsize=10)
        if difference is not None:
            above[1][k].imshow(difference)
            above[1][k].set_title("grey: both, red: model only, blue: image only", fontsize=8)
    below = bands[-1].subplots(1, len(shown), squeeze=False)[0]
    for axis, picture in zip(below, shown, strict=True):
        axis.imshow(picture)
    for axis in figure.axes:
        axis.set_axis_off()
    figure.suptitle(f"{title} (shaded by {renderer})", fontsize=11)
    return figure, renderer


def _drawn(body: BodyModel, panel: Panel) -> tuple[Image, Image | None]:
    """The view with the model's contours, and the difference of the silhouettes, cut to the person."""
    scene = Scene((Person("subject", body, panel.q),), Rig((panel.camera,)))
    synthesis = CpuSynthesis()
    contour, covered = synthesis.contours(scene).of(0), synthesis.silhouettes(scene)[0]
    picture = np.array(panel.image)
    radius = max(1, round(picture.shape[0] / 600))
    for x, y in np.rint(contour.pixels[~contour.between]).astype(int).tolist():
        cv2.circle(picture, (x, y), radius, (255, 255, 255), -1, cv2.LINE_AA)
    window = _window(covered if panel.mask is None else covered | panel.mask)
    if panel.mask is None:
        return picture[window], None
    difference = np.full((*covered.shape, 3), 255, dtype=np.uint8)
    difference[covered & panel.mask] = 190
    difference[covered & ~panel.mask] = 220, 60, 50
    difference[~covered & panel.mask] = 50, 90, 220
    return picture[window], difference[window]


def _window(mask: Mask) -> tuple[slice, slice]:
    """Rows and columns around what is set, with a margin."""
    x, y, width, height = cv2.boundingRect(mask.astype(np.uint8))
    margin = max(8, height // 20)
    return slice(max(y - margin, 0), y + height + margin), slice(max(x - margin, 0), x + width + margin)


def shaded_views(body: BodyModel, q: Array) -> tuple[list[Image], str]:
    """The model (H, W, 3) RGB from the front, obliquely, from the side and from behind, and the renderer's name.

    Args:
        body: the model.
        q: (dof,) its pose.
    """
    placed = body.world_from_part(q)[:, :3, 3]
    middle = (placed.min(axis=0) + placed.max(axis=0)) / 2
    front = np.degrees(_heading(body, q))
    height_m = body.stature_m or stature_of(body)
    cameras = [_around(middle, height_m, front + turn) for turn in (0.0, 45.0, 90.0, 180.0)]
    scenes = [Scene((Person("subject", body, q),), Rig((camera,))) for camera in cameras]
    try:
        renderer = find("synthesis", "osmesa")()
        return [renderer.picture(scene, 0) for scene in scenes], "pyrender"
    except RenderError:
        return [_flat(scene) for scene in scenes], "the CPU tracer: flat colours, for pyrender finds no OpenGL here"


def _heading(body: BodyModel, q: Array) -> float:
    """Direction that the trunk faces: how the first part is turned about the vertical, rad."""
    turned = body.world_from_part(q)[0, :3, :3] @ body.model_from_parts[0, :3, :3].T
    return float(np.arctan2(turned[1, 0], turned[0, 0]))


def _around(middle: Array, height_m: float, heading_deg: float) -> Camera:
    distance, angle = 2.6 * height_m, np.radians(heading_deg)
    x, y, z = middle + distance * np.array([np.cos(angle), np.sin(angle), 0.12])
    focal_px = 0.8 * _SHADED_PX[1] * distance / height_m
    return Camera.looking_at("shaded", _SHADED_PX, focal_px, (x, y, z), middle)


def _flat(scene: Scene) -> Image:
    """Parts in flat colours: a plain picture without OpenGL."""
    ids = CpuSynthesis().part_ids(scene)[0]
    hues = (180 * (0.618034 * np.arange(len(scene.shapes)) % 1.0)).astype(np.uint8)
    colours = np.stack([hues, np.full_like(hues, 110), np.full_like(hues, 205)], axis=1)[None]
    palette = cv2.cvtColor(colours, cv2.COLOR_HSV2RGB)[0]
    picture: Image = np.where(ids[..., None] >= 0, palette[ids.clip(0)], np.uint8(255)).astype(np.uint8)
    return picture
