"""TOML tables of cameras, one a camera: what Anipose, Pose2Sim and Caliscope have in common."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from tracker.camera import Camera
from tracker.errors import CalibrationError
from tracker.rig_layouts._cameras import Entry
from tracker.rig_layouts._sources import text_of

NO_POSE = "has no pose: neither rotation nor translation, only its lens was calibrated"

_FREEMOCAP = re.compile(r"^charuco_square_size[ \t]*=", re.MULTILINE)


def table_camera(name: str, table: dict[str, Any]) -> Camera | str:
    """The camera of a table, or why there is none to be had of it.

    Raises:
        CalibrationError: what is there is wrong.
    """
    entry = Entry(name, table)
    if not entry.posed:
        return NO_POSE
    return entry.camera()


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


def is_freemocap(path: Path) -> bool:
    """Whether a TOML file has FreeMoCap's metadata; False also for what cannot be read."""
    try:
        return _FREEMOCAP.search(text_of(path)) is not None
    except CalibrationError:
        return False
