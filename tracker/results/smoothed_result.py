"""A smoothed result: the poses of a finished run without jitter, in a folder beside the raw ones."""

from __future__ import annotations

import csv
import logging
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from tracker.cameras.frame import Frame
from tracker.foundation.arrays import Array, Mask, frozen
from tracker.foundation.configuration.tables import describe
from tracker.foundation.errors import TrackerError
from tracker.foundation.files import whole_folder
from tracker.foundation.progress import Progress, silent
from tracker.results.exports import check_place, write_pictures, write_result
from tracker.results.recording import Recording
from tracker.results.recording.csv_table import parameter_columns
from tracker.results.recording.overlay import Overlay
from tracker.results.result import Result, Track
from tracker.results.smoothing import Smoothed, Smoothing, Stretch, ball_joints, stretches_of, with_angles, with_vectors
from tracker.tracking.doubt import Doubt
from tracker.tracking.estimate import Estimate, Status

FOLDER = "smoothed"
"""Folder in a result."""

_INSTANT_S = 1e-4
"""Step of differences in time, seconds; poses between frames follow velocity and acceleration."""

log = logging.getLogger("tracker")


@dataclass(frozen=True)
class SmoothTrack:
    """One person's smooth movement; NaN where it is unknown."""

    name: str
    estimates: tuple[Estimate, ...]
    """(T,) the raw ones with smooth poses: short gaps are `filled`, frames outside the stretches unchanged."""

    velocities: Array
    """(T, dof) rad/s and m/s."""

    accelerations: Array
    """(T, dof) rad/s2 and m/s2."""


def smooth_track(track: Track, smoothing: Smoothing, interval_s: float) -> SmoothTrack:
    """Smooths one person's track; joints that turn about three axes are smoothed as rotations, see `results.smoothing`.

    Args:
        track: the person's raw poses.
        smoothing: the method.
        interval_s: usual time from one frame to the next.
    """
    pieces = stretches_of(track.times_s, ~track.lost, interval_s, smoothing.max_gap_s)
    stretches = [_stretch(track, piece) for piece in pieces]
    estimates = list(track.estimates)
    velocities = np.full((len(estimates), track.body.dof), np.nan)
    accelerations = velocities.copy()
    joints = ball_joints(track.body, np.concatenate([one.poses[one.known] for one in stretches])) if stretches else ()
    smoothed = smoothing.smooth([with_vectors(stretch, joints) for stretch in stretches])
    for piece, stretch, turned in zip(pieces, stretches, smoothed, strict=True):
        smooth = with_angles(turned, joints, stretch)
        velocities[piece], accelerations[piece] = smooth.velocities, smooth.accelerations
        estimates[piece] = _smooth_estimates(track, piece, stretch, smooth)
    left = int(np.isnan(velocities).any(axis=1)[~track.lost].sum())
    if left:
        log.warning("%s: %d frames between long gaps are too few to be smoothed and stay as they are", track.name, left)
    return SmoothTrack(track.name, tuple(estimates), frozen(velocities), frozen(accelerations))


def _stretch(track: Track, piece: slice) -> Stretch:
    known: Mask = ~track.lost[piece]
    poses = np.array(track.poses[piece])
    found = poses[known]
    poses[known] = np.where(track.body.rotates, np.unwrap(found, axis=0), found)
    return Stretch(track.times_s[piece], poses, track.covariances[piece], known)


def _smooth_estimates(track: Track, piece: slice, stretch: Stretch, smooth: Smoothed) -> list[Estimate]:
    """The raw estimates with smooth poses: inside the joint limits, angles on the turn of the raw ones."""
    turns = np.round((stretch.poses - track.poses[piece]) / (2 * np.pi))
    last = np.maximum.accumulate(np.where(stretch.known, np.arange(len(turns)), 0))
    poses = smooth.poses - np.where(track.body.rotates, 2 * np.pi * turns[last], 0.0)
    rows = zip(track.estimates[piece], track.body.clamped(poses), smooth.covariances, strict=True)
    return [
        # a short gap: why it was one is still told, and no more a doubt of the pose that fills it
        replace(estimate, q=q, covariance=covariance, status=Status.FILLED, doubts=_losing(estimate))
        if estimate.lost
        else replace(estimate, q=q, covariance=covariance)
        for estimate, q, covariance in rows
    ]


def _losing(estimate: Estimate) -> tuple[Doubt, ...]:
    return tuple(doubt for doubt in estimate.doubts if doubt.loses)


@dataclass(frozen=True)
class Pictures:
    """Pictures of a smoothed result."""

    recordings: tuple[Recording, ...]
    """Usually a report and an overlay."""

    frames: Callable[[], Iterator[Frame]]
    """Opens the recording of the result; raises TrackerError if it is gone."""

    progress: Progress = silent
    """Gets the frames written."""


