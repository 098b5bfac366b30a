"""The way of Rosenhahn et al. 2006, level sets and twists, beside colours on lines and edges, all without plates.

A recording of which there is a scan is tracked with its configuration in configs/, with the scan's model and the start
that is given there; the others with `human`, from a pose that one frame with plates has found.
"""

from __future__ import annotations

import os
import shutil
import tomllib
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import tomli_w
from rich.console import Console
from rich.table import Table

from benchmarks.checkout import Code
from benchmarks.processor_clock import FILE as CLOCK_FILE
from benchmarks.recorded import CONFIGS, Recorded, recorded
from benchmarks.recording_run import Asked, described
from tracker.evidence.measures.outlines import overlap
from tracker.foundation.arrays import Array
from tracker.foundation.configuration.tables import Table as Configuration
from tracker.foundation.errors import TrackerError
from tracker.results.evaluation.comparison import PersonErrors, evaluate
from tracker.results.evaluation.joints import read_rows
from tracker.results.result import load_result
from tracker.synthesis.cpu import CpuSynthesis

RECORDINGS = "D-TwoElbowRot", "R-UpperBody", "R-Turn", "balancing"
"""One person each, with a truth."""

_ORDER = {name: k for k, name in enumerate(RECORDINGS)}

_SCANNED = {"R-UpperBody": ("upper_body.toml", "acquisition/scan.toml")}
"""Recording -> configuration of its run, and of its model."""

_TWISTS: Configuration = {"use": "twist_icp"}
_COUPLED: Configuration = {"use": "coupled"}
_SAMPLED: Configuration = {"use": "neighbours", "of": _TWISTS}
_PAPERS: Configuration = {"use": "level_set", "channels": "colours", "witness": False}
_LEVELS: Configuration = {"use": "level_set"}
WAYS: dict[str, Configuration] = {
    "level sets, twists: the paper's": {"evidence": _PAPERS, "estimation": _TWISTS},
    "the same, coupled twice (eq. 4)": {"evidence": _PAPERS, "estimation": _COUPLED},
    "level sets, segments vote for limbs": {"evidence": _PAPERS | {"votes": True}, "estimation": _TWISTS},
    "level sets, appearance": {"evidence": _LEVELS | {"witness": False}, "estimation": _TWISTS},
    "level sets, appearance, witness": {"evidence": _LEVELS, "estimation": _TWISTS},
    "level sets, appearance, witness, coupled": {"evidence": _LEVELS, "estimation": _COUPLED},
    "level sets, appearance, witness, sampled": {"evidence": _LEVELS, "estimation": _SAMPLED},
    "level sets, appearance, witness, weak prior": {"evidence": _LEVELS | {"shape": 0.01}, "estimation": _TWISTS},
    "colours on lines, twists": {"evidence": {"use": "regions"}, "estimation": _TWISTS},
    "edges, twists": {"evidence": {"use": "contours"}, "estimation": _TWISTS},
    "configuration of its own": {},
}
"""Sections of the configuration; the last one keeps those of a scanned recording, with search."""

_PAPER_MS = 2000.0
"""What the paper's system was to be compared with: two seconds a frame of four views."""

_RECORDERS = ["csv_table", "run_json", "journal", "benchmarks.processor_clock:ProcessorClock"]
_MASK_EVERY = 5
"""Frames between those whose overlap is measured."""


@dataclass(frozen=True)
class Row:
    """One run."""

    errors: PersonErrors
    iou: float
    cpu_ms: float
    """Of a frame in the middle, all threads."""


def compare(console: Console, n_frames: int, only: str, checkout: Path, output: Path) -> None:
    """Prints errors, overlap and processor time of every way on every recording.

    Args:
        console: where to.
        n_frames: of each recording, from its first on.
        only: names of recordings and ways hold it.
        checkout: whose package is run.
        output: keeps the runs.
    """
    if "BODYTRACK_DATA" not in os.environ:
        console.print("BODYTRACK_DATA is not set: no recordings to track")
        return
    os.nice(10)
    known, _ = recorded(Path(os.environ["BODYTRACK_DATA"]).resolve())
    table = Table(title=f"without plates, from one start, {n_frames} frames; offsets removed in brackets")
    for k, head in enumerate(
        ("recording", "way", "joints mm", "95 %", "elbows deg", "knees deg", "lost", "IoU", "ms CPU", "of 2 s")
    ):
        table.add_column(head, justify="right" if k > 1 else "left")
    code, output = Code(checkout.resolve()), output.resolve()
    for recording in sorted((one for one in known if one.name in RECORDINGS), key=lambda one: _ORDER[one.name]):
        for name, sections in WAYS.items():
            if only.lower() in f"{recording.name} {name}".lower() and (sections or recording.name in _SCANNED):
                found = _run(recording, (name, sections), n_frames, code, output)
                table.add_row(recording.name, name, *(_cells(found) if isinstance(found, Row) else [found]))
    console.print(table)


