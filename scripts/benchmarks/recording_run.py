"""One run of a recording as a process of its own, with whatever commit of the package, and its scores."""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from benchmarks.processor_clock import FILE as CLOCK_FILE
from benchmarks.recorded import Recorded
from benchmarks.trial import LIMB_MM, TRACKED_MM
from tracker.arrays import Array, Mask
from tracker.config_files import Table
from tracker.errors import SequenceError
from tracker.evaluation.comparison import PersonErrors, evaluate
from tracker.evaluation.tables import read_rows

SCRIPTS = Path(__file__).parents[1]
_RECORDINGS = ["csv_table", "run_json", "benchmarks.processor_clock:ProcessorClock"]
# Frames of a window are written together: what each of them took is known in runs of one pass alone.
_ONE_PASS = "passes=1"
_WARNINGS = {"doubtful", "ambiguous", "lost"}
_CONFIDENCE = re.compile(r"(\S+) start pose of confidence ([\d.]+)")


@dataclass(frozen=True)
class Code:
    """A checkout of the package that is run."""

    folder: Path

    @cached_property
    def digest(self) -> str:
        """Eight digits that change with any source file or model."""
        files = [path for name in ("tracker", "models") for path in (self.folder / name).rglob("*") if path.is_file()]
        sources = sorted(path for path in files if path.suffix in (".py", ".toml", ".comp"))
        content = b"".join(str(path.relative_to(self.folder)).encode() + path.read_bytes() for path in sources)
        return hashlib.sha256(content).hexdigest()[:8]

    @cached_property
    def commit(self) -> str:
        """The commit checked out, with a + where files differ from it."""
        command = ["git", "-C", str(self.folder), "describe", "--always", "--abbrev=7", "--dirty=+", "--exclude=*"]
        return subprocess.run(command, capture_output=True, text=True, check=False).stdout.strip()

    def run(self, arguments: list[str], folder: Path) -> str:
        """Runs `bodytrack` with these arguments in a folder; what it complained about, empty if it succeeded."""
        paths = [str(self.folder), str(SCRIPTS)]
        settings = {"PYTHONPATH": os.pathsep.join(paths), "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
        done = subprocess.run(
            [sys.executable, "-m", "tracker", *arguments],
            cwd=folder,  # python -m looks there first: no checkout may be there
            env={**os.environ, **settings, "BODYTRACK_DATA": str(Path(os.environ["BODYTRACK_DATA"]).resolve())},
            capture_output=True,
            text=True,
            check=False,
        )
        (folder / "printed.txt").write_text(done.stdout + done.stderr, encoding="utf-8")
        return "" if done.returncode == 0 else (done.stderr.strip().splitlines() or [f"exit {done.returncode}"])[-1]


@dataclass(frozen=True)
class Asked:
    """What is run."""

    model: str
    acquired: bool
    plates: bool
    settings: tuple[str, ...]
    start: int
    stop: int


@dataclass(frozen=True)
class Score:
    """One person of one run; a row of the table."""

    recording: str
    person: str
    model: str
    acquired: bool
    plates: bool
    settings: str
    start: int
    stop: int
    code: str
    commit: str
    failed: str = ""
    """Why there is nothing below."""

    n_frames: int = 0
    lost: int = 0
    mean_mm: float = np.nan
    removed_mm: float = np.nan
    """With constant offsets removed."""

    turned_mm: float = np.nan
    """With offsets removed that are constant in the axes of the trunk."""

    under_100: float = np.nan
    """Share of all frames with a pose less than 100 mm off on average."""

    elbows_deg: float = np.nan
    elbows_removed_deg: float = np.nan
    knees_deg: float = np.nan
    knees_removed_deg: float = np.nan
    wrong: int = 0
    """Frames not lost and 100 mm off on average."""

    wrong_flagged: int = 0
    limb_off: int = 0
    """Frames not lost with a joint 150 mm off."""

    limb_off_flagged: int = 0
    """Those in which such a joint is flagged."""

    false_flags: int = 0
    """Frames not lost with a joint flagged, but none 150 mm and a mean of less than 100 mm off."""

    confidence: float = np.nan
    cpu_s: float = np.nan
    """Processor time of the whole run, its start with it."""

    frame_s: float = np.nan
    """The same of a frame, the median without the first one; unknown where frames are written in windows."""

    slow_frame_s: float = np.nan
    """The same that nine of ten frames stay under."""

    exchanged: str = ""
    """Name of the person whose place this one has."""

    @property
    def key(self) -> tuple[str, ...]:
        """What is not run again with the same code."""
        names = ("recording", "model", "acquired", "plates", "settings", "start", "stop", "code")
        return tuple(str(getattr(self, name)) for name in names)


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
    words = " ".join(asked.settings)
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
        " ".join(asked.settings),
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
    failed = code.run(["run", "config.toml", *overrides, "--output", "result"], folder)
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
        curve: joint -> distances to the truth in the frames that are not lost, mm, and their numbers.
    """
    joints = [name for name in curve if name != "frame"]
    gaps = np.stack([curve[name] for name in joints])
    flags = _flags(result, errors.person, joints, curve["frame"])
    flagged = flags.all(axis=0)
    wrong, limb_off = gaps.mean(axis=0) >= TRACKED_MM, (gaps > LIMB_MM).any(axis=0)
    elbows, knees = _hinges(errors, "elbow"), _hinges(errors, "knee")
    spent_s = np.array([float(entry["processor_s"]) for entry in read_rows(result / CLOCK_FILE)])
    one_by_one = _ONE_PASS in row.settings.split() and len(spent_s) > 1
    frames_s = spent_s[1:] if one_by_one else np.array([np.nan])
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
        wrong=int(wrong.sum()),
        wrong_flagged=int((wrong & flagged).sum()),
        limb_off=int(limb_off.sum()),
        limb_off_flagged=int(((gaps > LIMB_MM) & flags).any(axis=0).sum()),
        false_flags=int((flags.any(axis=0) & ~wrong & ~limb_off).sum()),
        confidence=_confidence(result, errors.person),
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


def _confidence(result: Path, person: str) -> float:
    """Of the person's first start pose, as the log tells."""
    for name, sure in _CONFIDENCE.findall((result / "log.txt").read_text(encoding="utf-8")):
        if name == person:
            return float(sure)
    return np.nan


def by_person(scores: Sequence[Score]) -> dict[tuple[str, str], list[Score]]:
    """(Recording, person) -> rows, in their order; a run that failed is of all who are known of its recording."""
    persons: dict[str, set[str]] = {}
    for one in scores:
        persons.setdefault(one.recording, set()).update({one.person} - {""})
    return {
        (recording, person): [one for one in scores if one.recording == recording and one.person in ("", person)]
        for recording, names in persons.items()
        for person in sorted(names or {""})
    }


def newest(scores: Sequence[Score]) -> list[Score]:
    """The rows of the code that each run was made with last."""
    last = {one.key[:-1]: one.code for one in scores}
    return [one for one in scores if one.code == last[one.key[:-1]]]


def as_cells(score: Score) -> dict[str, object]:
    """The columns of the file of scores."""
    return asdict(score)


def from_cells(cells: dict[str, str]) -> Score:
    """A row of the file of scores, read again."""
    kinds = {field.name: str(field.type) for field in fields(Score)}
    readers: dict[str, Callable[[str], Any]] = {"str": str, "int": int, "float": float, "bool": "True".__eq__}
    return Score(**{name: readers[kind](cells[name]) for name, kind in kinds.items()})
