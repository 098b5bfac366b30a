"""Rigs as files: the TOML layout that Anipose, Pose2Sim and Caliscope exchange, and JSON with K, dist, R, t."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
from scipy.linalg import rq
from scipy.spatial.transform import Rotation

from tracker.arrays import Array
from tracker.camera import Camera
from tracker.errors import CalibrationError, nearest
from tracker.middlebury import read_middlebury
from tracker.rig import Rig

# A room is metres across: cameras hundreds of units from one another were calibrated in millimetres.
_FARTHEST_M = 200.0

_METRES = {"m": 1.0, "cm": 0.01, "mm": 0.001}
"""Units a file may state."""


def load_rig(path: Path) -> Rig:
    """Reads a calibration file, `.toml` or `.json`, lengths in metres unless its `units` say cm or mm.

    Args:
        path: TOML tables with name, size, matrix, distortions, rotation (Rodrigues vector or matrix) and
            translation, one a camera; or JSON with `cameras` (a list, or a table by name) of width and height
            or size, K, dist, R, t; or the `_par.txt` of the Middlebury multi-view data.

    Raises:
        CalibrationError: the file is missing or wrong, or such a rig cannot be; file and camera are named.
    """
    try:
        if path.name.endswith("_par.txt"):
            return Rig(tuple(read_middlebury(path)))
        content = _parse(path)
        if path.suffix.lower() == ".toml":
            cameras, stated = _toml_cameras(content), content.get("metadata", {})
        else:
            cameras, stated = _json_cameras(content), content
        rig = Rig(tuple(_in_metres(camera, stated) for camera in cameras))
        _check_units(rig)
    except CalibrationError as error:
        raise CalibrationError(f"{path}: {error}") from error
    return rig


def save_rig(rig: Rig, path: Path) -> None:
    """Writes a rig as TOML in the exchanged layout.

    Args:
        rig: the cameras.
        path: file to write; replaced as a whole, so that nothing half-written stays.
    """
    tables: dict[str, Any] = {}
    for k, camera in enumerate(rig.cameras):
        tables[f"cam_{k}"] = {
            "name": camera.name,
            "size": list(camera.size),
            "matrix": camera.matrix.tolist(),
            "distortions": camera.distortion.tolist(),
            "rotation": camera.rotation_vector().tolist(),
            "translation": camera.camera_from_world[:3, 3].tolist(),
            "fisheye": False,
        }
    tables["metadata"] = {"units": "m"}
    unfinished = path.with_name(path.name + ".part")
    unfinished.write_bytes(tomli_w.dumps(tables).encode())
    unfinished.replace(path)


def _parse(path: Path) -> dict[str, Any]:
    if path.suffix.lower() not in (".toml", ".json"):
        raise CalibrationError(f'unknown kind of calibration file "{path.suffix}", expected .toml or .json')
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not a text file"
        raise CalibrationError(f"cannot read the calibration: {reason}") from error
    try:
        content = tomllib.loads(text) if path.suffix.lower() == ".toml" else json.loads(text)
    except (tomllib.TOMLDecodeError, json.JSONDecodeError) as error:
        raise CalibrationError(f"not a {path.suffix[1:].upper()} file: {error}") from error
    if not isinstance(content, dict):
        raise CalibrationError("expected a table of cameras")
    return content


def _toml_cameras(content: Mapping[str, Any]) -> list[Camera]:
    tables = {key: value for key, value in content.items() if isinstance(value, dict) and key != "metadata"}
    return [_toml_camera(str(table.get("name", key)), table) for key, table in tables.items()]


def _toml_camera(name: str, table: Mapping[str, Any]) -> Camera:
    if table.get("fisheye"):
        raise CalibrationError(
            f'camera "{name}": a fisheye lens model, expected the pinhole model with k1 k2 p1 p2 k3: '
            "undistort the images first"
        )
    rotation = _numbers(name, table, "rotation")
    matrix = Rotation.from_rotvec(rotation.reshape(3)).as_matrix() if rotation.size == 3 else rotation
    return _camera(name, table, ("size", "matrix", "distortions", "translation"), matrix)


def _json_cameras(content: Mapping[str, Any]) -> list[Camera]:
    if "cameras" not in content:
        raise CalibrationError(f'no entry "cameras"; {nearest("cameras", content)}')
    entries = content["cameras"]
    if isinstance(entries, dict):
        named = list(entries.items())
    elif isinstance(entries, list):
        named = [(f"cam_{k}", entry) for k, entry in enumerate(entries)]
    else:
        raise CalibrationError('"cameras": expected a list, or a table by camera name')
    return [_json_camera(name, entry) for name, entry in named]


def _json_camera(name: str, entry: Any) -> Camera:
    if not isinstance(entry, dict):
        raise CalibrationError(f'camera "{name}": {entry!r} found, expected a table with size, K, dist, R, t')
    name = str(entry.get("name", name))
    if "width" in entry:
        entry = entry | {"size": [_numbers(name, entry, key) for key in ("width", "height")]}
    return _camera(name, entry, ("size", "K", "dist", "t"), _numbers(name, entry, "R"))


def _camera(name: str, table: Mapping[str, Any], keys: tuple[str, str, str, str], rotation: Array) -> Camera:
    size, matrix, distortion, translation = (_numbers(name, table, key) for key in keys)
    if size.size != 2 or (size != np.round(size)).any():
        raise CalibrationError(f'camera "{name}": size: {size.tolist()} found, expected width and height in whole px')
    if distortion.size not in (4, 5):
        raise CalibrationError(
            f'camera "{name}": {keys[2]}: {distortion.size} numbers found, expected k1 k2 p1 p2 or k1 k2 p1 p2 k3'
        )
    if matrix.size != 9 or rotation.size != 9 or translation.size != 3:
        raise CalibrationError(
            f'camera "{name}": {keys[1]} has {matrix.size}, the rotation {rotation.size} and {keys[3]} '
            f"{translation.size} numbers, expected 9, 9 (or a Rodrigues vector of 3) and 3"
        )
    matrix, turn = _upper_triangular(matrix.reshape(3, 3))
    motion = np.eye(4)
    motion[:3, :3], motion[:3, 3] = turn @ rotation.reshape(3, 3), turn @ translation.reshape(3)
    lens = np.zeros(5)
    lens[: distortion.size] = distortion.ravel()
    return Camera(name, (int(size.ravel()[0]), int(size.ravel()[1])), matrix, lens, motion)


def _upper_triangular(matrix: Array) -> tuple[Array, Array]:
    """An intrinsic matrix with a small entry below the diagonal, as [[fx, s, cx], [0, fy, cy], [0, 0, 1]] times a turn.

    Affine corrections folded into K leave such entries; the turn about the optical axis goes to the exterior
    orientation. Larger entries are left for the camera to refuse.
    """
    if matrix[1, 0] == 0 or abs(matrix[1, 0]) > 0.01 * abs(matrix[1, 1]):
        return matrix, np.eye(3)
    upper, turn = rq(matrix)
    signs = np.diag(np.sign(np.diag(upper)))
    upper, turn = upper @ signs, signs @ turn
    return np.asarray(upper / upper[2, 2], dtype=np.float64), np.asarray(turn, dtype=np.float64)


def _numbers(name: str, table: Mapping[str, Any], key: str) -> Array:
    if key not in table:
        raise CalibrationError(f'camera "{name}": no entry "{key}"; {nearest(key, table)}')
    try:
        values: Array = np.array(table[key], dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise CalibrationError(f'camera "{name}": {key}: expected numbers, found {table[key]!r}') from error
    if not np.isfinite(values).all():
        raise CalibrationError(f'camera "{name}": {key}: expected finite numbers, found {table[key]!r}')
    return values


def _in_metres(camera: Camera, stated: Mapping[str, Any]) -> Camera:
    unit = stated.get("units", "m")
    if unit not in _METRES:
        raise CalibrationError(f'units = "{unit}": {nearest(str(unit), _METRES)}')
    motion = np.array(camera.camera_from_world)
    motion[:3, 3] *= _METRES[unit]
    return replace(camera, camera_from_world=motion)


def _check_units(rig: Rig) -> None:
    centres: Sequence[Array] = [camera.centre for camera in rig.cameras]
    farthest = max(float(np.linalg.norm(a - b)) for a in centres for b in centres)
    if farthest > _FARTHEST_M:
        raise CalibrationError(
            f"two cameras are {farthest:.0f} units apart, expected metres: divide the translations by 1000 "
            "if they are millimetres"
        )
