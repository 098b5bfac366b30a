"""Turns of head and upper arms about their long axes, with and without followed points, on the room recordings."""

from __future__ import annotations

import os
import shutil
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import tomli_w
from rich.console import Console
from rich.table import Table
from scipy.spatial.transform import Rotation

from benchmarks.checkout import Code
from benchmarks.recorded import Recorded, recorded
from benchmarks.recording_run import Asked, described
from tracker.cameras.rig_layouts import load_rig
from tracker.foundation.arrays import Array, Integers
from tracker.foundation.configuration.tables import Table as Configuration
from tracker.foundation.errors import TrackerError
from tracker.results.evaluation.comparison import evaluate
from tracker.results.result import load_result

TRUTH = "gt_pose.npz"
"""Joints and rotations of the segments in every frame."""

SEGMENTS: dict[str, tuple[tuple[str, str, str, str], ...]] = {
    "head": (("head", "head", "neck", "head_top"),),
    "upper arms": (
        ("left_upper_arm", "uarm.L", "l_shoulder", "l_elbow"),
        ("right_upper_arm", "uarm.R", "r_shoulder", "r_elbow"),
    ),
}
"""Segment of the body, of the truth, and the joints at the ends of its long axis."""

_AUTO: Configuration = {"use": "auto"}
_RECORDERS = ["csv_table", "run_json", "journal"]


@dataclass(frozen=True)
class Plan:
    """What the command line asks for."""

    n_frames: int
    only: str
    n_starts: int
    weights: tuple[float, ...]


@dataclass(frozen=True)
class Row:
    """A run: root mean squares over frames and sides, constant offsets removed."""

    twists_deg: tuple[float, ...]
    joints_mm: float
    lost: int


def compare(console: Console, plan: Plan, checkout: Path, output: Path) -> None:
    """Prints the errors of every way on every recording.

    Args:
        console: where to.
        plan: what is run.
        checkout: whose package is run.
        output: keeps the runs.
    """
    if "BODYTRACK_DATA" not in os.environ:
        console.print("BODYTRACK_DATA is not set: no recordings to track")
        return
    os.nice(10)
    code, output = Code(checkout.resolve()), output.resolve()
    table = Table(
        title=f"{plan.n_frames} frames from {plan.n_starts} start(s), worst start; RMS, constant offsets removed",
        caption="truth moves: RMS of the true turn about its mean, what a segment that never turns would miss",
    )
    for k, head in enumerate(("recording", "points", *(f"{name} deg" for name in SEGMENTS), "joints mm", "lost")):
        table.add_column(head, justify="right" if k > 1 else "left")
    known, _ = recorded(Path(os.environ["BODYTRACK_DATA"]).resolve())
    for recording in known:
        truth = recording.truth.with_name(TRUTH)
        if not truth.is_file() or len(recording.statures_m) > 1 or plan.only.lower() not in recording.name.lower():
            continue
        starts = recording.starts(plan.n_starts)
        moves = [_still(truth, np.arange(start, _stop(recording, start, plan))) for start in starts]
        table.add_section()
        table.add_row(recording.name, "(truth moves)", *(f"{max(values):.1f}" for values in zip(*moves, strict=True)))
        for name, evidence in _ways(plan.weights, output / recording.name).items():
            found = [_run(recording, start, plan, (name, evidence), code, output / recording.name) for start in starts]
            table.add_row("", name, *_cells(found))
    console.print(table)


def _ways(weights: tuple[float, ...], folder: Path) -> dict[str, Configuration | None]:
    """Evidence by the name of the way; the path of the points holds {start}."""
    ways: dict[str, Configuration | None] = {"none": None}
    for weight in weights:
        for directions in ("around", "all"):
            points = {"use": "points", "path": str(folder / "{start}" / "follow_{view}"), "directions": directions}
            ways[f"{directions}, {weight:g}"] = {
                "use": "together",
                "of": [_AUTO, points],
                "ranking": [1.0, 0.0],
                "refining": [1.0, weight],
            }
    return ways


def _stop(recording: Recorded, start: int, plan: Plan) -> int:
    return min(start + plan.n_frames, recording.n_frames)


