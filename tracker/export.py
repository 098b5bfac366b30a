"""Recordings of a finished run, made from its result folder."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from tracker.body_files import load_body
from tracker.contours import Contours
from tracker.errors import ConfigError
from tracker.frame import Frame
from tracker.recording import Recorder, Recording, RunContext
from tracker.recording.journal import read_journal
from tracker.rig_layouts import load_rig
from tracker.scene import Person, Scene
from tracker.trajectory import Replay, Step


def export(result: Path, recordings: Iterable[Recording], output: Path | None = None) -> tuple[Path, ...]:
    """Writes recordings that need poses and times only, no images.

    Args:
        result: folder of a run.
        recordings: what to write.
        output: where to; None for the result folder.

    Returns:
        The files written.

    Raises:
        TrackerError: the folder is not that of a run, or something in it is damaged.
    """
    context = _context(result, output or result)
    replays = read_journal(result)
    if not replays:
        raise ConfigError(f"{result}: no frame was tracked in this run")
    context.folder.mkdir(parents=True, exist_ok=True)
    files: list[Path] = []
    with contextlib.ExitStack() as closing:
        recorders: list[Recorder] = []
        for recording in recordings:
            recorders.append(recording.begin(context))
            closing.callback(_finish, recorders[-1], files)
        for step in _steps(replays, context.scene):
            for recorder in recorders:
                recorder.write(step)
    return tuple(sorted(files))


def _finish(recorder: Recorder, files: list[Path]) -> None:
    files.extend(recorder.finish())


def _context(result: Path, output: Path) -> RunContext:
    """The run as its own recordings knew it."""
    path = result / "run.json"
    try:
        told: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        rig, models = load_rig(result / "rig.toml"), result / "models"
        bodies = {entry["name"]: load_body(models / f"{entry['name']}.toml") for entry in told["persons"]}
        return RunContext(
            name=told["name"],
            folder=output,
            scene=Scene(tuple(Person(name, body, body.rest()) for name, body in bodies.items()), rig),
            fps=told["fps"],
            interval_s=told["interval_s"],
            n_frames=told["summary"]["frames"],
        )
    except OSError as error:
        raise ConfigError(
            f"{path}: {error.strerror}: expected the folder of a run with the recordings run_json and journal, "
            "for instance results/my_run/latest"
        ) from error
    except (ValueError, KeyError, TypeError) as error:
        raise ConfigError(f"{path}: damaged, or of another version ({type(error).__name__}: {error})") from error


def _steps(replays: Iterable[Replay], scene: Scene) -> Iterator[Step]:
    """The run's steps, without images and contours."""
    blank = _no_contours(len(scene.rig))
    for replay in replays:
        frame = Frame(replay.index, replay.time_s, (None,) * len(scene.rig))
        posed = scene.with_poses(tuple(estimate.q for estimate in replay.estimates))
        yield Step(frame, posed, replay.estimates, blank, dict(replay.seconds), replay.overlap)


def _no_contours(n_views: int) -> Contours:
    samples = np.zeros((1, n_views, 1, 5), dtype=np.float32)
    parts = np.zeros((1, n_views, 1), dtype=np.int64)
    return Contours(samples, samples[..., :3], parts, parts > 0, np.zeros((1, n_views), dtype=np.int64))
