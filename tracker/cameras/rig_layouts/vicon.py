"""Calibrations of Vicon (Nexus, Shogun, Blade)."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from tracker.cameras.camera import Camera
from tracker.cameras.rig import Rig
from tracker.cameras.rig_layouts import Listing
from tracker.cameras.rig_layouts._cameras import camera_of, whole
from tracker.cameras.rig_layouts._plausible import image_grid, refitted
from tracker.cameras.rig_layouts._sources import xml_root, xml_tag
from tracker.foundation.arrays import Array
from tracker.foundation.configuration.components import component
from tracker.foundation.errors import CalibrationError, shortened

_MOST_OFF_PX = 0.2
"""Between Vicon's lens and OpenCV's inside the image: what good calibrations leave."""

_UNIT = 1e-3
"""Tolerance of a quaternion's length: Vicon writes more than ten digits."""

_VIDEO = ("video", "vue")
"""Words in TYPE or DISPLAY_TYPE of a camera that films, beside those that only see markers."""


@component
class ViconLayout:
    """`NAME.xcp`: cameras called by DEVICEID, as their video files are; millimetres, z up.

    ORIENTATION is the quaternion x y z w of the rotation from the world to the camera, which looks along z with y down,
    and POSITION its place. The lens model is the inverse of OpenCV's: a pixel at a distance r from the centre of
    distortion belongs `1 + k1 r^2 + k2 r^4 + k3 r^6` times as far from it in the image of an ideal camera. OpenCV's
    five numbers are fitted to that. If some cameras film, those that only see markers are left out.
    """

    endings: ClassVar[tuple[str, ...]] = (".xcp",)
    shape: ClassVar[str] = "Vicon's .xcp"
    terms: ClassVar[int] = 8

    def detects(self, path: Path) -> bool:
        """An XML file whose outermost element is called Cameras."""
        return xml_tag(path) == "Cameras"

    def read(self, path: Path, size: tuple[int, int] | None) -> Listing:
        """Reads the cameras."""
        entries = xml_root(path).findall("Camera")
        if not entries:
            raise CalibrationError("no <Camera> in it")
        filming = any(_films(entry) for entry in entries)
        cameras: list[Camera] = []
        left_out: dict[str, str] = {}
        remarks: list[str] = []
        for k, entry in enumerate(entries):
            name = entry.get("DEVICEID") or entry.get("NAME") or f"camera {k + 1}"
            why = _unusable(entry, filming)
            if why:
                left_out[name] = why
                continue
            camera, told = _camera(entry, name)
            cameras.append(camera)
            remarks += told
        return Listing(tuple(cameras), left_out, tuple(remarks), "mm")

    def contents(self, rig: Rig) -> dict[str, bytes]:
        """Empty: the file's hardware is not known here."""
        raise CalibrationError("Vicon's calibrations are read only: choose another layout")


def _films(entry: ElementTree.Element) -> bool:
    kind = f"{entry.get('TYPE', '')} {entry.get('DISPLAY_TYPE', '')}".lower()
    return any(word in kind for word in _VIDEO)


def _unusable(entry: ElementTree.Element, filming: bool) -> str:
    """Why a camera cannot be used; empty if it can."""
    frames = entry.findall("KeyFrames/KeyFrame")
    if filming and not _films(entry):
        return "sees markers alone and films no video"
    if not frames:
        return "is not calibrated: it has no <KeyFrame>"
    return "moves: it has several <KeyFrame>, expected cameras that stand still" if len(frames) > 1 else ""


def _camera(entry: ElementTree.Element, name: str) -> tuple[Camera, list[str]]:
    """The camera, millimetres, and what to know of it."""
    frame = entry.findall("KeyFrames/KeyFrame")[0]
    size = whole(name, _numbers(name, entry, "SENSOR_SIZE", 2))
    focal = _numbers(name, frame, "FOCAL_LENGTH", 1)[0]
    aspect = _numbers(name, entry, "PIXEL_ASPECT_RATIO", 1)[0] if entry.get("PIXEL_ASPECT_RATIO") else 1.0
    skew = _numbers(name, entry, "SKEW", 1)[0] if entry.get("SKEW") else 0.0
    centre = _numbers(name, frame, "PRINCIPAL_POINT", 2)
    if not (focal > 0 and aspect > 0):
        raise CalibrationError(f'camera "{name}": FOCAL_LENGTH {focal:g}, PIXEL_ASPECT_RATIO {aspect:g}: expected > 0')
    matrix = np.array([[focal, skew, centre[0]], [0, focal / aspect, centre[1]], [0, 0, 1]])
    quaternion, place = _numbers(name, frame, "ORIENTATION", 4), _numbers(name, frame, "POSITION", 3)
    if not 0.9 < np.linalg.norm(quaternion) < 1.1:
        raise CalibrationError(
            f'camera "{name}": ORIENTATION {quaternion.tolist()} has length {np.linalg.norm(quaternion):.2g}, expected '
            "the four numbers of a unit quaternion"
        )
    turn = Rotation.from_quat(quaternion).as_matrix()
    about, radial, remarks = _radial(name, frame, centre)
    if abs(np.linalg.norm(quaternion) - 1) > _UNIT:
        remarks.append(
            f'camera "{name}": ORIENTATION has length {np.linalg.norm(quaternion):.4g}, expected 1: its direction '
            "may be off by as much as its numbers are rounded"
        )
    matrix, lens = _opencv_lens(name, size, matrix, about, radial)
    return camera_of(name, size, (matrix, lens), (turn, -turn @ place)), remarks


