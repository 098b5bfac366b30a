"""The shortest tables that describe jobs, and a job that does as it is told."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

from tracker.foundation.configuration.components import available, component, find
from tracker.foundation.errors import SequenceError
from tracker.foundation.files import write_whole
from tracker.foundation.progress import Progress
from tracker.running.jobs import ResultFolder

JOBS = available("jobs")
SECTIONS = {
    "reading": {"use": "video", "path": "{view}.mp4", "rig": "rig.toml"},
    "persons": [{"name": "anna", "stature_m": 1.7}],
    "calibration": {"use": "reference_bar", "length_m": 1.0},
    "pairs": [{"front": {"mask": "front.png"}, "side": {"mask": "side.png"}}],
    "stature_m": 1.7,
    "moments": [{"cloud": "points.ply"}],
    "robot": {"file": "robot.urdf"},
    "scan": {"surface": "scan.ply", "weights": "weights.npz", "joints": "joints.json"},
}
"""What a section needs at least."""


def smallest(use: str) -> dict[str, Any]:
    """The shortest table that describes a job."""
    fields = find("jobs", use).__pydantic_fields__
    table = {name: SECTIONS[name] for name, field in fields.items() if field.is_required()}
    if use == "calibrate":
        table["reading"] = {"use": "video", "path": "{view}.mp4", "views": ["left", "right"]}
    return table


@component
class Waiting:
    """Computes, fails or is interrupted as it is told."""

    resumable: ClassVar[bool] = False

    name: str = "waiting"
    fails: bool = False
    results: int = 1

    def open(self, earlier: Path | None = None) -> int:
        return self.results

    def execute(self, opened: int, folder: ResultFolder, progress: Progress) -> Path:
        for k in range(opened):
            write_whole(folder.path / f"{k}.txt", "found")
            folder.keep()
        (folder.path / "half").mkdir()
        (folder.path / "half" / "written.txt").write_text("ha")
        if self.fails:
            raise SequenceError("the last file is corrupt")
        return folder.path
