"""A finished run, loaded from its folder: who did what when, how sure that is, and what it was made with."""

from __future__ import annotations

import contextlib
import logging
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from tracker.bodies.body import BodyModel
from tracker.bodies.body.description import load_body
from tracker.bodies.contours import Contours
from tracker.bodies.scene import Person, Scene
from tracker.cameras.frame import Frame
from tracker.cameras.rig import Rig
from tracker.cameras.rig_layouts import load_rig
from tracker.foundation.arrays import Array, Integers, frozen
from tracker.foundation.errors import ConfigError, name_fault, nearest
from tracker.foundation.source_files import json_of, one_line
from tracker.results.person_track import Track
from tracker.results.recording.journal import Expected, open_journal
from tracker.tracking.trajectory import Replay, Step

log = logging.getLogger("tracker")

CHANGED = frozenset(("smoothing", "alignment", "alignment_change"))
"""What run.json tells of poses that were changed after the run, in a result of their own."""


@dataclass(frozen=True, repr=False)
class Result:
    """A finished run."""

    name: str
    folder: Path
    rig: Rig
    """The cameras of the images as they were tracked."""

    bodies: Mapping[str, BodyModel]
    """Person -> model as scaled for the run."""

    replays: tuple[Replay, ...]
    """The frames, to the last bit."""

    details: Mapping[str, Any]
    """What run.json tells: configuration, versions, hashes of the inputs, summary."""

    @cached_property
    def frames(self) -> Integers:
        """(T,) numbers of the frames."""
        numbers: Integers = frozen([replay.index for replay in self.replays], dtype=np.int64)
        return numbers

    @cached_property
    def times_s(self) -> Array:
        """(T,) seconds."""
        return frozen([replay.time_s for replay in self.replays])

    def __repr__(self) -> str:
        """Of what run, how long, and who is in it."""
        return f"Result({self.name!r}, {str(self.folder)!r}, {len(self.replays)} frames of {', '.join(self.bodies)})"

    @property
    def fps(self) -> float:
        """Frames per second of the recording, before any stride."""
        return float(self.details["fps"])

    @property
    def interval_s(self) -> float:
        """Usual time from one frame to the next, seconds."""
        return float(self.details["interval_s"])

    @cached_property
    def persons(self) -> tuple[Track, ...]:
        """What was found of each person."""
        return tuple(
            Track(name, body, self.frames, self.times_s, tuple(replay.estimates[k] for replay in self.replays))
            for k, (name, body) in enumerate(self.bodies.items())
        )

    @cached_property
    def scene(self) -> Scene:
        """The persons at rest, and the cameras."""
        return Scene(tuple(Person(name, body, body.rest()) for name, body in self.bodies.items()), self.rig)

    def person(self, name: str) -> Track:
        """What was found of a person.

        Raises:
            ConfigError: nobody is called so.
        """
        if name not in self.bodies:
            raise ConfigError(f'{self.folder}: nobody is called "{name}"; {nearest(name, self.bodies)}')
        return self.persons[list(self.bodies).index(name)]

    def steps(self) -> Iterator[Step]:
        """The run's frames as recordings take them, without images and contours."""
        return replayed(self.scene, self.replays)


def replayed(scene: Scene, replays: Iterable[Replay]) -> Iterator[Step]:
    """Frames as recordings take them, without images and contours.

    Args:
        scene: the persons (their poses do not matter) and the rig.
        replays: what was estimated.
    """
    blank = _no_contours(len(scene.rig))
    for replay in replays:
        frame = Frame(replay.index, replay.time_s, (None,) * len(scene.rig))
        posed = scene.with_poses(tuple(estimate.q for estimate in replay.estimates))
        yield Step(
            frame,
            posed,
            replay.estimates,
            blank,
            dict(replay.seconds),
            replay.overlap,
            untrusted=replay.untrusted,
            strangers=replay.strangers,
            told_confidence=replay.start_confidence,
        )


def load_result(folder: Path | str) -> Result:
    """Loads a finished, or interrupted, run.

    Args:
        folder: its result folder, for instance `results/my_run/latest`.

    Raises:
        TrackerError: the folder is not that of a run, or something in it is damaged.
    """
    path = Path(folder) / "run.json"
    if Path(folder).is_file():
        raise ConfigError(f"{folder}: a file, expected the folder of a run, for instance results/my_run/latest")
    if not path.is_file():
        raise ConfigError(
            f"{path}: no such file: expected the folder of a run with the recordings run_json and journal, "
            "for instance results/my_run/latest"
        )
    told = _told(path)
    rig, models = load_rig(path.parent / "rig.toml"), path.parent / "models"
    bodies = {name: load_body(models / f"{name}.toml") for name in told["names"]}
    scene = Scene(tuple(Person(name, body, body.rest()) for name, body in bodies.items()), rig)
    journal = open_journal(path.parent, Expected.of(scene))
    if journal.fault:
        log.warning("%s: %s: what follows is left out", journal.path, journal.fault)
    if not journal:
        kept = "is kept yet of this run, see its tables, or go on with `bodytrack run ... --resume`"
        raise ConfigError(f"{folder}: no frame {kept if told.get('complete') is False else 'was tracked in this run'}")
    for remark in remarks(path.parent, told):
        log.warning("%s: %s", folder, remark)
    return Result(told["name"], path.parent, rig, bodies, tuple(journal.values()), told)


def remarks(folder: Path, told: Mapping[str, Any]) -> tuple[str, ...]:
    """What whoever uses a result should know: its run is not finished, or has gone on since this was made of it.

    Args:
        folder: of the result.
        told: content of its run.json.
    """
    found = []
    if told.get("complete") is False:
        found.append("the run was not finished; `bodytrack run ... --resume` goes on with it")
    with contextlib.suppress(ConfigError, OSError, KeyError, TypeError, AttributeError):
        raw = json_of(folder.resolve().parent / "run.json", ConfigError)
        own, whole = told["summary"]["frames"], raw["summary"]["frames"]
        if CHANGED & told.keys() and own < whole:
            found.append(f"made when the run had {own} frames, it has {whole} now: make it anew")
    return tuple(found)


def _told(path: Path) -> dict[str, Any]:
    """What run.json tells, and under `names` those of the persons.

    Raises:
        ConfigError: something that a run writes there is missing or cannot be.
    """
    try:
        told: dict[str, Any] = dict(json_of(path, ConfigError))
        names = [str(entry["name"]) for entry in told["persons"]]
        fault = next((fault for fault in map(name_fault, (*names, str(told["name"]))) if fault), "")
        intervals = float(told["fps"]), float(told["interval_s"])
        dict(told["summary"])
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError) as error:
        kind = type(error).__name__
        raise ConfigError(f"{path}: damaged, or of another version ({kind}: {one_line(error)})") from error
    if fault or not names or not all(0 < value < math.inf for value in intervals):
        raise ConfigError(f"{path}: damaged: {fault or 'persons, fps or interval_s cannot be'}")
    return {**told, "names": names, "name": str(told["name"])}


def _no_contours(n_views: int) -> Contours:
    samples = np.zeros((1, n_views, 1, 5), dtype=np.float32)
    parts = np.zeros((1, n_views, 1), dtype=np.int64)
    return Contours(samples, samples[..., :3], parts, parts > 0, np.zeros((1, n_views), dtype=np.int64))
