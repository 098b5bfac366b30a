"""The TOML tables that Anipose introduced, and Pose2Sim, Caliscope and this project write."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

import tomli_w

from tracker.cameras.rig import Rig
from tracker.cameras.rig_layouts import Listing
from tracker.cameras.rig_layouts._cameras import Entry, camera_table, listing_of, toml_program
from tracker.cameras.rig_layouts._plausible import unit_of
from tracker.cameras.rig_layouts._sources import toml_table
from tracker.foundation.configuration.components import component
from tracker.foundation.errors import CalibrationError, shortened

_NAMED = 6
"""Tables that a message names, where none is a camera."""


@component
class AniposeLayout:
    """`rig.toml` with a table a camera: name, size, matrix, distortions, rotation (Rodrigues vector), translation.

    Lengths are metres unless `units` under `[metadata]` says cm or mm. A table without name is called by its key; one
    without size and matrix is no camera.
    """

    endings: ClassVar[tuple[str, ...]] = (".toml",)
    shape: ClassVar[str] = "a .toml with a table a camera (Anipose, Pose2Sim, FreeMoCap)"
    terms: ClassVar[int] = 8

    def detects(self, path: Path) -> bool:
        """Any TOML file that is neither Caliscope's own nor FreeMoCap's."""
        return toml_program(path) == "anipose"

    def read(self, path: Path, size: tuple[int, int] | None) -> Listing:
        """Reads the tables; one without a pose is left out."""
        content = toml_table(path)
        metadata = content.pop("metadata", {})
        if not isinstance(metadata, dict):
            raise CalibrationError(f"metadata: {metadata!r} found, expected a table")
        tables = {key: table for key, table in content.items() if isinstance(table, dict)}
        entries = [Entry(str(table.get("name", key)), table) for key, table in tables.items() if _is_camera(table)]
        if not entries:
            named = ", ".join(f"[{shortened(key)}]" for key in list(tables)[:_NAMED]) or "no table at all"
            raise CalibrationError(f"no camera in it, expected tables with size and matrix; it has {named}")
        return listing_of(entries, unit_of(metadata.get("units", "m")))

    def contents(self, rig: Rig) -> dict[str, bytes]:
        """The tables `cam_0`, `cam_1`, ... and the metadata."""
        return {"": tables_of(rig)}


def _is_camera(table: dict[str, Any]) -> bool:
    return "size" in table or "matrix" in table


def tables_of(rig: Rig, n_distortion: int | None = None) -> bytes:
    """The TOML file of a rig, with the first so many distortion coefficients, or all."""
    tables: dict[str, Any] = {f"cam_{k}": camera_table(camera) for k, camera in enumerate(rig.cameras)}
    for table in tables.values():
        table["distortions"] = table["distortions"][:n_distortion]
    tables["metadata"] = {"units": "m"}
    return tomli_w.dumps(tables).encode()
