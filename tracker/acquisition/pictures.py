"""Pictures of a standing person: silhouette, camera, and what is wrong with them."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from pathlib import Path

import cv2
import numpy as np
import pydantic

from tracker.bodies.body import BodyModel
from tracker.bodies.scene import Person, Scene
from tracker.cameras.camera import Camera
from tracker.cameras.rig import Rig
from tracker.cameras.rig_layouts import load_rig
from tracker.evidence.contours import ContourEvidence
from tracker.evidence.measures.outlines import Comparison, largest_region
from tracker.foundation.arrays import Array, Image, Mask
from tracker.foundation.configuration.components import FilePath, component
from tracker.foundation.errors import CalibrationError, ConfigError, SequenceError
from tracker.images.plate import Plate, foreground
from tracker.images.sight import Observation
from tracker.synthesis import Synthesis
from tracker.tracking.objective import Objective

# An orthographic picture is one from very far: over the depth of a body its scale changes by less than 0.1 %.
_FAR_M = 1000.0

# At 80 px, a pixel is 2 cm of a person: nothing thinner than a forearm could be measured below.
_LEAST_HEIGHT_PX = 80
# A second region of a fifth of the largest is a second person or furniture, no hand or foot torn off: a choice.
_SECOND_SHARE = 0.2
# Specks at the border are noise; a body cut off there meets it along more than this share of its height.
_BORDER_SHARE = 0.01


@component
class Picture:
    """One picture of the person: a mask, or an image with its background; and the camera, if it is known."""

    mask: FilePath | None = None
    """Silhouette: white (at least half bright) where the person is."""

    image: FilePath | None = None
    """The photograph: for the figure, and for the silhouette if there is no mask."""

    background: FilePath | None = None
    """The same view without the person."""

    px_per_m: float | None = pydantic.Field(default=None, gt=0)
    """Scale of an orthographic picture; None with a rig, or to take it from the stature."""

    rig: FilePath | None = None
    """Calibration with the camera of a perspective picture, world z up."""

    view: str | None = None
    """Name of the camera in the rig; may be left out where there is one only."""

    clicks: dict[str, tuple[float, float]] = pydantic.Field(default_factory=dict, strict=False)
    """Landmarks of the model clicked in the picture, px: `left_elbow = [499, 215]`."""


@component
class Pair:
    """The same posture from the front and from the side."""

    front: Picture
    """The person faces the camera."""

    side: Picture
    """The person is turned by 90 degrees."""


@dataclass(frozen=True)
class Silhouette:
    """A picture that is read and checked."""

    name: str
    """`front` or `side`, for messages."""

    mask: Mask
    """(H, W)"""

    image: Image
    """(H, W, 3) BGR; grey where there is no photograph."""

    camera: Camera
    orthographic: bool
    clicks: dict[str, Array]

    @property
    def box(self) -> tuple[int, int, int, int]:
        """x, y, width, height of the person, px."""
        x, y, width, height = cv2.boundingRect(self.mask.astype(np.uint8))
        return x, y, width, height


def read_silhouette(picture: Picture, name: str, stature_m: float | None) -> Silhouette:
    """Reads a picture and refuses what cannot be one person standing.

    Args:
        picture: files and camera.
        name: how messages call it.
        stature_m: of the person, for the scale of a picture without one.

    Raises:
        SequenceError: a file cannot be read, or the silhouette is empty, cut off or more than one person's.
        CalibrationError: the camera is not given as it must be.
    """
    mask, image = _mask_and_image(picture, name)
    check_silhouette(mask, name)
    region = largest_region(mask)
    height_px = cv2.boundingRect(region.astype(np.uint8))[3]
    camera = _camera(picture, name, (mask.shape[1], mask.shape[0]), height_px / stature_m if stature_m else None)
    clicks = {landmark: np.array(pixel) for landmark, pixel in picture.clicks.items()}
    return Silhouette(name, region, image, camera, picture.rig is None, clicks)


def _mask_and_image(picture: Picture, name: str) -> tuple[Mask, Image]:
    image = None if picture.image is None else _read(picture.image, name)
    if picture.mask is not None:
        mask = _read(picture.mask, name).max(axis=2) >= 128
        if image is not None and image.shape[:2] != mask.shape:
            raise SequenceError(
                f"{name}: the mask is {mask.shape[1]}x{mask.shape[0]} px, the image {image.shape[1]}x{image.shape[0]}"
            )
        grey = np.full((*mask.shape, 3), 128, dtype=np.uint8)
        return mask, grey if image is None else image
    if image is None or picture.background is None:
        raise ConfigError(f"{name}: give a mask, or an image and its background")
    plate = _read(picture.background, name)
    if plate.shape != image.shape:
        raise SequenceError(f"{name}: image and background differ in size")
    return foreground(image, Plate(plate)), image


def _read(path: Path, name: str) -> Image:
    if not path.is_file():
        raise SequenceError(f"{name}: no file {path}")
    image = cv2.imread(str(path), cv2.IMREAD_COLOR)
    if image is None:
        raise SequenceError(f"{name}: {path} is not an image that can be read")
    return np.asarray(image, dtype=np.uint8)


def check_silhouette(mask: Mask, name: str) -> None:
    """Refuses silhouettes that no single, whole person can have.

    Raises:
        SequenceError: with what was found.
    """
    count, _, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8))
    areas = np.sort(stats[1:count, cv2.CC_STAT_AREA])[::-1]
    height = cv2.boundingRect(largest_region(mask).astype(np.uint8))[3]
    if not len(areas) or height < _LEAST_HEIGHT_PX:
        found = "is empty" if not len(areas) else f"is {height} px high, expected at least {_LEAST_HEIGHT_PX}"
        raise SequenceError(f"{name}: the silhouette {found}: check the mask, or image and background")
    if mask.mean() > 0.9:
        raise SequenceError(f"{name}: the silhouette fills the picture: is the mask inverted?")
    if len(areas) > 1 and areas[1] > _SECOND_SHARE * areas[0]:
        raise SequenceError(
            f"{name}: two silhouettes, the second {areas[1] / areas[0]:.0%} as large as the first: two persons? "
            "expected one person, alone in the picture"
        )
    strips = {"left": mask[:, :2], "right": mask[:, -2:], "top": mask[:2], "bottom": mask[-2:]}
    for side, strip in strips.items():
        if strip.any(axis=1 if side in ("left", "right") else 0).sum() > max(3, _BORDER_SHARE * height):
            raise SequenceError(
                f"{name}: the person is cut off at the {side} border of the picture, expected the whole body"
            )


def _camera(picture: Picture, name: str, size: tuple[int, int], scale_from_stature: float | None) -> Camera:
    if picture.rig is not None:
        if picture.px_per_m is not None:
            raise ConfigError(f"{name}: px_per_m and rig exclude each other: orthographic or perspective?")
        rig = load_rig(picture.rig)
        if picture.view is None and len(rig) > 1:
            raise ConfigError(f"{name}: {picture.rig} has several cameras, name one: view = {rig.names[0]!r}")
        camera = rig.cameras[rig.index(picture.view) if picture.view else 0]
        if camera.size != size:
            raise CalibrationError(
                f'{name}: camera "{camera.name}" is calibrated for {camera.size[0]}x{camera.size[1]} px, '
                f"the picture is {size[0]}x{size[1]}"
            )
        return camera
    px_per_m = picture.px_per_m or scale_from_stature
    if px_per_m is None:
        raise ConfigError(f"{name}: the scale is unknown: give px_per_m, or a rig, or the person's stature_m")
    return orthographic_camera(name, size, px_per_m)


def orthographic_camera(name: str, size: tuple[int, int], px_per_m: float) -> Camera:
    """A camera from very far that looks along y, with x to the right and z up; the origin in the image's centre."""
    motion = np.array([[1.0, 0, 0, 0], [0, 0, -1.0, 0], [0, 1.0, 0, _FAR_M], [0, 0, 0, 1.0]])
    focal_px = px_per_m * _FAR_M
    matrix = np.array([[focal_px, 0, (size[0] - 1) / 2], [0, focal_px, (size[1] - 1) / 2], [0, 0, 1]])
    return Camera(name, size, matrix, np.zeros(5), motion)


