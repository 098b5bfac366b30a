"""Caliscope's own camera arrays, and the configurations that were in their place before."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, ClassVar

import tomli_w

from tracker.cameras.rig import Rig
from tracker.cameras.rig_layouts import Listing
from tracker.cameras.rig_layouts._cameras import Entry, camera_table, listing_of, toml_program
from tracker.cameras.rig_layouts._sources import toml_table
from tracker.foundation.configuration.components import component
from tracker.foundation.errors import CalibrationError

_NUMBERED = re.compile(r"(?:cam|port)_?(\d+)")


@component
class CaliscopeLayout:
    """`camera_array.toml`: tables `[cameras.0]`, `[cameras.1]`, ..., called cam_0, cam_1 as Caliscope's videos are.

    Older files number by `port`, whose videos are called port_0, port_1; before there was `camera_array.toml`, these
    were tables of `config.toml`, beside stereo pairs and points. Cameras with `ignore = true`, or without a pose, are
    left out. `rotation_count` turns Caliscope's display only, neither its videos nor its calibration.
    """

    endings: ClassVar[tuple[str, ...]] = (".toml",)
    shape: ClassVar[str] = "Caliscope's camera_array.toml or config.toml"
    terms: ClassVar[int] = 8

    def detects(self, path: Path) -> bool:
        """A TOML file with a table `cameras`, or with cameras that are turned in the display."""
        return toml_program(path) == "caliscope"

    def read(self, path: Path, size: tuple[int, int] | None) -> Listing:
        """Reads the tables."""
        content = toml_table(path)
        tables = content.get("cameras") if "cameras" in content else _older(content)
        if not isinstance(tables, dict):
            raise CalibrationError("cameras: expected the tables [cameras.0], [cameras.1], ...")
        entries, set_aside = [], {}
        for number, table in tables.items():
            if not isinstance(table, dict):
                raise CalibrationError(f"cameras.{number}: {table!r} found, expected a table")
            name = str(table.get("name", f"{'port' if 'port' in table else 'cam'}_{number}"))
            entries.append(Entry(name, table))
            if table.get("ignore") is True:
                set_aside[name] = "is set aside: ignore = true"
        return listing_of(entries, set_aside=set_aside)

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


def _older(content: dict[str, Any]) -> dict[str, Any]:
    """The cameras of a `config.toml` by their ports: stereo pairs, the board and points have none."""
    return {str(table["port"]): table for table in content.values() if isinstance(table, dict) and "port" in table}
