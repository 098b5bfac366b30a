"""Calibrations of Qualisys Track Manager (QTM)."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar
from xml.etree import ElementTree

import numpy as np

from tracker.cameras.camera import Camera
from tracker.cameras.rig import Rig
from tracker.cameras.rig_layouts import Listing
from tracker.cameras.rig_layouts._cameras import camera_of, whole
from tracker.cameras.rig_layouts._sources import xml_root, xml_tag
from tracker.foundation.arrays import Array
from tracker.foundation.configuration.components import component
from tracker.foundation.errors import CalibrationError

_SUBPIXELS = 64.0
"""QTM writes pixels in 64ths; distortion coefficients are plain."""

_FLIP = np.diag([1.0, -1.0, -1.0])
"""From a camera with y up that looks along -z to OpenCV's."""

_TURN = tuple(f"r{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3))
_LENS = ("focalLengthU", "focalLengthV", "centerPointU", "centerPointV", "skew")
_DISTORTION = ("radialDistortion1", "radialDistortion2", "tangentalDistortion1", "tangentalDistortion2")
_RADIAL3 = "radialDistortion3"


@component
class QualisysLayout:
    """`NAME.qca.txt` or `.xml`, as QTM exports it: millimetres, 64ths of a pixel, the sensor as it is.

    `viewrotation` is the angle by which QTM turns what it shows of a camera mounted on its side or head, clockwise;
    neither the video files nor the calibration are turned. Cameras that are not active or not calibrated are left out.
    """

    endings: ClassVar[tuple[str, ...]] = (".qca.txt", ".xml")
    shape: ClassVar[str] = "a Qualisys .qca.txt or .xml"
    terms: ClassVar[int] = 5

    def detects(self, path: Path) -> bool:
        """An XML file whose outermost element is a calibration, or has QTM's name."""
        return xml_tag(path) == "calibration" or (path.is_file() and path.name.lower().endswith(".qca.txt"))

    def read(self, path: Path, size: tuple[int, int] | None) -> Listing:
        """Reads the cameras."""
        entries = list(xml_root(path).iter("camera"))
        if not entries:
            raise CalibrationError("no <camera> in it")
        cameras: list[Camera] = []
        left_out: dict[str, str] = {}
        remarks: list[str] = []
        for k, entry in enumerate(entries):
            name = entry.get("serial") or f"camera {k + 1}"
            why = _unusable(entry)
            if why:
                left_out[name] = why
            else:
                cameras.append(_camera(entry, name))
                remarks += _remarks(entry, name)
        return Listing(tuple(cameras), left_out, tuple(remarks), "mm")

    def contents(self, rig: Rig) -> dict[str, bytes]:
        """The file, as far as QTM and what reads its files need it."""
        root = ElementTree.Element("calibration", {"source": "bodytrack", "type": "regular"})
        cameras = ElementTree.SubElement(root, "cameras")
        for camera in rig.cameras:
            _add_camera(cameras, camera)
        ElementTree.indent(root)
        return {"": (ElementTree.tostring(root, encoding="unicode") + "\n").encode()}


def _unusable(entry: ElementTree.Element) -> str:
    """Why a camera cannot be used; empty if it can."""
    if entry.get("active") == "0":
        return "is not active"
    if entry.get("calibrated") == "false" or entry.find("intrinsic") is None:
        return "is not calibrated"
    return ""


def _remarks(entry: ElementTree.Element, name: str) -> list[str]:
    turned = entry.get("viewrotation", "0")
    if turned not in ("0", "90", "180", "270"):
        raise CalibrationError(f'camera "{name}": viewrotation = "{turned}", expected 0, 90, 180 or 270')
    if turned == "0":
        return []
    return [
        f'camera "{name}" is mounted turned (viewrotation {turned}) and read as it films, like the video files of QTM; '
        "if your images were turned upright, `bodytrack rig convert --upright` makes the rig of those"
    ]


def _camera(entry: ElementTree.Element, name: str) -> Camera:
    if entry.find("fov_video") is None:
        raise CalibrationError(
            f'camera "{name}": no <fov_video>, which QTM writes; files made by Theia look alike but have other units '
            "and axes: take the file that QTM has exported"
        )
    left, top, right, bottom = _numbers(entry, "fov_video", ("left", "top", "right", "bottom"), name)
    fu, fv, cu, cv, skew = _numbers(entry, "intrinsic", _LENS, name) / _SUBPIXELS
    lens = _numbers(entry, "intrinsic", (*_DISTORTION, _RADIAL3), name)
    place = _numbers(entry, "transform", ("x", "y", "z"), name)
    rotation = _FLIP @ _numbers(entry, "transform", _TURN, name).reshape(3, 3)
    matrix = np.array([[fu, skew, cu - left], [0, fv, cv - top], [0, 0, 1]])
    size = whole(name, np.array([right - left + 1, bottom - top + 1]))
    return camera_of(name, size, (matrix, lens), (rotation, -rotation @ place))


def _numbers(entry: ElementTree.Element, tag: str, keys: tuple[str, ...], name: str) -> Array:
    found = entry.find(tag)
    if found is None:
        raise CalibrationError(f'camera "{name}": no <{tag}>')
    try:
        values = np.array([float(found.get(key, "0" if key in ("skew", _RADIAL3) else "")) for key in keys])
    except ValueError as error:
        raise CalibrationError(f'camera "{name}": <{tag}> lacks a number among {", ".join(keys)}') from error
    if not np.isfinite(values).all():
        raise CalibrationError(f'camera "{name}": <{tag}> has numbers that are not finite')
    return values


def _add_camera(cameras: ElementTree.Element, camera: Camera) -> None:
    rotation, (width, height) = camera.camera_from_world[:3, :3], camera.size
    mounted = {"serial": camera.name, "model": "Miqus Video", "viewrotation": str(90 * camera.quarters_to_upright)}
    entry = ElementTree.SubElement(cameras, "camera", {"active": "1", "avg-residual": "0", **mounted})
    window = {"left": "0", "top": "0", "right": str(width - 1), "bottom": str(height - 1)}
    for tag in ("fov_marker", "fov_marker_max", "fov_video", "fov_video_max"):
        ElementTree.SubElement(entry, tag, window)
    place = dict(zip("xyz", 1000 * camera.centre, strict=True))
    _add_numbers(entry, "transform", place | dict(zip(_TURN, (_FLIP @ rotation).ravel(), strict=True)))
    if camera.distortion[5:].any():
        raise CalibrationError(
            f'camera "{camera.name}": k4, k5 and k6 of its distortion are not 0, and the file of QTM holds '
            "k1 k2 p1 p2 k3 alone: choose another layout"
        )
    matrix, (k1, k2, p1, p2, k3) = _SUBPIXELS * camera.matrix, camera.distortion[:5]
    sensor = {"sensorMinU": 0, "sensorMaxU": _SUBPIXELS * width - 1}
    sensor |= {"sensorMinV": 0, "sensorMaxV": _SUBPIXELS * height - 1}
    lens = dict(zip(_LENS, matrix[[0, 1, 0, 1, 0], [0, 1, 2, 2, 1]], strict=True))
    distortion = dict(zip((*_DISTORTION, _RADIAL3), (k1, k2, p1, p2, k3), strict=True))
    _add_numbers(entry, "intrinsic", {**sensor, **lens, **distortion})


def _add_numbers(entry: ElementTree.Element, tag: str, values: dict[str, float]) -> None:
    ElementTree.SubElement(entry, tag, {key: repr(float(value)) for key, value in values.items()})
