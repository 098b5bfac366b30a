"""TOML tables of cameras, one a camera: what Anipose, Pose2Sim and Caliscope have in common."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from tracker.cameras.camera import Camera
from tracker.cameras.rig_layouts._sources import lenient_text, written_in

_FREEMOCAP = re.compile(
    r"^[ \t]*(charuco_square_size|groundplane_applied|square_length_mm)[ \t]*=|[{,][ \t]*square_length_mm[ \t]*=",
    re.MULTILINE,
)
"""What FreeMoCap writes under its metadata: up to version 1, from 2 on."""

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
    """Whose TOML file it is: the layout `caliscope`, `freemocap` or `anipose`; empty of other files."""
    if written_in(path) != "toml":
        return ""
    text = lenient_text(path)
    if _CALISCOPE.search(text) or _CALISCOPE_OLD.search(text):
        return "caliscope"
    return "freemocap" if _FREEMOCAP.search(text) else "anipose"
