"""The TOML tables that Anipose introduced, and Pose2Sim, Caliscope and this project write."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

import tomli_w

from tracker.camera import Camera
from tracker.components import component
from tracker.errors import CalibrationError
from tracker.rig import Rig
from tracker.rig_layouts import Listing
from tracker.rig_layouts._cameras import in_metres
from tracker.rig_layouts._sources import toml_table
from tracker.rig_layouts._toml_tables import camera_table, is_freemocap, table_camera
from tracker.rig_layouts.caliscope import is_caliscope


@component
class AniposeLayout:
    """`rig.toml` with a table a camera: name, size, matrix, distortions, rotation (Rodrigues vector), translation.

    Lengths are metres unless `units` under `[metadata]` says cm or mm. A table without name is called by its key.
    """

    endings: ClassVar[tuple[str, ...]] = (".toml",)
    shape: ClassVar[str] = "a .toml with a table a camera (Anipose, Pose2Sim, FreeMoCap)"

    def detects(self, path: Path) -> bool:
        """Any TOML file that is neither Caliscope's own nor FreeMoCap's."""
        return path.suffix.lower() == ".toml" and path.is_file() and not (is_caliscope(path) or is_freemocap(path))

    def read(self, path: Path, size: tuple[int, int] | None) -> Listing:
        """Reads the tables; one without a pose is left out."""
        content = toml_table(path)
        metadata = content.pop("metadata", {})
        if not isinstance(metadata, dict):
            raise CalibrationError(f"metadata: {metadata!r} found, expected a table")
        cameras: list[Camera] = []
        left_out: dict[str, str] = {}
        for key, table in content.items():
            if not isinstance(table, dict):
                continue
            name = str(table.get("name", key))
            found = table_camera(name, table)
            if isinstance(found, str):
                left_out[name] = found
            else:
                cameras.append(in_metres(found, metadata))
        return Listing(tuple(cameras), left_out)

    def contents(self, rig: Rig) -> dict[str, bytes]:
        """The tables `cam_0`, `cam_1`, ... and the metadata."""
        return {"": tables_of(rig)}


def tables_of(rig: Rig, n_distortion: int | None = None) -> bytes:
    """The TOML file of a rig, with the first so many distortion coefficients, or all."""
    tables: dict[str, Any] = {f"cam_{k}": camera_table(camera) for k, camera in enumerate(rig.cameras)}
    for table in tables.values():
        table["distortions"] = table["distortions"][:n_distortion]
    tables["metadata"] = {"units": "m"}
    return tomli_w.dumps(tables).encode()
