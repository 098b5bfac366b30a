"""Checks a rig: possible geometry, visibility, and agreement with images."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from tracker.cameras.camera import Camera
from tracker.cameras.rig import Rig, world_doubts
from tracker.foundation.arrays import Array, Image
from tracker.foundation.errors import CalibrationError

# BGR, told apart on dark and bright.
_COLOURS = ((66, 135, 245), (72, 199, 116), (235, 120, 60), (200, 90, 200), (60, 200, 220), (120, 120, 250))
# Lines of a view in another one: more can't be told apart.
_N_FEATURES = 6


def epipolar_picture(rig: Rig, images: tuple[Image, ...], source: int = 0) -> Image:
    """Distinct points of one view and their epipolar lines over the others (figure 7 of Gavrila & Davis 1996).

    If the rig is right, each line passes through the same detail as the point of its colour.

    Args:
        rig: the cameras.
        images: one picture of each view, taken at one time.
        source: the view of the points.

    Raises:
        CalibrationError: a picture has another size than its camera.
    """
    for camera, image in zip(rig.cameras, images, strict=True):
        if (image.shape[1], image.shape[0]) != camera.size:
            raise CalibrationError(
                f'view "{camera.name}": the picture has {image.shape[1]}x{image.shape[0]} px, the rig was calibrated '
                f"at {camera.size[0]}x{camera.size[1]}"
            )
    shown = [image.copy() if image.ndim == 3 else cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) for image in images]
    width = max(1, round(rig.cameras[source].size[0] / 500))
    for k, pixel in enumerate(_features(images[source])):
        colour = _COLOURS[k % len(_COLOURS)]
        cv2.circle(shown[source], _whole(pixel), 5 * width, colour, width + 1, cv2.LINE_AA)
        for target in range(len(rig)):
            if target != source:
                line = rig.epipolar_line(pixel, source, target, 400)
                near = line[(np.abs(line) < 1e5).all(axis=1)]
                cv2.polylines(shown[target], [near.round().astype(np.int32)], False, colour, width, cv2.LINE_AA)
    for camera, image in zip(rig.cameras, shown, strict=True):
        place = 10 * width, 24 * width
        cv2.putText(image, camera.name, place, cv2.FONT_HERSHEY_SIMPLEX, 0.7 * width, (255, 255, 255), width + 1)
    return _tiled(shown)


def _features(image: Image) -> Array:
    """(N, 2) distinct pixels, well apart, in the middle of a picture."""
    grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    height, width = grey.shape
    mask = np.zeros_like(grey)
    mask[height // 6 : -height // 6, width // 6 : -width // 6] = 255
    found = cv2.goodFeaturesToTrack(grey, _N_FEATURES, 0.05, min(height, width) / 6, mask=mask)
    return np.zeros((0, 2)) if found is None else np.asarray(found.reshape(-1, 2), dtype=np.float64)


def _whole(pixel: Array) -> tuple[int, int]:
    return round(float(pixel[0])), round(float(pixel[1]))


def _tiled(images: list[Image], width_px: int = 800) -> Image:
    """Pictures two in a row."""
    sized = [
        cv2.resize(i, (width_px, round(width_px * i.shape[0] / i.shape[1])), interpolation=cv2.INTER_AREA)
        for i in images
    ]
    tallest = max(image.shape[0] for image in sized)
    padded = [np.pad(image, ((0, tallest - image.shape[0]), (0, 0), (0, 0))) for image in sized]
    if len(padded) % 2:
        padded.append(np.zeros_like(padded[0]))
    rows = [np.hstack(padded[k : k + 2]) for k in range(0, len(padded), 2)]
    picture: Image = np.vstack(rows)
    return picture


@dataclass(frozen=True)
class PairCheck:
    """Two cameras."""

    first: str
    second: str
    distance_m: float
    angle_deg: float
    """Between their viewing directions."""

    shared: float
    """Share of the space before the first camera that the second one sees."""


@dataclass(frozen=True)
class CameraCheck:
    """One camera."""

    name: str
    position_m: tuple[float, float, float]
    field_deg: tuple[float, float]
    """Width and height of the view."""

    tilt_deg: float
    """Angle of the viewing direction below the horizon."""

    distortion_px: float
    """Farthest shift of an image corner by the lens."""


@dataclass(frozen=True)
class RigCheck:
    """Findings about a rig."""

    cameras: tuple[CameraCheck, ...]
    pairs: tuple[PairCheck, ...]
    middle_m: tuple[float, float, float]
    """Point nearest to all viewing axes."""

    sigma_mm: float
    """Standard deviation of a point there, from images of 0.5 px."""

    doubts: tuple[str, ...]
    """Warnings."""


def check_rig(rig: Rig) -> RigCheck:
    """Judges a rig by its numbers alone."""
    middle = rig.middle
    pixels = rig.project(middle[None])
    _, covariance = rig.triangulate(pixels, 0.5)
    sigma = 1000 * float(np.sqrt(np.trace(covariance[0]) / 3)) if np.isfinite(covariance).all() else float("nan")
    cameras = tuple(_camera_check(camera) for camera in rig.cameras)
    pairs = tuple(
        _pair_check(one, other, middle) for i, one in enumerate(rig.cameras) for other in rig.cameras[i + 1 :]
    )
    x, y, z = middle.tolist()
    return RigCheck(cameras, pairs, (x, y, z), sigma, tuple(_doubts(rig, cameras, pairs, sigma)))


def _camera_check(camera: Camera) -> CameraCheck:
    width, height = camera.size
    corners = np.array([(0.0, 0.0), (width - 1, 0), (0, height - 1), (width - 1, height - 1)])
    plain = camera.undistort(corners, clamped=True) @ camera.matrix[:2, :2].T + camera.matrix[:2, 2]
    tilt = -float(np.degrees(np.arcsin(np.clip(camera.camera_from_world[2, 2], -1, 1))))
    x, y, z = camera.centre.tolist()
    shift = float(np.linalg.norm(plain - corners, axis=1).max())
    return CameraCheck(camera.name, (x, y, z), camera.field_deg, tilt, shift)


def _pair_check(one: Camera, other: Camera, middle: Array) -> PairCheck:
    axes = one.camera_from_world[2, :3], other.camera_from_world[2, :3]
    angle = float(np.degrees(np.arccos(np.clip(axes[0] @ axes[1], -1, 1))))
    width, height = one.size
    columns, rows = np.meshgrid(np.linspace(0, width - 1, 12), np.linspace(0, height - 1, 9))
    rays = one.rays(np.column_stack([columns.ravel(), rows.ravel()]))
    rays = rays[np.isfinite(rays).all(axis=1)]
    reach = max(float(np.linalg.norm(middle - one.centre)), 0.5)
    points = one.centre + np.linspace(0.6, 1.4, 5)[:, None, None] * reach * rays
    seen = other.project(points.reshape(-1, 3))
    with np.errstate(invalid="ignore"):
        inside = ((seen >= 0) & (seen <= np.array(other.size) - 1)).all(axis=1)
    distance = float(np.linalg.norm(one.centre - other.centre))
    return PairCheck(one.name, other.name, distance, angle, float(inside.mean()))


def _doubts(rig: Rig, cameras: tuple[CameraCheck, ...], pairs: tuple[PairCheck, ...], sigma_mm: float) -> list[str]:
    doubts = []
    for pair in pairs:
        if pair.distance_m > 30:
            doubts.append(
                f"{pair.first} and {pair.second} are {pair.distance_m:.0f} m apart: millimetres or centimetres taken "
                "for metres?"
            )
        if pair.distance_m < 0.1:
            doubts.append(
                f"{pair.first} and {pair.second} are {100 * pair.distance_m:.0f} cm apart: are the units metres?"
            )
    for check in cameras:
        partners = [pair for pair in pairs if check.name in (pair.first, pair.second)]
        if partners and max(pair.shared for pair in partners) < 0.05:
            doubts.append(f"{check.name} shares no space with another camera: nothing it sees can be measured")
        if not 15 < check.field_deg[0] < 150:
            doubts.append(f"{check.name} sees {check.field_deg[0]:.0f} degrees: is its focal length in px?")
    for camera in rig.cameras:
        if camera.turns_back_px is not None:
            doubts.append(
                f"{camera.name}'s distortion turns back {camera.turns_back_px:.0f} px from the principal point, inside "
                "the image: what lies farther out cannot be measured; calibrate it anew with fewer radial terms "
                "or pictures that show the board in the corners"
            )
    doubts += world_doubts(rig)
    if pairs and not sigma_mm < 20:
        doubts.append(
            f"a point in the middle is known to {sigma_mm:.0f} mm only: the cameras see it from one direction"
        )
    return doubts


@dataclass(frozen=True)
class ImageCheck:
    """Images of points beside a rig."""

    rms_px: dict[str, float]
    """Reprojection of each view."""

    scale: float | None
    """Distances measured with the rig over those known; None where positions are not known."""

    n_points: int


def check_points(rig: Rig, positions: Array, pixels: Array) -> ImageCheck:
    """Triangulates points and compares.

    Args:
        rig: the cameras.
        positions: (N, 3) known positions in any frame, metres; NaN where not known.
        pixels: (V, N, 2) px, NaN where not seen.

    Raises:
        CalibrationError: no point is seen by two views.
    """
    points, _ = rig.triangulate(pixels)
    good = np.isfinite(points).all(axis=1)
    if not good.any():
        raise CalibrationError("no point is seen by two views")
    errors = np.linalg.norm(rig.project(points) - pixels, axis=2)
    rms = {
        name: float(np.sqrt(np.nanmean(row**2))) if np.isfinite(row).any() else float("nan")
        for name, row in zip(rig.names, errors, strict=True)
    }
    known = good & np.isfinite(positions).all(axis=1)
    scale = None
    if known.sum() >= 2:
        upper = np.triu_indices(int(known.sum()), 1)
        found, wanted = (
            np.linalg.norm(values[known][:, None] - values[known], axis=2)[upper] for values in (points, positions)
        )
        scale = float(np.median(found[wanted > 0] / wanted[wanted > 0]))
    return ImageCheck(rms, scale, int(good.sum()))
