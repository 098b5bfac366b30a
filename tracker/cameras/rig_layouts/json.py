"""Calibrations as JSON, with the names that OpenCV's users give: K, dist, R, t."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, ClassVar

from tracker.cameras.rig import Rig
from tracker.cameras.rig_layouts import Listing
from tracker.cameras.rig_layouts._cameras import Entry, listing_of
from tracker.cameras.rig_layouts._plausible import unit_of
from tracker.cameras.rig_layouts._sources import json_table, written_in
from tracker.cameras.rig_layouts.panoptic import is_panoptic
from tracker.foundation.configuration.components import component
from tracker.foundation.errors import CalibrationError, nearest


@component
class JsonLayout:
    """`rig.json` with `cameras`, a list or a table by name, of size (or width and height), K, dist, R and t.

    Lengths are metres unless `units` says cm or mm.
    """

    endings: ClassVar[tuple[str, ...]] = (".json",)
    shape: ClassVar[str] = 'a .json with "cameras": size, K, dist, R, t'
    terms: ClassVar[int] = 8

    def detects(self, path: Path) -> bool:
        """A JSON file that is not Panoptic's."""
        return written_in(path) == "json" and not is_panoptic(path)

    def read(self, path: Path, size: tuple[int, int] | None) -> Listing:
        """Reads the cameras."""
        content = json_table(path)
        if "cameras" not in content:
            raise CalibrationError(f'no entry "cameras"; {nearest("cameras", content)}')
        entries = content["cameras"]
        if isinstance(entries, list):
            entries = {f"cam_{k}": entry for k, entry in enumerate(entries)}
        if not isinstance(entries, dict):
            raise CalibrationError('"cameras": expected a list, or a table by camera name')
        named = [_entry(name, entry) for name, entry in entries.items()]
        return listing_of(named, unit_of(content.get("units", "m")))

    def contents(self, rig: Rig) -> dict[str, bytes]:
        """The list of cameras, with the convention in words."""
        cameras = [
            {
                "name": camera.name,
                "size": list(camera.size),
                "K": camera.matrix.tolist(),
                "dist": camera.told_distortion.tolist(),
                "R": camera.camera_from_world[:3, :3].tolist(),
                "t": camera.camera_from_world[:3, 3].tolist(),
            }
            for camera in rig.cameras
        ]
        convention = "x_cam = R x_world + t; OpenCV pinhole, k1 k2 p1 p2 k3 [k4 k5 k6]; pixel centres at integers"
        content = {"units": "m", "convention": convention, "cameras": cameras}
        return {"": (json.dumps(content, indent=1, ensure_ascii=False) + "\n").encode()}


def _entry(name: str, table: Any) -> Entry:
    if not isinstance(table, dict):
        raise CalibrationError(f'camera "{name}": {table!r} found, expected a table with size, K, dist, R, t')
    return Entry(str(table.get("name", name)), table, "K", "dist", "R", "t")