def _run(
    recording: Recorded, start: int, plan: Plan, way: tuple[str, Configuration | None], code: Code, folder: Path
) -> Row | str:
    """A run and its errors, or what went wrong."""
    stop, folder = _stop(recording, start, plan), folder / str(start)
    failed = _followed(recording, (start, stop), code, folder)
    if failed:
        return failed
    asked = Asked("human", False, bool(recording.plates), (), start, stop)
    table = described(recording, asked, {}) | {"recordings": _RECORDERS}
    poses = folder / "start" / "result" / "poses.csv"
    if not poses.is_file():
        # all ways begin alike
        first = table | {"reading": table["reading"] | {"stop": start + 1}}
        failed = _execute(["run"], first, folder / "start", code)
    table["initialization"] = {"use": "given", "poses": str(poses)}
    if way[1] is not None:
        points = dict(way[1]["of"][1])
        points["path"] = points["path"].replace("{start}", str(start))
        table["evidence"] = way[1] | {"of": [way[1]["of"][0], points]}
    own = folder / "".join(letter if letter.isalnum() else "_" for letter in way[0])
    failed = failed or _execute(["run"], table, own, code)
    if failed:
        return failed
    try:
        return _errors(own / "result", recording)
    except TrackerError as error:
        return str(error)


def _followed(recording: Recorded, frames: tuple[int, int], code: Code, folder: Path) -> str:
    """Points followed in each view by itself: the views are too far apart to match points between them."""
    reading = recording.reading | {"start": frames[0], "stop": frames[1]}
    for view in load_rig(Path(recording.reading["rig"])).names:
        path = folder / f"follow_{view}"
        if not (path / "trajectories.csv").is_file():
            table = {"name": view, "view": view, "reading": reading, "picture_frames": 1000}
            failed = _execute(["follow"], table, folder / f"following_{view}", code, path)
            if failed:
                return failed
    return ""


def _execute(command: list[str], table: Configuration, folder: Path, code: Code, output: Path | None = None) -> str:
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    (folder / "config.toml").write_text(tomli_w.dumps(table), encoding="utf-8")
    return code.run([*command, "config.toml", "--output", str(output or "result")], folder)


def _errors(result: Path, recording: Recorded) -> Row:
    track = load_result(result).persons[0]
    segments = {segment.name: segment for segment in track.body.segments}
    kept = np.flatnonzero(~track.lost)
    motions = track.body.world_from_parameters(track.poses[kept])
    found = {name: motions[:, segments[name].end, :3, :3] for name in segments}
    truth = recording.truth.with_name(TRUTH)
    twists = tuple(
        _root_mean_square([_twist_deg(found[own], truth, names, track.frames[kept]) for own, *names in sides])
        for sides in SEGMENTS.values()
    )
    errors = evaluate(result, recording.truth).persons[0]
    return Row(twists, errors.mean_offset_removed_mm, errors.n_missing)


def _twist_deg(rotations: Array, truth: Path, names: list[str], frames: Integers) -> Array:
    """(T,) error of world rotations (T, 3, 3) about the true long axis, the constant offset between frames removed."""
    true, axis = _truth(truth, names, frames)
    offset = Rotation.from_matrix(rotations).inv() * true
    left = true * (Rotation.from_matrix(rotations) * offset.mean()).inv()
    error: Array = np.degrees((left.as_rotvec() * axis).sum(axis=1))
    return error


def _still(truth: Path, frames: Integers) -> tuple[float, ...]:
    """What a segment misses that is only led, and never turned about its axis, degrees."""
    found = []
    for sides in SEGMENTS.values():
        errors = []
        for _, *names in sides:
            axis = _truth(truth, names, frames)[1]
            led = [Rotation.identity()]
            for before, after in pairwise(axis):
                turn, angle = np.cross(before, after), np.arccos(np.clip(before @ after, -1, 1))
                unit = turn / max(float(np.linalg.norm(turn)), 1e-12)
                led.append(Rotation.from_rotvec(angle * unit) * led[-1])
            errors.append(_twist_deg(np.array([one.as_matrix() for one in led]), truth, names, frames))
        found.append(_root_mean_square(errors))
    return tuple(found)


def _truth(path: Path, names: list[str], frames: Integers) -> tuple[Rotation, Array]:
    """Rotations of a segment in some frames, and (T, 3) its long axis in the world."""
    with np.load(path) as pose:
        k = [str(name) for name in pose["segment_names"]].index(names[0])
        start, end = ([str(name) for name in pose["joint_names"]].index(name) for name in names[1:])
        rotations, joints = pose["segment_rotations"][0, frames, k], pose["joints"][0, frames]
    axis = joints[:, end] - joints[:, start]
    return Rotation.from_matrix(rotations), axis / np.linalg.norm(axis, axis=1, keepdims=True)


def _root_mean_square(errors: list[Array]) -> float:
    return float(np.sqrt(np.mean(np.square(errors))))


def _cells(found: list[Row | str]) -> list[str]:
    """The worst of the starts in every column."""
    failed = [row for row in found if isinstance(row, str)]
    if failed:
        return failed[:1]
    rows = [row for row in found if isinstance(row, Row)]
    twists = [f"{max(values):.1f}" for values in zip(*(row.twists_deg for row in rows), strict=True)]
    return [*twists, f"{max(row.joints_mm for row in rows):.1f}", f"{max(row.lost for row in rows)}"]
