"""A finished run, loaded from its folder: poses, times, uncertainties, and how it was made."""

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
from tracker.foundation.arrays import Array, Integers, Mask, frozen
from tracker.foundation.errors import ConfigError, name_fault, nearest
from tracker.foundation.source_files import json_of, one_line
from tracker.results.recording.csv_table import joint_statuses
from tracker.results.recording.journal import Expected, open_journal
from tracker.tracking.doubt import Doubt
from tracker.tracking.estimate import Estimate
from tracker.tracking.trajectory import Replay, Step


@dataclass(frozen=True, repr=False)
class Track:
    """Movement of one person; a lost person is NaN everywhere."""

    name: str
    body: BodyModel
    frames: Integers
    """(T,) numbers of the frames."""

    times_s: Array
    """(T,) seconds."""

    estimates: tuple[Estimate, ...]
    """(T,) everything about each frame; poses of lost frames are predictions, not to be used."""

    def __repr__(self) -> str:
        """Name, model and number of frames."""
        return f"Track({self.name!r}, model {self.body.name!r}, {len(self.frames)} frames)"

    @cached_property
    def lost(self) -> Mask:
        """(T,) frames in which the person is lost."""
        mask: Mask = frozen([estimate.lost for estimate in self.estimates], dtype=np.bool_)
        return mask

    @cached_property
    def poses(self) -> Array:
        """(T, dof) rad and m, columns as `parameters`."""
        return self._without_lost(np.array([estimate.q for estimate in self.estimates]))

    @cached_property
    def covariances(self) -> Array:
        """(T, dof, dof) of the poses."""
        return self._without_lost(np.array([estimate.covariance for estimate in self.estimates]))

    @cached_property
    def sigmas(self) -> Array:
        """(T, dof) standard deviations of the poses, rad and m."""
        return frozen(np.sqrt(np.maximum(np.diagonal(self.covariances, axis1=1, axis2=2), 0)))

    @cached_property
    def statuses(self) -> tuple[str, ...]:
        """(T,) `tracked`, `bootstrapped`, `recovered`, `doubtful` or `lost`; in a smoothed result also `filled`."""
        return tuple(str(estimate.verdict) for estimate in self.estimates)

    @cached_property
    def ambiguous(self) -> tuple[tuple[str, ...], ...]:
        """(T,) ambiguous limbs."""
        return tuple(estimate.ambiguous for estimate in self.estimates)

    @cached_property
    def doubts(self) -> tuple[tuple[Doubt, ...], ...]:
        """(T,) why the person is lost or doubtful, or limbs are ambiguous."""
        return tuple(estimate.doubts for estimate in self.estimates)

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the pose parameters, in the order of `poses`."""
        return self.body.names

    @cached_property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints, in the order of `joints`."""
        return tuple(self.body.landmark_names[mark] for mark in self.body.reported)

    @cached_property
    def joints(self) -> Array:
        """(T, J, 3) joint centres in the world, metres."""
        poses = np.array([estimate.q for estimate in self.estimates])
        return self._without_lost(self.body.landmarks_in_world(poses)[:, list(self.body.reported)])

    @cached_property
    def joint_statuses(self) -> tuple[tuple[str, ...], ...]:
        """(T, J) the frame's status, or `ambiguous` on an ambiguous limb."""
        person = Person(self.name, self.body, self.body.rest())
        told = (joint_statuses(person, estimate) for estimate in self.estimates)
        return tuple(tuple(statuses[mark] for mark in self.body.reported) for statuses in told)

    def parameter(self, name: str) -> Array:
        """One parameter over time (T,), rad or m.

        Raises:
            ModelError: the parameter does not exist.
        """
        return self.poses[:, self.body.index(name)]

    def joint(self, name: str) -> Array:
        """One joint over time (T, 3), metres.

        Raises:
            ConfigError: the joint does not exist.
        """
        if name not in self.joint_names:
            raise ConfigError(f'"{self.name}" has no joint "{name}"; {nearest(name, self.joint_names)}')
        return self.joints[:, self.joint_names.index(name)]

    def columns(self) -> dict[str, Any]:
        """All values side by side in the units of the tables, for `pandas.DataFrame(track.columns())`.

        Returns:
            Column name -> (T,) values: `frame`, `time_s`, `status`, `left_arm_extension_deg`,
            `left_arm_extension_sigma_deg`, `left_elbow_x_m`, ...
        """
        units = np.where(self.body.rotates, 180 / np.pi, 1.0)
        table: dict[str, Any] = {"frame": self.frames, "time_s": self.times_s, "status": list(self.statuses)}
        for k, parameter in enumerate(self.body.parameters):
            table[parameter.column] = units[k] * self.poses[:, k]
        for k, parameter in enumerate(self.body.parameters):
            table[f"{parameter.name}_sigma_{parameter.unit}"] = units[k] * self.sigmas[:, k]
        for j, name in enumerate(self.joint_names):
            table |= {f"{name}_{axis}_m": self.joints[:, j, k] for k, axis in enumerate("xyz")}
        return table

    def _without_lost(self, values: Array) -> Array:
        values[self.lost] = np.nan
        return frozen(values)