def _radial(name: str, frame: ElementTree.Element, centre: Array) -> tuple[Array, Array, list[str]]:
    """Centre of distortion, px; factors (4,) of r^0, r^2, r^4 and r^6; and what to know of them."""
    words = frame.get("VICON_RADIAL2", "").split()
    values = _finite(name, "VICON_RADIAL2", words[1:])
    if len(words) in (4, 5, 6):  # a name, the centre and k1 k2 k3 (Vicon3Parameter)
        return values[:2], np.concatenate([[1.0], np.pad(values[2:], (0, 6 - len(words)))]), []
    if len(words) == 7:
        told = (
            f'camera "{name}": six numbers in VICON_RADIAL2, expected five (a centre and k1 k2 k3): the third was '
            "taken for a change of scale: look at straight lines near the edges with `bodytrack rig check RIG --images`"
        )
        return values[:2], np.array([1 + values[2], *values[3:]]), [told]
    if words:
        raise CalibrationError(
            f'camera "{name}": VICON_RADIAL2 = "{shortened(" ".join(words))}": expected a name, the centre of '
            "distortion and k1 k2 k3"
        )
    older = _finite(name, "VICON_RADIAL", frame.get("VICON_RADIAL", "").split())
    if len(older) > 3:
        raise CalibrationError(f'camera "{name}": VICON_RADIAL: {len(older)} numbers found, expected k1 k2')
    return centre, np.concatenate([[1.0], np.pad(older, (0, 3 - len(older)))]), []


def _opencv_lens(name: str, size: tuple[int, int], matrix: Array, about: Array, radial: Array) -> tuple[Array, Array]:
    """The intrinsic matrix (3, 3) and distortion (8,) that image as Vicon's lens does."""
    if not radial[1:].any() and radial[0] == 1:
        return matrix, np.zeros(8)
    pixels = image_grid(size)
    offsets = pixels - about
    squares = (offsets**2).sum(axis=1)
    slopes = sum((2 * k + 1) * factor * squares**k for k, factor in enumerate(radial))
    if np.min(slopes) <= 0:
        raise CalibrationError(
            f'camera "{name}": its distortion turns back inside the image, expected k1 k2 k3 for distances in pixels'
        )
    ideal = about + offsets * sum(factor * squares**k for k, factor in enumerate(radial))[:, None]
    planes = (ideal - matrix[:2, 2]) @ np.linalg.inv(matrix[:2, :2]).T
    found = refitted(matrix, planes, pixels, 5, free=False)
    if found.most_px > _MOST_OFF_PX:
        found = refitted(matrix, planes, pixels, 5, free=True)
    if found.most_px > _MOST_OFF_PX:
        raise CalibrationError(
            f'camera "{name}": no lens of OpenCV\'s model is near its distortion ({found.most_px:.2g} px off, at most '
            f"{_MOST_OFF_PX:g} expected): undistort the videos first"
        )
    return found.matrix, found.distortion


def _numbers(name: str, entry: ElementTree.Element, key: str, count: int) -> Array:
    values = _finite(name, key, entry.get(key, "").split())
    if len(values) != count:
        raise CalibrationError(
            f'camera "{name}": {key} = "{shortened(entry.get(key, ""))}": {len(values)} numbers found, expected {count}'
        )
    return values


def _finite(name: str, key: str, words: list[str]) -> Array:
    try:
        values = np.array([float(word) for word in words])
    except ValueError as error:
        raise CalibrationError(f'camera "{name}": {key} = "{shortened(" ".join(words))}": expected numbers') from error
    if not (np.abs(values) < 1e30).all():
        raise CalibrationError(f'camera "{name}": {key}: expected finite numbers')
    return values
