"""Outcome of an acquisition: the model file with its standard deviations, and residuals part by part."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from matplotlib.figure import Figure

from tracker.acquisition.fitting import Fit
from tracker.acquisition.shape_space import heights
from tracker.acquisition.variations import variations_of
from tracker.bodies.body import BodyModel
from tracker.bodies.body.description import BodyDescription
from tracker.bodies.scene import Person, Scene
from tracker.cameras.camera import Camera
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, Image, Mask
from tracker.foundation.configuration.components import find
from tracker.foundation.errors import RenderError
from tracker.synthesis.cpu import CpuSynthesis


@dataclass(frozen=True)
class PartResidual:
    """Fit of one part."""

    part: str
    rms_mm: float
    """Weighted root mean square distance between model contour and image contour, millimetres."""

    bias_mm: float
    """Weighted mean, positive where the model is too large, millimetres."""

    contour_m: float
    """Contour that was compared, metres over all views; 0 if the part was never seen."""

    size_mm: tuple[float, float, float]
    """Depth, width and length of the part, millimetres."""

    sigma_mm: tuple[float, float, float]
    """Their standard deviations."""


@dataclass(frozen=True)
class BoneLength:
    """Distance of two joints."""

    bone: str
    length_mm: float
    sigma_mm: float
    before_mm: float
    """In the initial model, scaled by the stature."""


def part_residuals(found: Fit) -> tuple[PartResidual, ...]:
    """Residuals and sizes of all parts, in the model's order."""
    body = found.body
    sizes = 2000 * body.shapes[:, :3]
    near = 2000 * found.space.neighbours(found.shape).shapes[..., :3]
    sigmas = _sigmas(found, near.reshape(len(near), -1), sizes.ravel()).reshape(-1, 3)
    table = []
    for p, part in enumerate(body.parts):
        weights = np.concatenate([rows.weights[rows.parts == p] for rows in found.rows])
        gaps = np.concatenate([rows.residuals[rows.parts == p] for rows in found.rows])
        lengths = np.concatenate([rows.lengths_m[rows.parts == p] for rows in found.rows])
        total = max(float(weights.sum()), 1e-12)
        table.append(
            PartResidual(
                part=part.name,
                rms_mm=1000 * float(np.sqrt((weights * gaps**2).sum() / total)),
                bias_mm=1000 * float((weights * gaps).sum() / total),
                contour_m=float(lengths.sum()) / 2,
                size_mm=_three(sizes[p]),
                sigma_mm=_three(sigmas[p]),
            )
        )
    return tuple(table)


def _three(values: Array) -> tuple[float, float, float]:
    a, b, c = values.tolist()
    return a, b, c


def bone_lengths(found: Fit) -> tuple[BoneLength, ...]:
    """Lengths of all links of the model."""
    body, general = found.body, found.space.description.build()
    lengths, before = _links(body, _points(body)), _links(general, _points(general))
    sigmas = _sigmas(found, _links(body, found.space.neighbours(found.shape).landmarks), lengths)
    return tuple(
        BoneLength("-".join(link), 1000 * length, 1000 * sigma, 1000 * old)
        for link, length, sigma, old in zip(body.links, lengths.tolist(), sigmas.tolist(), before.tolist(), strict=True)
    )


def _links(body: BodyModel, landmarks: Array) -> Array:
    """Lengths (..., N) of the links, metres, where the landmarks are at (..., L, 3)."""
    ends = np.array([[body.landmark_names.index(name) for name in link] for link in body.links], dtype=np.int64)
    ends = ends.reshape(-1, 2)  # a model may have no links
    lengths: Array = np.linalg.norm(landmarks[..., ends[:, 0], :] - landmarks[..., ends[:, 1], :], axis=-1)
    return lengths


def _points(body: BodyModel) -> Array:
    """(L, 3) landmarks in the reference pose."""
    return np.array([mark.point for mark in body.landmarks]).reshape(-1, 3)


def _sigmas(found: Fit, near: Array, here: Array) -> Array:
    """Standard deviations (N,) of what is measured on the body, from the covariance of the shape.

    Args:
        found: the fit.
        near: (S, N) measured on the neighbours in the shape space.
        here: (N,) measured on the body.
    """
    jacobian = (near - here).T / found.space.steps(found.shape)
    variances: Array = np.einsum("ij,jk,ik->i", jacobian, found.covariance, jacobian)
    return np.sqrt(np.maximum(variances, 0.0))


def stature_of(body: BodyModel, carried: Collection[str] = ()) -> float:
    """Height of the body in the reference pose, from the lowest to the highest point of its parts, metres.

    Args:
        body: the body.
        carried: parts that are not of the body itself.
    """
    own = np.array([part.name not in carried for part in body.parts])
    return float(heights(body.shapes[own], body.model_from_parts[own]))


def model_of(found: Fit, name: str, about: str, carried: Collection[str] = ()) -> BodyDescription:
    """The content of the person's model file, with the standard deviations of lengths (m) and sizes (m).

    Args:
        found: the fit.
        name: of the model.
        about: how it came about.
        carried: parts that the person carries, which do not make it taller.
    """
    bones = {f"{bone.bone}.length": bone.sigma_mm / 1000 for bone in bone_lengths(found)}
    parts = {
        f"{one.part}.{what}": sigma / 1000
        for one in part_residuals(found)
        for what, sigma in zip(("depth", "width", "length"), one.sigma_mm, strict=True)
    }
    poses = [found.pose(k) for k in range(len(found.looks))]
    changes = {
        "name": name,
        "about": about,
        "stature_m": stature_of(found.body, carried),
        "sigmas": bones | parts,
        "variations": variations_of(found.space, found.shape, found.covariance, poses),
    }
    return found.space.described(found.shape).model_copy(update=changes)


def contour_rms_mm(residuals: Sequence[PartResidual]) -> float:
    """Root mean square over all parts, weighted by the contour compared, millimetres."""
    weights = np.array([one.contour_m for one in residuals])
    squares = np.array([one.rms_mm**2 for one in residuals])
    return float(np.sqrt((weights * squares).sum() / max(weights.sum(), 1e-12)))


# Pictures like the paper's figures 3 and 4: the fit over every view, and the shaded model.

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