log = logging.getLogger("tracker")

CHANGED = frozenset(("smoothing", "alignment", "alignment_change"))
"""Keys of run.json that mark changed poses in a result of their own."""


@dataclass(frozen=True, repr=False)
class Result:
    """A finished run."""

    name: str
    folder: Path
    rig: Rig
    """The cameras, for the images as tracked."""

    bodies: Mapping[str, BodyModel]
    """Person -> model as scaled for the run."""

    replays: tuple[Replay, ...]
    """The frames, exact to the last bit."""

    details: Mapping[str, Any]
    """Content of run.json: configuration, versions, hashes of the inputs, summary."""

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
        """Name, folder, number of frames and persons."""
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
        """Tracks of all persons."""
        return tuple(
            Track(name, body, self.frames, self.times_s, tuple(replay.estimates[k] for replay in self.replays))
            for k, (name, body) in enumerate(self.bodies.items())
        )

    @cached_property
    def scene(self) -> Scene:
        """The persons at rest, and the cameras."""
        return Scene(tuple(Person(name, body, body.rest()) for name, body in self.bodies.items()), self.rig)

    def person(self, name: str) -> Track:
        """Track of one person.

        Raises:
            ConfigError: no person has that name.
        """
        if name not in self.bodies:
            raise ConfigError(f'{self.folder}: no person is called "{name}"; {nearest(name, self.bodies)}')
        return self.persons[list(self.bodies).index(name)]

    def steps(self) -> Iterator[Step]:
        """The run's frames as recordings take them, without images and contours."""
        return replayed(self.scene, self.replays)


def replayed(scene: Scene, replays: Iterable[Replay]) -> Iterator[Step]:
    """Frames as recordings take them, without images and contours.

    Args:
        scene: the persons (their poses do not matter) and the rig.
        replays: the estimates.
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
            told_unfaced=replay.unfaced,
        )


def load_result(folder: Path | str) -> Result:
    """Loads a finished, or interrupted, run.

    Args:
        folder: its result folder, for instance `results/my_run/latest`.

    Raises:
        TrackerError: the folder is not a run's, or a file in it is damaged.
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
        log.warning("%s: %s: the rest is left out", journal.path, journal.fault)
    if not journal:
        kept = "is kept yet of this run, see its tables, or go on with `bodytrack run ... --resume`"
        raise ConfigError(f"{folder}: no frame {kept if told.get('complete') is False else 'was tracked in this run'}")
    for remark in remarks(path.parent, told):
        log.warning("%s: %s", folder, remark)
    return Result(told["name"], path.parent, rig, bodies, tuple(journal.values()), told)


def remarks(folder: Path, told: Mapping[str, Any]) -> tuple[str, ...]:
    """Warnings: the run is not finished, or has gone on since this was made of it.

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
    """Content of run.json, with the persons' names under `names`.

    Raises:
        ConfigError: an entry is missing or impossible.
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
