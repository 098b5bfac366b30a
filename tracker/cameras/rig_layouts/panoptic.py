"""Calibrations of the CMU Panoptic Studio (Joo et al., ICCV 2015)."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

from tracker.cameras.rig import Rig
from tracker.cameras.rig_layouts import Listing
from tracker.cameras.rig_layouts._cameras import Entry, listing_of
from tracker.cameras.rig_layouts._plausible import unit_of, up_remarks
from tracker.cameras.rig_layouts._sources import json_table, written_in
from tracker.foundation.configuration.components import component
from tracker.foundation.errors import CalibrationError

_KEYS = "K", "distCoef", "R", "t"


@component
class PanopticLayout:
    """`calibration_SEQUENCE.json` with `cameras`, a list of name, resolution, K, distCoef, R and t; centimetres.

    The world has -y up and the floor at 0. Cameras of any `type` are read: choose by `views`.
    """

    endings: ClassVar[tuple[str, ...]] = (".json",)
    shape: ClassVar[str] = 'Panoptic\'s .json with "cameras": name, resolution, K, distCoef, R, t'
    terms: ClassVar[int] = 8

    def detects(self, path: Path) -> bool:
        """A JSON file whose cameras have Panoptic's keys."""
        return is_panoptic(path)

    def read(self, path: Path, size: tuple[int, int] | None) -> Listing:
        """Reads the cameras."""
        content = json_table(path)
        entries = [_entry(number, table) for number, table in enumerate(content["cameras"])]
        listing = listing_of(entries, unit_of(content.get("units", "cm")))
        return replace(listing, remarks=(*listing.remarks, *up_remarks(listing.cameras)))

    def contents(self, rig: Rig) -> dict[str, bytes]:
        """Nothing: the layout `json` is read by more programs."""
        raise CalibrationError("Panoptic's calibrations are read only: choose the layout json")


def is_panoptic(path: Path) -> bool:
    """Whether a JSON file has cameras with Panoptic's keys; False also for what cannot be read."""
    if written_in(path) != "json":
        return False
    try:
        cameras = json_table(path).get("cameras")
    except CalibrationError:
        return False
    return isinstance(cameras, list) and any(isinstance(one, dict) and "distCoef" in one for one in cameras)


def _entry(number: int, table: Any) -> Entry:
    if not isinstance(table, dict):
        raise CalibrationError(
            f"camera {number}: {table!r} found, expected a table with resolution, {', '.join(_KEYS)}"
        )
    sized = {**table, "size": table["resolution"]} if "resolution" in table else table
    return Entry(str(table.get("name", f"cam_{number}")), sized, *_KEYS)
