"""Calibrations of other programs: Anipose, Pose2Sim and Caliscope TOML, Qualisys, OpenCV YAML, EasyMocap."""

from __future__ import annotations

import tomllib
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import tomli_w
from scipy.spatial.transform import Rotation

from tracker.arrays import Array
from tracker.camera import Camera
from tracker.errors import CalibrationError, nearest
from tracker.rig import Rig
from tracker.rig_files import load_rig, save_rig

_QUALISYS_SUBPIXELS = 64.0
"""Qualisys tells pixels in 64ths; distortion coefficients are plain."""

_FLIP = np.diag([1.0, -1.0, -1.0])
"""From a camera with y up that looks along -z to OpenCV's."""


def import_rig(path: Path, size: tuple[int, int] | None = None) -> Rig:
    """Reads a rig in any known layout, told by the path.

    Args:
        path: `.toml` (Anipose, Pose2Sim, Caliscope) or `.json`; `.qca.txt` or `.xml` (Qualisys); a folder with
            `intri.yml` and `extri.yml` (EasyMocap), or with one OpenCV YAML file a camera.
        size: image width and height where the layout does not tell them (EasyMocap), px.

    Raises:
        CalibrationError: the layout is unknown or something in it is wrong.
    """
    if path.suffix.lower() in (".toml", ".json"):
        return load_rig(path)
    if not path.exists():
        raise CalibrationError(f"{path}: no such file or folder")
    try:
        if path.is_file() and path.suffix.lower() in (".txt", ".xml"):
            return Rig(tuple(_qualisys_cameras(path)))
        if path.is_dir() and (path / "intri.yml").is_file():
            return Rig(tuple(_easymocap_cameras(path, size)))
        if path.is_dir() and any(path.glob("*.yml")):
            return Rig(tuple(_opencv_camera(file) for file in sorted(path.glob("*.yml"))))
    except CalibrationError as error:
        raise CalibrationError(f"{path}: {error}") from error
    raise CalibrationError(
        f"{path}: not a calibration that is known; expected a .toml or .json file, a Qualisys .qca.txt, a folder with "
        "intri.yml and extri.yml (EasyMocap), or a folder with one OpenCV .yml a camera"
    )


def export_rig(rig: Rig, path: Path, layout: str) -> None:
    """Writes a rig for another program.

    Args:
        rig: the cameras.
        path: file (`toml`, `qualisys`) or folder (`opencv`, `easymocap`).
        layout: one of `LAYOUTS`.

    Raises:
        CalibrationError: no such layout, or it cannot hold this rig.
    """
    if layout not in _WRITERS:
        raise CalibrationError(f'no layout "{layout}"; {nearest(layout, LAYOUTS)}')
    _WRITERS[layout](rig, path)


def _qualisys_cameras(path: Path) -> list[Camera]:
    text = path.read_text(encoding="utf-8", errors="replace")
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise CalibrationError("a document type in it, which a calibration does not need")
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise CalibrationError(f"not XML: {error}") from error
    cameras = [_qualisys_camera(entry) for entry in root.iter("camera") if entry.find("intrinsic") is not None]
    if not cameras:
        raise CalibrationError("no <camera> with <intrinsic> in it")
    return cameras


