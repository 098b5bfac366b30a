"""One run of a recording as a process of its own, with whatever commit of the package, and its scores."""

from __future__ import annotations

import hashlib
import re
import shutil
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import tomli_w

from benchmarks.checkout import Code
from benchmarks.processor_clock import FILE as CLOCK_FILE
from benchmarks.recorded import Recorded
from benchmarks.scores import Score
from benchmarks.trial import LIMB_MM, TRACKED_MM
from tracker.foundation.arrays import Array, Mask
from tracker.foundation.configuration.tables import Table
from tracker.foundation.errors import SequenceError
from tracker.results.evaluation.comparison import PersonErrors, evaluate
from tracker.results.evaluation.joints import read_rows

_RECORDINGS = ["csv_table", "run_json", "benchmarks.limb_table:LimbTable", "benchmarks.processor_clock:ProcessorClock"]
# Frames of a window are written together: what each of them took is known in runs of one pass alone.
_ONE_PASS = "passes=1"
_WARNINGS = {"doubtful", "ambiguous", "lost"}
_STARTED = re.compile(r"frame (\d+) (\S+) start pose of confidence ([\d.]+)")


@dataclass(frozen=True)
class Asked:
    """What is run."""

    model: str
    acquired: bool
    plates: bool
    settings: tuple[str, ...]
    start: int
    stop: int
    without: str = ""
    """Rules that are switched off, see `benchmarks.switches.chosen`."""

    counted: bool = False
    """Whether the others are counted, see `benchmarks.switched_run`."""

    @property
    def told(self) -> str:
        """The settings in words."""
        return " ".join((*self.settings, *([f"without={self.without}"] if self.without else [])))


def described(recording: Recorded, asked: Asked, models: dict[str, Path]) -> Table:
    """The configuration of a run.

    Args:
        recording: what is tracked.
        asked: how.
        models: person -> acquired model; empty for the general one, scaled.
    """
    persons = [
        {"name": name, "model": str(models[name])}
        if models
        else {"name": name, "model": asked.model, "stature_m": stature_m}
        for name, stature_m in recording.statures_m.items()
    ]
    reading = {**recording.reading, **(recording.plates if asked.plates else {})}
    reading |= {"start": asked.start, "stop": asked.stop}
    return {"name": recording.name, "persons": persons, "reading": reading, "recordings": _RECORDINGS}


def folder_of(recording: Recorded, asked: Asked, code: Code, output: Path) -> Path:
    """Where a run is kept; its result is the folder `result` in it."""
    images = "plates" if asked.plates else "no_plates"
    body = f"{asked.model}{'_acquired' if asked.acquired else ''}"
    words = asked.told
    settings = f"_{hashlib.sha256(words.encode()).hexdigest()[:6]}" if words else ""
    return output / code.digest / f"{recording.name}_{body}_{images}{settings}_{asked.start}_{asked.stop}"


def scored(recording: Recorded, asked: Asked, code: Code, output: Path) -> list[Score]:
    """Runs a recording and scores every person that the truth knows."""
    row = Score(
        recording.name,
        "",
        asked.model,
        asked.acquired,
        asked.plates,
        asked.told,
        asked.start,
        asked.stop,
        code.digest,
        code.commit,
    )
    folder = folder_of(recording, asked, code, output)
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    models: dict[str, Path] = {}
    if asked.acquired:
        models, failed = acquired(recording, asked.model, code, output / code.digest / "models")
        if failed:
            return [replace(row, failed=f"no model: {failed}")]
    (folder / "config.toml").write_text(tomli_w.dumps(described(recording, asked, models)), encoding="utf-8")
    overrides = [word for setting in asked.settings for word in ("--set", setting)]
    command = ["run", "config.toml", *overrides, "--output", "result"]
    if asked.counted:
        failed = code.run([asked.without, *command], folder, "benchmarks.switched_run")
    else:
        failed = code.run(command, folder)
    if failed:
        return [replace(row, failed=failed)]
    try:
        errors = evaluate(folder / "result", recording.truth)
    except SequenceError as error:
        return [replace(row, failed=str(error))]
    return [
        _score(row, recording, folder / "result", person, curve)
        for person, curve in zip(errors.persons, errors.distances_mm, strict=True)
    ]