def _described(recording: Recorded, n_frames: int, code: Code, output: Path) -> Configuration | str:
    """The configuration of a run from its first frame on, in one pass, so that frames' times are known."""
    if recording.name in _SCANNED:
        table = _scanned(recording, code, output)
    else:
        table = described(recording, Asked("human", False, False, (), 0, n_frames), {})
        table["initialization"] = {"use": "given", "poses": str(_start(recording, code, output))}
    if isinstance(table, str):
        return table
    table["reading"] |= {"start": 0, "stop": n_frames}
    return table | {"recordings": _RECORDERS, "passes": 1}


def _scanned(recording: Recorded, code: Code, output: Path) -> Configuration | str:
    """The recording's configuration with the model of its scan, which is made once; or what went wrong."""
    run, acquisition = (CONFIGS / name for name in _SCANNED[recording.name])
    table: Configuration = tomllib.loads(run.read_text(encoding="utf-8"))
    model = output / "models" / f"{table['persons'][0]['name']}.toml"
    if not model.is_file():
        model.parent.mkdir(parents=True, exist_ok=True)
        failed = code.run(["acquire", str(acquisition), "--output", str(model)], model.parent)
        if failed:
            return f"no model: {failed}"
    table["persons"][0]["model"] = str(model)
    table["initialization"]["poses"] = str(CONFIGS / table["initialization"]["poses"])
    return table


def _start(recording: Recorded, code: Code, output: Path) -> Path:
    """The pose of the first frame, found with plates."""
    folder = output / f"{recording.name}_start"
    path = folder / "result" / "poses.csv"
    if not path.is_file():
        asked = Asked("human", False, True, (), 0, 1)
        _execute(described(recording, asked, {}), folder, code)
    return path


def _run(recording: Recorded, way: tuple[str, Configuration], n_frames: int, code: Code, output: Path) -> Row | str:
    """A run and its scores, or what went wrong."""
    table = _described(recording, n_frames, code, output)
    if isinstance(table, str):
        return table
    name, sections = way
    folder = output / f"{recording.name}_{name[:16].replace(',', '').replace(' ', '_')}"
    failed = _execute(table | sections, folder, code)
    if failed:
        return failed
    try:
        errors = evaluate(folder / "result", recording.truth).persons[0]
        iou = _overlap(folder / "result", recording.truth.parent / "masks")
    except TrackerError as error:
        return str(error)
    spent = [float(row["processor_s"]) for row in read_rows(folder / "result" / CLOCK_FILE)]
    return Row(errors, iou, 1000 * float(np.median(spent[1:])))


def _execute(table: Configuration, folder: Path, code: Code) -> str:
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    (folder / "config.toml").write_text(tomli_w.dumps(table), encoding="utf-8")
    return code.run(["run", "config.toml", "--output", "result"], folder)


def _overlap(result: Path, masks: Path) -> float:
    """Mean overlap of the model with exact masks; NaN where there are none."""
    run, found = load_result(result), []
    for t in range(0, len(run.frames), _MASK_EVERY):
        poses = tuple(track.poses[t] for track in run.persons)
        if not all(np.isfinite(pose).all() for pose in poses):
            continue
        for name, silhouette in zip(
            run.rig.names, CpuSynthesis().silhouettes(run.scene.with_poses(poses)), strict=True
        ):
            path = masks / name / f"{run.frames[t]:04d}.png"
            if path.is_file():
                exact = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
                found.append(overlap(silhouette, np.asarray(exact == 1)))
    return float(np.mean(found)) if found else float("nan")


def _cells(row: Row) -> list[str]:
    errors = row.errors
    elbows, knees = (_rms(errors, joint) for joint in ("elbow", "knee"))
    return [
        f"{errors.mean_mm:.0f} ({errors.mean_offset_removed_mm:.0f})",
        f"{errors.p95_mm:.0f}",
        f"{elbows[0]:.1f} ({elbows[1]:.1f})",
        f"{knees[0]:.1f} ({knees[1]:.1f})" if np.isfinite(knees[0]) else "-",
        f"{errors.n_missing}/{errors.n_frames}",
        f"{row.iou:.3f}" if np.isfinite(row.iou) else "-",
        f"{row.cpu_ms:.0f}",
        f"{_PAPER_MS / row.cpu_ms:.0f}x",
    ]


def _rms(errors: PersonErrors, joint: str) -> Array:
    """Over both sides, raw and with the offset removed, degrees."""
    sides = [values for name, values in errors.hinges_deg.items() if name.endswith(joint)]
    return np.sqrt((np.array(sides) ** 2).mean(axis=0)) if sides else np.full(2, np.nan)