def _qualisys_camera(entry: ElementTree.Element) -> Camera:
    name = entry.get("serial", "?")
    window = _numbers(entry, "fov_video", ("left", "top", "right", "bottom"), name)
    lens = _numbers(
        entry,
        "intrinsic",
        ("focalLengthU", "focalLengthV", "centerPointU", "centerPointV", "skew"),
        name,
    )
    terms = ("radialDistortion1", "radialDistortion2", "tangentalDistortion1", "tangentalDistortion2")
    distortion = _numbers(entry, "intrinsic", (*terms, "radialDistortion3"), name)
    place = _numbers(entry, "transform", ("x", "y", "z"), name) / 1000
    turn = _numbers(entry, "transform", tuple(f"r{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3)), name)
    fu, fv, cu, cv, skew = lens / _QUALISYS_SUBPIXELS
    matrix = np.array([[fu, skew, cu - window[0]], [0, fv, cv - window[1]], [0, 0, 1]])
    motion = np.eye(4)
    motion[:3, :3] = _FLIP @ turn.reshape(3, 3)
    motion[:3, 3] = -motion[:3, :3] @ place
    size = int(window[2] - window[0] + 1), int(window[3] - window[1] + 1)
    return Camera(name, size, matrix, distortion, motion)


def _numbers(entry: ElementTree.Element, tag: str, keys: tuple[str, ...], name: str) -> Array:
    found = entry.find(tag)
    if found is None:
        raise CalibrationError(f'camera "{name}": no <{tag}>')
    try:
        return np.array([float(found.get(key, "0" if key == "skew" else "")) for key in keys])
    except ValueError as error:
        raise CalibrationError(f'camera "{name}": <{tag}> lacks a number among {", ".join(keys)}') from error


def _save_qualisys(rig: Rig, path: Path) -> None:
    root = ElementTree.Element("calibration", {"source": "bodytrack", "type": "regular"})
    cameras = ElementTree.SubElement(root, "cameras")
    for camera in rig.cameras:
        entry = ElementTree.SubElement(
            cameras, "camera", {"active": "1", "serial": camera.name, "model": "Miqus Video", "avg-residual": "0"}
        )
        width, height = camera.size
        window = {"left": "0", "top": "0", "right": str(width - 1), "bottom": str(height - 1)}
        ElementTree.SubElement(entry, "fov_video", window)
        turn = _FLIP @ camera.camera_from_world[:3, :3]
        numbers = dict(zip("xyz", (1000 * camera.centre).tolist(), strict=True))
        numbers |= {f"r{i + 1}{j + 1}": float(turn[i, j]) for i in range(3) for j in range(3)}
        ElementTree.SubElement(entry, "transform", {key: repr(value) for key, value in numbers.items()})
        matrix = _QUALISYS_SUBPIXELS * camera.matrix
        k1, k2, p1, p2, k3 = camera.distortion
        lens = {
            "sensorMinU": 0.0,
            "sensorMaxU": _QUALISYS_SUBPIXELS * width - 1,
            "sensorMinV": 0.0,
            "sensorMaxV": _QUALISYS_SUBPIXELS * height - 1,
            "focalLengthU": matrix[0, 0],
            "focalLengthV": matrix[1, 1],
            "centerPointU": matrix[0, 2],
            "centerPointV": matrix[1, 2],
            "skew": matrix[0, 1],
            "radialDistortion1": k1,
            "radialDistortion2": k2,
            "radialDistortion3": k3,
            "tangentalDistortion1": p1,
            "tangentalDistortion2": p2,
        }
        ElementTree.SubElement(entry, "intrinsic", {key: repr(float(value)) for key, value in lens.items()})
    ElementTree.indent(root)
    path.write_text(ElementTree.tostring(root, encoding="unicode") + "\n", encoding="utf-8")


def _easymocap_cameras(folder: Path, size: tuple[int, int] | None) -> list[Camera]:
    intri, extri = _opened(folder / "intri.yml"), _opened(folder / "extri.yml")
    names = intri.getNode("names")
    listed = [names.at(k).string() for k in range(names.size())]
    if not listed:
        raise CalibrationError("intri.yml: no list `names`")
    cameras = []
    for name in listed:
        width, height = intri.getNode(f"W_{name}").real(), intri.getNode(f"H_{name}").real()
        found = (int(width), int(height)) if width and height else size
        if found is None:
            raise CalibrationError(f'camera "{name}": EasyMocap does not tell the image size; give it with --size WxH')
        turn = extri.getNode(f"Rot_{name}").mat()
        if turn is None:
            turn = Rotation.from_rotvec(_matrix(extri, f"R_{name}").ravel()).as_matrix()
        lens, shift = _matrix(intri, f"dist_{name}"), _matrix(extri, f"T_{name}")
        cameras.append(_camera(name, found, (_matrix(intri, f"K_{name}"), lens), (turn, shift)))
    return cameras


def _save_easymocap(rig: Rig, folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    intri = cv2.FileStorage(str(folder / "intri.yml"), cv2.FILE_STORAGE_WRITE)
    extri = cv2.FileStorage(str(folder / "extri.yml"), cv2.FILE_STORAGE_WRITE)
    for file in (intri, extri):
        file.startWriteStruct("names", cv2.FileNode_SEQ)
        for camera in rig.cameras:
            file.write("", camera.name)
        file.endWriteStruct()
    for camera in rig.cameras:
        intri.write(f"K_{camera.name}", np.array(camera.matrix))
        intri.write(f"dist_{camera.name}", camera.distortion.reshape(1, 5).copy())
        intri.write(f"W_{camera.name}", float(camera.size[0]))
        intri.write(f"H_{camera.name}", float(camera.size[1]))
        extri.write(f"R_{camera.name}", camera.rotation_vector().reshape(3, 1).copy())
        extri.write(f"Rot_{camera.name}", camera.camera_from_world[:3, :3].copy())
        extri.write(f"T_{camera.name}", camera.camera_from_world[:3, 3:].copy())
    intri.release()
    extri.release()


def _opencv_camera(path: Path) -> Camera:
    file = _opened(path)
    size = file.getNode("image_width").real(), file.getNode("image_height").real()
    if not size[0] or not size[1]:
        raise CalibrationError(f"{path.name}: no image_width and image_height")
    turn = _matrix(file, "rotation")
    turn = Rotation.from_rotvec(turn.ravel()).as_matrix() if turn.size == 3 else turn
    matrix, lens = _matrix(file, "camera_matrix"), _matrix(file, "distortion_coefficients")
    exterior = turn, _matrix(file, "translation")
    return _camera(path.stem, (int(size[0]), int(size[1])), (matrix, lens), exterior)


def _save_opencv(rig: Rig, folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for camera in rig.cameras:
        file = cv2.FileStorage(str(folder / f"{camera.name}.yml"), cv2.FILE_STORAGE_WRITE)
        file.write("image_width", camera.size[0])
        file.write("image_height", camera.size[1])
        file.write("camera_matrix", np.array(camera.matrix))
        file.write("distortion_coefficients", camera.distortion.reshape(5, 1).copy())
        file.write("rotation", camera.camera_from_world[:3, :3].copy())
        file.write("translation", camera.camera_from_world[:3, 3:].copy())
        file.release()


def _camera(name: str, size: tuple[int, int], interior: tuple[Array, Array], exterior: tuple[Array, Array]) -> Camera:
    """A camera of matrix and distortion, rotation and translation."""
    (matrix, lens), (turn, shift) = interior, exterior
    if matrix.shape != (3, 3) or np.shape(turn) != (3, 3) or shift.size != 3 or lens.size not in (4, 5):
        raise CalibrationError(
            f'camera "{name}": expected a 3x3 camera matrix and rotation, 3 numbers of translation, and 4 or 5 of '
            f"distortion (found {lens.size})"
        )
    motion = np.eye(4)
    motion[:3, :3], motion[:3, 3] = turn, shift.ravel()
    return Camera(name, size, matrix, np.pad(lens.ravel(), (0, 5 - lens.size)), motion)


def _opened(path: Path) -> cv2.FileStorage:
    try:
        file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    except cv2.error as error:
        raise CalibrationError(f"{path.name}: not an OpenCV YAML file") from error
    if not file.isOpened():
        raise CalibrationError(f"{path.name}: cannot be read")
    return file


def _matrix(file: cv2.FileStorage, key: str) -> Array:
    found = file.getNode(key).mat()
    if found is None:
        raise CalibrationError(f"no matrix {key}")
    return np.asarray(found, dtype=np.float64)


def _save_pose2sim(rig: Rig, path: Path) -> None:
    """TOML with k1 k2 p1 p2 alone."""
    lost = [camera.name for camera in rig.cameras if camera.distortion[4] != 0]
    if lost:
        raise CalibrationError(
            f"k3 of {', '.join(lost)} is not 0, which the four distortion coefficients of Pose2Sim cannot hold: "
            'choose another layout, or calibrate without "radial"'
        )
    unfinished = path.with_name(path.name + ".part")
    save_rig(rig, unfinished)
    content = tomllib.loads(unfinished.read_text(encoding="utf-8"))
    unfinished.unlink()
    for table in content.values():
        if "distortions" in table:
            table["distortions"] = table["distortions"][:4]
    path.write_bytes(tomli_w.dumps(content).encode())


_WRITERS: dict[str, Callable[[Rig, Path], None]] = {
    "toml": save_rig,
    "anipose": save_rig,
    "pose2sim": _save_pose2sim,
    "caliscope": save_rig,
    "qualisys": _save_qualisys,
    "opencv": _save_opencv,
    "easymocap": _save_easymocap,
}

LAYOUTS = tuple(_WRITERS)
"""Names of the layouts that can be written; `toml` is our own, with k3."""