def acquired(recording: Recorded, model: str, code: Code, folder: Path) -> tuple[dict[str, Path], str]:
    """Models made from a recording's own views, once; or what went wrong."""
    asked = Asked(model, False, bool(recording.plates), (), 0, recording.n_frames)
    paths = {name: (folder / f"{recording.name}_{name}_{model}.toml").resolve() for name in recording.statures_m}
    for name, path in paths.items():
        if not path.is_file():
            folder.mkdir(parents=True, exist_ok=True)
            config = folder / f"{path.stem}_run.toml"
            table = described(recording, asked, {})
            config.write_text(tomli_w.dumps({k: v for k, v in table.items() if k != "recordings"}), encoding="utf-8")
            person = ["--set", f"acquisition.person={name}"]
            failed = code.run(["acquire", config.name, *person, "--output", str(path)], folder)
            if failed:
                return {}, failed
    return paths, ""


def _score(row: Score, recording: Recorded, result: Path, errors: PersonErrors, curve: dict[str, Array]) -> Score:
    """A person's row.

    Args:
        row: what was run.
        recording: the recording.
        result: the run's folder.
        errors: the person's errors.
        curve: joint -> distances to the truth in the frames that are not lost, mm (NaN: unknown), and their numbers.
    """
    joints = [name for name in curve if name != "frame"]
    gaps = np.stack([curve[name] for name in joints])
    flags = _flags(result, errors.person, joints, curve["frame"])
    flagged = flags.all(axis=0)
    wrong, limb_off = np.nanmean(gaps, axis=0) >= TRACKED_MM, (gaps > LIMB_MM).any(axis=0)
    elbows, knees = _hinges(errors, "elbow"), _hinges(errors, "knee")
    spent_s = np.array([float(entry["processor_s"]) for entry in read_rows(result / CLOCK_FILE)])
    one_by_one = _ONE_PASS in row.settings.split() and len(spent_s) > 1
    frames_s = spent_s[1:] if one_by_one else np.array([np.nan])
    started, confidence = _started(result, errors.person)
    at_start = gaps[:, curve["frame"] == started]
    at_start = at_start[np.isfinite(at_start)]
    others = [name for name, known in recording.truth_names.items() if known == errors.truth]
    return replace(
        row,
        person=errors.person,
        n_frames=errors.n_frames,
        lost=errors.n_missing,
        mean_mm=errors.mean_mm,
        removed_mm=errors.mean_offset_removed_mm,
        turned_mm=errors.mean_trunk_offset_removed_mm,
        under_100=float(np.count_nonzero(~wrong)) / errors.n_frames,
        elbows_deg=elbows[0],
        elbows_removed_deg=elbows[1],
        knees_deg=knees[0],
        knees_removed_deg=knees[1],
        elbows_over_sigma=errors.over_sigma("elbow"),
        knees_over_sigma=errors.over_sigma("knee"),
        joints_over_sigma=errors.over_sigma(),
        wrong=int(wrong.sum()),
        wrong_flagged=int((wrong & flagged).sum()),
        limb_off=int(limb_off.sum()),
        limb_off_flagged=int(((gaps > LIMB_MM) & flags).any(axis=0).sum()),
        false_flags=int((flags.any(axis=0) & ~wrong & ~limb_off).sum()),
        confidence=confidence,
        start_mm=float(np.mean(at_start)) if at_start.size else np.nan,
        start_farthest_mm=float(np.max(at_start)) if at_start.size else np.nan,
        cpu_s=float(spent_s.sum()),
        frame_s=float(np.median(frames_s)),
        slow_frame_s=float(np.quantile(frames_s, 0.9)),
        exchanged=others[0] if others and others[0] != errors.person else "",
    )


def _hinges(errors: PersonErrors, joint: str) -> tuple[float, float]:
    """RMS over both sides, raw and with constant offsets removed, degrees."""
    sides = np.array([values for name, values in errors.hinges_deg.items() if name.endswith(joint)])
    raw, removed = np.sqrt((sides**2).mean(axis=0)) if sides.size else (np.nan, np.nan)
    return float(raw), float(removed)


def _flags(result: Path, person: str, joints: list[str], frames: Array) -> Mask:
    """(L, T) whether a joint's status warns of it, or that of the whole frame does."""
    statuses = {
        (int(row["frame"]), row.get("joint", "")): row.get("status", "")
        for table in ("poses.csv", "joints.csv")
        for row in read_rows(result / table)
        if row["person"] == person
    }
    warns = [
        [{statuses.get((int(frame), joint)) for joint in (name, "")} & _WARNINGS for frame in frames] for name in joints
    ]
    flags: Mask = np.array(warns, dtype=bool)
    return flags


def _started(result: Path, person: str) -> tuple[int, float]:
    """The frame of the person's first start pose and how sure it was, as the log tells; (-1, NaN) of nobody found."""
    for frame, name, sure in _STARTED.findall((result / "log.txt").read_text(encoding="utf-8")):
        if name == person:
            return int(frame), float(sure)
    return -1, np.nan
