"""Models acquired from the rendered front and side pictures: silhouette overlap, and lengths against the truth."""

from __future__ import annotations

import json
import os
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from tracker.cameras.camera import Camera
from tracker.cameras.rig import Rig
from tracker.cameras.rig_layouts import save_rig
from tracker.foundation.arrays import Array
from tracker.foundation.errors import SequenceError
from tracker.running.jobs.acquire import AcquireOutcome, acquire_to, acquisition_from

SUBJECTS = ("dan", "nils", "omar")
BONES = (("shoulder", "elbow"), ("elbow", "wrist"), ("hip", "knee"), ("knee", "ankle"))


@dataclass(frozen=True)
class Trial:
    """One acquisition."""

    subject: str
    projection: str
    """`ortho` or `persp`."""

    poses: tuple[str, ...]
    clicked: bool
    """True joints with 3 px of noise are given as clicks: what careful clicking would bring, not a measurement."""


def compare(console: Console, poses: str, model: str, quick: bool) -> None:
    """Prints a table of all subjects, both projections, without and with clicked joints."""
    root = os.environ.get("BODYTRACK_DATA")
    folder = Path(root, "room", "acquisition") if root else None
    if folder is None or not folder.is_dir():
        raise SequenceError("needs BODYTRACK_DATA/room/acquisition: set BODYTRACK_DATA")
    table = Table(title="front and side silhouettes, 720x720 px, 300 px a metre", title_justify="left")
    for column in (
        "subject",
        "IoU front, side (model scaled by stature)",
        "turn",
        "left lengths - truth, mm (%)",
        "seconds",
    ):
        table.add_column(column)
    subjects = SUBJECTS[:1] if quick else SUBJECTS
    trials = [
        Trial(subject, projection, tuple(poses.split(",")), clicked)
        for subject in subjects
        for projection in ("ortho", "persp")
        for clicked in (False, True)
    ]
    for trial in trials:
        truth = json.loads((folder / trial.subject / "acquisition.json").read_text(encoding="utf-8"))
        begin = time.perf_counter()
        with tempfile.TemporaryDirectory() as scratch:
            content = _content(trial, truth, folder / trial.subject, Path(scratch)) | {"model": model}
            found = acquire_to(acquisition_from(content, "benchmark", folder, "model"), Path(scratch) / "model.toml")
        table.add_row(*_row(trial, truth, found), f"{time.perf_counter() - begin:.0f}")
    console.print(table)
    console.print("clicks: true joints with 3 px (10 mm) of noise, as if clicked; the other rows see silhouettes only")


def _content(trial: Trial, truth: dict[str, Any], folder: Path, scratch: Path) -> dict[str, Any]:
    """The configuration of a trial."""
    rng = np.random.default_rng(0)
    pairs = []
    for pose in trial.poses:
        pair = {}
        for view in ("front", "side"):
            name = f"{trial.projection}_{pose}_{view}"
            picture: dict[str, Any] = {"mask": str(folder / f"{name}_mask.png"), "image": str(folder / f"{name}.png")}
            picture |= _camera(truth["images"][name]["camera"], view, scratch)
            if trial.clicked:
                picture["clicks"] = _clicks(truth["images"][name]["joints_2d"], rng, view)
            pair[view] = picture
        pairs.append(pair)
    return {"name": trial.subject, "stature_m": round(truth["height_m"], 4), "pairs": pairs}


def _camera(camera: dict[str, Any], view: str, scratch: Path) -> dict[str, Any]:
    if camera["type"] == "orthographic":
        return {"px_per_m": camera["px_per_m"]}
    motion = np.eye(4)
    motion[:3, :3], motion[:3, 3] = camera["R"], camera["t"]
    path = scratch / f"{view}.toml"
    save_rig(Rig((Camera(view, (720, 720), np.array(camera["K"]), np.array(camera["dist"]), motion),)), path)
    return {"rig": str(path)}


def _clicks(joints: dict[str, Any], rng: np.random.Generator, view: str) -> dict[str, tuple[float, float]]:
    """True joints with noise; from the side only those of the leg that is nearer."""
    clicks = {}
    for joint in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle"):
        for side in ("left", "right"):
            x, y = np.array(joints[f"{side[0]}_{joint}"]) + rng.normal(0.0, 3.0, 2)
            if view == "front" or joint in ("hip", "knee", "ankle"):
                clicks[f"{side}_{joint}"] = (float(x), float(y))
    return clicks


def _row(trial: Trial, truth: dict[str, Any], found: AcquireOutcome) -> tuple[str, str, str, str]:
    joints = truth["images"][f"{trial.projection}_{trial.poses[0]}_front"]["joints_3d"]
    lengths = {bone.bone: bone.length_mm for bone in found.bones}
    gaps = []
    for one, other in BONES:
        true_mm = 1000 * float(np.linalg.norm(_point(joints, one) - _point(joints, other)))
        gap = lengths[f"left_{one}-left_{other}"] - true_mm
        mark = "" if abs(gap) <= max(15.0, 0.03 * true_mm) else " !"
        gaps.append(f"{one}-{other} {gap:+.0f} ({100 * gap / true_mm:+.1f}){mark}")
    shares = [f"{share:.3f} ({found.before[view]:.3f})" for view, share in found.overlaps.items()]
    title = f"{trial.subject} {trial.projection}{' clicks' if trial.clicked else ''}"
    return title, " ".join(shares), " ".join(f"{turn:.0f}" for turn in found.turns_deg), ", ".join(gaps)


def _point(joints: dict[str, Any], joint: str) -> Array:
    return np.array(joints[f"l_{joint}"], dtype=np.float64)