# Where a standing person is, from a silhouette: facing the camera or turned aside.

# Poses at a time: bounds the memory.
_BATCH = 128


def scene_of(body: BodyModel, q: Array, silhouette: Silhouette) -> Scene:
    """The body alone before the camera of a picture."""
    return Scene((Person("subject", body, q),), Rig((silhouette.camera,)))


def placed(body: BodyModel, q: Array, silhouette: Silhouette, turn: float, synthesis: Synthesis) -> Array:
    """The pose (dof,) turned, and moved until it covers the silhouette's place and, in perspective, height.

    Args:
        body: the body.
        q: (dof,) joint angles; its root is overwritten.
        silhouette: the picture.
        turn: 0 faces the camera, pi / 2 shows the right side, rad.
        synthesis: makes the model's silhouette.
    """
    root, camera = body.root, silhouette.camera
    q = np.array(q)
    q[root.columns] = body.rest()[root.columns]
    towards = -camera.rays(np.array([(camera.size[0] - 1) / 2, (camera.size[1] - 1) / 2]))
    q[root.turn] = np.arctan2(towards[1], towards[0]) + turn
    size = body.stature_m
    x, y, width, height = silhouette.box
    depth = camera.matrix[1, 1] * size / height
    centre = camera.centre + depth * camera.rays(np.array([x + width / 2, y + height / 2]))
    q[root.shifts] = centre
    for _ in range(4):
        shown = synthesis.silhouettes(scene_of(body, q, silhouette))[0]
        if not shown.any():
            break
        if not silhouette.orthographic:
            ratio = _extent(shown)[2] / _extent(silhouette.mask)[2]
            q[root.shifts] = camera.centre + ratio * (q[root.shifts] - camera.centre)
            shown = synthesis.silhouettes(scene_of(body, q, silhouette))[0]
        gap = np.subtract(_extent(silhouette.mask)[:2], _extent(shown)[:2])
        depth = float(camera.in_camera(q[root.shifts])[2])
        right, down = camera.camera_from_world[0, :3], camera.camera_from_world[1, :3]
        q[root.shifts] += depth * (gap[0] / camera.matrix[0, 0] * right + gap[1] / camera.matrix[1, 1] * down)
    return q


