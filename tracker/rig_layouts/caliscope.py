"""Caliscope's own camera arrays."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, ClassVar

import tomli_w

from tracker.camera import Camera
from tracker.components import component
from tracker.errors import CalibrationError
from tracker.rig import Rig
from tracker.rig_layouts import Listing
from tracker.rig_layouts._sources import text_of, toml_table
from tracker.rig_layouts._toml_tables import camera_table, table_camera

_TABLE = re.compile(r"^[ \t]*(\[[ \t]*cameras[ \t]*[.\]]|cameras[ \t]*[.=])", re.MULTILINE)
_NUMBERED = re.compile(r"(?:cam|port)_?(\d+)")


@component
class CaliscopeLayout:
    """`camera_array.toml`: tables `[cameras.0]`, `[cameras.1]`, ..., called cam_0, cam_1 as Caliscope's videos are.

    Older files number by `port`, whose videos are called port_0, port_1. Cameras with `ignore = true`, or without a
    pose, are left out. `rotation_count` turns Caliscope's display only, neither its videos nor its calibration.
    """

    endings: ClassVar[tuple[str, ...]] = (".toml",)
    shape: ClassVar[str] = "Caliscope's camera_array.toml"

    def detects(self, path: Path) -> bool:
        """A TOML file with a table `cameras`."""
        return path.suffix.lower() == ".toml" and path.is_file() and is_caliscope(path)

    def read(self, path: Path, size: tuple[int, int] | None) -> Listing:
        """Reads the tables."""
        tables = toml_table(path).get("cameras")
        if not isinstance(tables, dict):
            raise CalibrationError("cameras: expected the tables [cameras.0], [cameras.1], ...")
        cameras: list[Camera] = []
        left_out: dict[str, str] = {}
        for number, table in tables.items():
            if not isinstance(table, dict):
                raise CalibrationError(f"cameras.{number}: {table!r} found, expected a table")
            name = str(table.get("name", f"{'port' if 'port' in table else 'cam'}_{number}"))
            found = "is set aside: ignore = true" if table.get("ignore") is True else table_camera(name, table)
            if isinstance(found, str):
                left_out[name] = found
            else:
                cameras.append(found)
        return Listing(tuple(cameras), left_out)

    def contents(self, rig: Rig) -> dict[str, bytes]:
        """The tables, numbered as the names are; names of another kind go along, and the cameras are counted."""
        numbered = [_NUMBERED.fullmatch(camera.name) for camera in rig.cameras]
        numbers = [int(match[1]) for match in numbered if match]
        if len(set(numbers)) < len(rig):
            numbers = list(range(len(rig)))
        tables: dict[str, dict[str, Any]] = {}
        for number, camera in zip(numbers, rig.cameras, strict=True):
            table = {"cam_id": number, "rotation_count": 0, "ignore": False, **camera_table(camera)}
            if camera.name == f"cam_{number}":
                del table["name"]
            tables[str(number)] = table
        return {"": tomli_w.dumps({"cameras": tables}).encode()}


def is_caliscope(path: Path) -> bool:
    """Whether a TOML file has a table `cameras`; False also for what cannot be read."""
    try:
        return _TABLE.search(text_of(path)) is not None
    except CalibrationError:
        return False