def write_smoothed(
    result: Result,
    smoothing: Smoothing,
    folder: Path | None = None,
    overwrite: bool = False,
    pictures: Pictures | None = None,
) -> Path:
    """Writes a result folder of smooth poses; it loads, exports and is evaluated like the raw one.

    Args:
        result: the raw poses.
        smoothing: the method.
        folder: written as a whole or not at all; None for the folder `smoothed` in the result.
        overwrite: replace an earlier smoothed result, with all that was made of it.
        pictures: reports and videos to write; None for none.

    Returns:
        The folder.

    Raises:
        ConfigError: the smoothing does not fit the frame rate, or the folder is not empty.
    """
    smoothing.check(result.interval_s)
    target = folder or result.folder / FOLDER
    check_place(target, "smoothing", overwrite)
    with whole_folder(target, overwrite) as unfinished:
        tracks = [smooth_track(track, smoothing, result.interval_s) for track in result.persons]
        replays = tuple(
            replace(replay, estimates=tuple(track.estimates[t] for track in tracks))
            for t, replay in enumerate(result.replays)
        )
        details = {**result.details, "smoothing": describe(smoothing)}
        smooth = replace(result, replays=replays, details=details)
        write_result(smooth, unfinished)
        _write_derivatives(smooth, tracks, unfinished)
        if pictures is not None:
            _draw(smooth, pictures, unfinished)
    return target


def _draw(result: Result, pictures: Pictures, folder: Path) -> None:
    """Writes the pictures; without the recording only a report, with numbers and contours."""
    recordings, frames = pictures.recordings, iter(tuple[Frame, ...]())
    try:
        frames = pictures.frames()
    except TrackerError as error:
        log.warning("no overlay, and no images in the report: %s", error)
        recordings = tuple(one for one in recordings if not isinstance(one, Overlay))
    if recordings:
        write_pictures(result, recordings, frames, folder, pictures.progress)


def _write_derivatives(result: Result, tracks: Sequence[SmoothTrack], folder: Path) -> None:
    """`velocities.csv` and `accelerations.csv` of the parameters, `joint_motion.csv` of the joints."""
    for name, unit in (("velocities", "per_s"), ("accelerations", "per_s2")):
        columns = [f"{column}_{unit}" for column in parameter_columns(result.scene.persons)]
        rows = _parameter_rows(result, [getattr(track, name) for track in tracks], columns, unit)
        _write_table(folder / f"{name}.csv", ["frame", "time_s", "person", "status", *columns], rows)
    axes = [f"{kind}{axis}_{unit}" for kind, unit in (("v", "m_per_s"), ("a", "m_per_s2")) for axis in "xyz"]
    _write_table(
        folder / "joint_motion.csv", ["frame", "time_s", "person", "joint", *axes], _joint_rows(result, tracks)
    )


def _write_table(path: Path, columns: Sequence[str], rows: Iterator[list[Any]]) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        writer.writerows([_text(value) for value in row] for row in rows)


def _text(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.6f}" if np.isfinite(value) else ""
    return str(value)


def _parameter_rows(result: Result, values: Sequence[Array], columns: Sequence[str], unit: str) -> Iterator[list[Any]]:
    for t, (frame, time_s) in enumerate(zip(result.frames, result.times_s, strict=True)):
        for track, rates in zip(result.persons, values, strict=True):
            shown = np.where(track.body.rotates, np.degrees(rates[t]), rates[t])
            named = {f"{p.column}_{unit}": float(v) for p, v in zip(track.body.parameters, shown, strict=True)}
            told = [int(frame), float(time_s), track.name, track.statuses[t]]
            yield [*told, *(named.get(column, "") for column in columns)]


def _joint_rows(result: Result, tracks: Sequence[SmoothTrack]) -> Iterator[list[Any]]:
    motions = [joint_motion(*pair) for pair in zip(result.persons, tracks, strict=True)]
    for t, (frame, time_s) in enumerate(zip(result.frames, result.times_s, strict=True)):
        for track, (velocities, accelerations) in zip(result.persons, motions, strict=True):
            for j, joint in enumerate(track.joint_names):
                values = [*velocities[t, j].tolist(), *accelerations[t, j].tolist()]
                yield [int(frame), float(time_s), track.name, joint, *values]


def joint_motion(track: Track, smooth: SmoothTrack) -> tuple[Array, Array]:
    """Velocities and accelerations of the joints in the world (T, J, 3), m/s and m/s2, by kinematics.

    Args:
        track: the smooth poses.
        smooth: its velocities and accelerations.
    """
    poses = np.array([estimate.q for estimate in smooth.estimates])
    curved = 0.5 * _INSTANT_S**2 * smooth.accelerations
    marks = list(track.body.reported)
    before, now, after = (
        track.body.landmarks_in_world(poses + side * _INSTANT_S * smooth.velocities + side**2 * curved)[:, marks]
        for side in (-1, 0, 1)
    )
    now[np.isnan(smooth.velocities).any(axis=1)] = np.nan
    return (after - before) / (2 * _INSTANT_S), (after - 2 * now + before) / _INSTANT_S**2