def _extent(mask: Mask) -> tuple[float, float, float]:
    """Middle column of the trunk, middle row, and height, px."""
    rows, columns = np.nonzero(mask)
    return float(np.median(columns)), (rows.min() + rows.max()) / 2, float(rows.max() - rows.min() + 1)


def best_pose(
    body: BodyModel,
    q: Array,
    seen: tuple[Silhouette, Observation],
    values: dict[tuple[int, ...], Array],
    synthesis: Synthesis,
) -> tuple[Array, float]:
    """The pose (dof,) of all combinations of angles whose contours are nearest to the outline, and its distance, px.

    Args:
        body: the body.
        q: (dof,) where it stands.
        seen: picture and outline.
        values: columns of the pose, and the angles to try there, rad.
        synthesis: makes the model's contours.
    """
    asked = Comparison(scene_of(body, q, seen[0]), 0, synthesis, seen[1])
    objective = Objective(asked, ContourEvidence())
    poses = []
    for angles in product(*values.values()):
        pose = q.copy()
        for columns, angle in zip(values, angles, strict=True):
            pose[list(columns)] = angle
        poses.append(body.clamped(pose))
    distances = np.concatenate([objective(np.array(poses[i : i + _BATCH])) for i in range(0, len(poses), _BATCH)])
    best = int(np.argmin(distances))
    return poses[best], float(distances[best])
