"""Cameras from the numbers of a file."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from tracker.cameras.camera import Camera, rational_of, upper_triangular
from tracker.cameras.rig_layouts import Listing
from tracker.cameras.rig_layouts._sources import lenient_text, written_in
from tracker.foundation.arrays import Array
from tracker.foundation.errors import CalibrationError, nearest

NO_POSE = "has no pose: neither rotation nor translation, only its lens was calibrated"
"""Why a camera is left out."""

_LARGEST = 1e30
"""Largest number: its square must not overflow later."""

_LARGEST_SIZE_PX = 10**6
"""Width or height beyond any image: a number that large is something else."""

_LARGEST_LENS = 1e6
"""Largest distortion coefficient: a lens has hundredths to tens."""

_ROTATION_FAULT = 1e-4
"""Tolerance of R R^T against the unit matrix, as in `Camera`."""

_ROUNDED = 0.01
"""Tolerance of a number of a rotation: two decimals, the fewest that can describe one."""


@dataclass(frozen=True)
class Entry:
    """One camera as its file has it; messages name the entries as the file does."""

    name: str
    table: Mapping[str, Any]
    matrix: str = "matrix"
    distortion: str = "distortions"
    rotation: str = "rotation"
    translation: str = "translation"

    @property
    def posed(self) -> bool:
        """Whether the file has an exterior orientation for it."""
        return any(self.table.get(key) is not None for key in (self.rotation, self.translation))

    def numbers(self, key: str) -> Array:
        """The numbers under a key, in the shape that the file has them in.

        Raises:
            CalibrationError: there are none, they are no numbers, or not finite.
        """
        if key not in self.table:
            raise CalibrationError(f'camera "{self.name}": no entry "{key}"; {nearest(key, self.table)}')
        value = self.table[key]
        found = _array(value)
        if found is None:
            raise CalibrationError(f'camera "{self.name}": {key}: expected numbers, found {_short(value)}')
        if not np.isfinite(found).all():
            raise CalibrationError(f'camera "{self.name}": {key}: expected finite numbers, found {_short(value)}')
        if np.abs(found).max(initial=0) > _LARGEST:
            raise CalibrationError(f'camera "{self.name}": {key}: expected numbers of a camera, found {_short(value)}')
        return found

    def camera(self) -> Camera:
        """The camera; `size` stands under that key, or as width and height."""
        if "width" in self.table:
            size = np.concatenate([self.numbers("width").ravel(), self.numbers("height").ravel()])
        else:
            size = self.numbers("size")
        rotation, translation = self.numbers(self.rotation), self.numbers(self.translation)
        matrix, lens = self.numbers(self.matrix), self.numbers(self.distortion)
        if matrix.size != 9 or rotation.size not in (3, 9) or translation.size != 3:
            raise CalibrationError(
                f'camera "{self.name}": {self.matrix} has {matrix.size}, {self.rotation} {rotation.size} and '
                f"{self.translation} {translation.size} numbers, expected 9, 9 (or a Rodrigues vector of 3) and 3"
            )
        pixels, lens = whole(self.name, size), lens.ravel()
        exterior = nearest_rotation(rotation)[0] if rotation.size == 9 else rotation, translation
        if not self._fisheye():
            return camera_of(self.name, pixels, (matrix, self._pinhole(lens)), exterior)
        if lens.size != 4:
            raise CalibrationError(
                f'camera "{self.name}": {self.distortion}: {lens.size} numbers of a fisheye lens found, expected '
                "the four k1 k2 k3 k4 of OpenCV's fisheye model"
            )
        straight = camera_of(self.name, pixels, (matrix, np.zeros(8)), exterior)
        return replace(straight, distortion=rational_of(self.name, pixels, straight.matrix, lens))

    def _fisheye(self) -> bool:
        told = self.table.get("fisheye", False)
        if told not in (True, False):
            raise CalibrationError(f'camera "{self.name}": fisheye: {_short(told)} found, expected true or false')
        return bool(told)

    def _pinhole(self, lens: Array) -> Array:
        """Distortion (4, 5 or 8) of what the file has of a pinhole lens."""
        if lens.size in (12, 14) and not lens[8:].any():
            return lens[:8]
        if lens.size not in (4, 5, 8):
            raise CalibrationError(
                f'camera "{self.name}": {self.distortion}: {lens.size} numbers found, expected OpenCV\'s k1 k2 p1 p2, '
                "k1 k2 p1 p2 k3, or k1 k2 p1 p2 k3 k4 k5 k6"
                + (": calibrate it without thin prism and tilt" if lens.size in (12, 14) else "")
            )
        return lens


def _array(value: Any) -> Array | None:
    """The numbers of a value; None if it is something else, ragged, or has numbers too long."""
    if not _plain(value):
        return None
    try:
        return np.array(value, dtype=np.float64)
    except (ValueError, OverflowError):
        return None


def _plain(value: Any) -> bool:
    """Whether a value is a number or lists of numbers; words and truth values, which numpy would convert, are not."""
    if isinstance(value, list):
        return all(_plain(entry) for entry in value)
    return isinstance(value, int | float | np.ndarray) and not isinstance(value, bool)


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 80 else f"{text[:77]}..."


def whole(name: str, size: Array) -> tuple[int, int]:
    """Width and height in px.

    Raises:
        CalibrationError: not two whole numbers that an image can have.
    """
    if size.size != 2 or (size != np.round(size)).any() or not (np.abs(size) < _LARGEST_SIZE_PX).all():
        raise CalibrationError(f'camera "{name}": size: {size.tolist()} found, expected width and height in whole px')
    width, height = size.ravel().tolist()
    return int(width), int(height)


def camera_of(name: str, size: tuple[int, int], interior: tuple[Array, Array], exterior: tuple[Array, Array]) -> Camera:
    """A camera of its interior and exterior orientation.

    Args:
        name: of the camera.
        size: image width and height, px.
        interior: intrinsic matrix (9 numbers) and distortion (4, 5 or 8).
        exterior: rotation, a matrix (9) or a Rodrigues vector (3), and translation (3), in the unit of the file.

    Raises:
        CalibrationError: no camera can have these numbers.
    """
    (matrix, lens), (rotation, translation) = interior, exterior
    motion = np.eye(4)
    motion[:3, :3] = _turned(name, rotation.ravel()) if rotation.size == 3 else rotation.reshape(3, 3)
    motion[:3, 3] = translation.ravel()
    matrix, distortion = matrix.reshape(3, 3), lens.ravel()
    if np.abs(distortion).max(initial=0) > _LARGEST_LENS:
        raise CalibrationError(
            f'camera "{name}": distortion {distortion.tolist()} found, expected numbers below {_LARGEST_LENS:g}'
        )
    # Affine corrections folded into K leave small entries below the diagonal; larger ones the camera refuses.
    if 0 < abs(matrix[1, 0]) <= 0.01 * abs(matrix[1, 1]):
        matrix, distortion, motion = upper_triangular(matrix, distortion, motion)
    return Camera(name, size, matrix, distortion, motion)


def _turned(name: str, vector: Array) -> Array:
    """(3, 3) rotation of a Rodrigues vector."""
    length = float(np.linalg.norm(vector))
    if length > 2 * math.pi + 0.01:
        raise CalibrationError(
            f'camera "{name}": a Rodrigues vector of length {length:.3g} rad found, expected at most pi: are these '
            "angles about three axes, or degrees?"
        )
    turn: Array = Rotation.from_rotvec(vector).as_matrix()
    return turn


def nearest_rotation(numbers: Array) -> tuple[Array, float]:
    """The rotation that a rounded matrix means.

    Args:
        numbers: nine, row by row.

    Returns:
        (3, 3) the matrix itself, if it is a rotation or none that was rounded, else the nearest rotation; and how far
        apart both are at most, 0 for the matrix itself.
    """
    matrix = numbers.reshape(3, 3)
    if np.abs(matrix @ matrix.T - np.eye(3)).max() <= _ROTATION_FAULT or np.abs(matrix).max() > 2:
        return matrix, 0.0
    left, _, right = np.linalg.svd(matrix)
    rotation = left @ right
    apart = float(np.abs(rotation - matrix).max())
    decimals = max(len(repr(float(value)).partition(".")[2]) for value in numbers.ravel())
    if np.linalg.det(rotation) < 0 or apart > min(_ROUNDED, 10.0**-decimals):
        return matrix, 0.0
    return rotation, apart


def listing_of(
    entries: Iterable[Entry], unit: str = "m", set_aside: Mapping[str, str] | None = None, no_pose: str = NO_POSE
) -> Listing:
    """The cameras of a file's entries; those without a pose are left out.

    Args:
        entries: one a camera.
        unit: of their translations.
        set_aside: cameras that the file itself leaves out, by name, and why.
        no_pose: why a camera without a pose has none.

    Raises:
        CalibrationError: a name given twice, or a camera that is wrong.
    """
    cameras: list[Camera] = []
    left_out: dict[str, str] = {}
    remarks = []
    names: set[str] = set()
    for entry in entries:
        if entry.name in names:
            raise CalibrationError(f'two cameras are called "{entry.name}", expected different names')
        names.add(entry.name)
        why = (set_aside or {}).get(entry.name) or ("" if entry.posed else no_pose)
        if why:
            left_out[entry.name] = why
            continue
        cameras.append(entry.camera())
        turn = entry.numbers(entry.rotation)
        apart = nearest_rotation(turn)[1] if turn.size == 9 else 0.0
        if apart:
            remarks.append(
                f'camera "{entry.name}": its rotation is told in few decimals, and the nearest one is taken: that '
                f"leaves {math.degrees(apart):.1f} degrees or {apart * cameras[-1].matrix[0, 0]:.0f} px open: export "
                "it with more decimals"
            )
    return Listing(tuple(cameras), left_out, tuple(remarks), unit)


# TOML tables of cameras, one a camera: what Anipose, Pose2Sim and Caliscope have in common.

_FREEMOCAP = re.compile(
    r"^[ \t]*(charuco_square_size|groundplane_applied|square_length_mm)[ \t]*=|[{,][ \t]*square_length_mm[ \t]*=",
    re.MULTILINE,
)
"""Keys of FreeMoCap's metadata: up to version 1, from 2 on."""

_CALISCOPE = re.compile(r"^[ \t]*(\[[ \t]*cameras[ \t]*[.\]]|cameras[ \t]*[.=])", re.MULTILINE)
_CALISCOPE_OLD = re.compile(r"^[ \t]*rotation_count[ \t]*=", re.MULTILINE)


def camera_table(camera: Camera) -> dict[str, Any]:
    """The table of a camera."""
    return {
        "name": camera.name,
        "size": list(camera.size),
        "matrix": camera.matrix.tolist(),
        "distortions": camera.told_distortion.tolist(),
        "rotation": camera.rotation_vector().tolist(),
        "translation": camera.camera_from_world[:3, 3].tolist(),
        "fisheye": False,
    }


def toml_program(path: Path) -> str:
    """Layout of a TOML file: `caliscope`, `freemocap` or `anipose`; empty for other files."""
    if written_in(path) != "toml":
        return ""
    text = lenient_text(path)
    if _CALISCOPE.search(text) or _CALISCOPE_OLD.search(text):
        return "caliscope"
    return "freemocap" if _FREEMOCAP.search(text) else "anipose"
