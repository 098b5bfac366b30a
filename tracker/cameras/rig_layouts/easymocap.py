"""EasyMocap's pairs of intrinsic and extrinsic files."""

from __future__ import annotations

import re
from pathlib import Path
from typing import ClassVar

import numpy as np

from tracker.cameras.rig import Rig
from tracker.cameras.rig_layouts import Listing
from tracker.cameras.rig_layouts._cameras import Entry, listing_of
from tracker.cameras.rig_layouts._opencv_yaml import OpenCvFile, opened, written
from tracker.foundation.arrays import Array
from tracker.foundation.configuration.components import component
from tracker.foundation.errors import CalibrationError

_FIT = re.compile(r"[A-Za-z0-9_ -]+")
"""Names of cameras that OpenCV takes as parts of its entries' names."""

_FILES = ("intri.yml", "extri.yml")


@component
class EasyMocapLayout:
    """A folder with `intri.yml` (names, K_, dist_, and W_ and H_ where known) and `extri.yml` (R_, Rot_, T_), metres.

    Files without W_ and H_ have no image size.
    """

    endings: ClassVar[tuple[str, ...]] = ()
    shape: ClassVar[str] = "a folder with intri.yml and extri.yml (EasyMocap)"
    terms: ClassVar[int] = 8

    def detects(self, path: Path) -> bool:
        """A folder with one of the files, or one of the files."""
        return any((_folder(path) / name).is_file() for name in _FILES)

    def read(self, path: Path, size: tuple[int, int] | None) -> Listing:
        """Reads both files."""
        intri, extri = (opened(_folder(path) / name) for name in _FILES)
        names = [name for name in intri.names("names") if name not in ("", "none")]
        if not names:
            raise CalibrationError("intri.yml: no list `names`")
        return listing_of(_entry(name, intri, extri, size) for name in names)

    def contents(self, rig: Rig) -> dict[str, bytes]:
        """Both files, with the image sizes."""
        unfit = [name for name in rig.names if not _FIT.fullmatch(name)]
        if unfit:
            raise CalibrationError(
                f'camera "{unfit[0]}": no name for this layout, whose names have letters from a to z, digits, "-", "_" '
                "and spaces: rename it in the rig"
            )
        names: dict[str, Array | float | list[str]] = {"names": list(rig.names)}
        intri, extri = dict(names), dict(names)
        for camera in rig.cameras:
            name = camera.name
            intri |= {f"K_{name}": camera.matrix, f"dist_{name}": camera.told_distortion[None]}
            intri |= {f"W_{name}": camera.size[0], f"H_{name}": camera.size[1]}
            motion = camera.camera_from_world
            extri |= {f"R_{name}": camera.rotation_vector().reshape(3, 1), f"Rot_{name}": motion[:3, :3]}
            extri |= {f"T_{name}": motion[:3, 3:]}
        return {"intri.yml": written(intri), "extri.yml": written(extri)}


def _folder(path: Path) -> Path:
    return path.parent if path.name in _FILES and path.is_file() else path


def _entry(name: str, intri: OpenCvFile, extri: OpenCvFile, size: tuple[int, int] | None) -> Entry:
    told = intri.number(f"W_{name}"), intri.number(f"H_{name}")
    if min(told) <= 0 and size is None:
        raise CalibrationError(
            f'camera "{name}": the file does not tell the image size: '
            "`bodytrack rig convert FOLDER rig.toml --size WxH` makes a rig that does"
        )
    table = {
        "size": np.array(told if min(told) > 0 else size),
        "K": intri.matrix(f"K_{name}"),
        "dist": intri.matrix(f"dist_{name}", f"D_{name}"),
    }
    # EasyMocap itself reads the vector and leaves the matrix aside.
    if any(extri.has(f"{key}_{name}") for key in ("R", "Rot", "T")):
        table |= {"R": extri.matrix(f"R_{name}", f"Rot_{name}"), "T": extri.matrix(f"T_{name}")}
    return Entry(name, table, "K", "dist", "R", "T")
