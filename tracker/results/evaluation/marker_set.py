"""The marker set: markers of each joint, and the axes in which the joint may lie beside their middle."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pydantic

from tracker.bodies.body.sections import Entry
from tracker.foundation.arrays import Array
from tracker.foundation.errors import ConfigError, nearest
from tracker.foundation.source_files import toml_of
from tracker.results.evaluation.time_correlation import Clocked
from tracker.results.markers import Markers

_COLLINEAR = 0.3
"""Sine of the angle below which a second direction does not show a joint's turn about the first."""


_SEGMENT = "_4X4"
"""Ending of segment names by programs that write rotations."""


class MarkerSet(Entry):
    """A marker set file."""

    joints: dict[str, tuple[str, ...]]
    """Joint of the body -> its markers, whose middle is near its centre; best a pair on both sides of it."""

    angles: dict[str, tuple[str, str, str]] = pydantic.Field(default_factory=dict)
    """Further angles to compare: name -> three joints, the angle between the bones from the first to the last; the
    hinges of the body's model file are compared anyway."""

    unit: Literal["m", "dm", "cm", "mm", "in", "ft"] | None = None
    """Unit of the recording's lengths, if its file has none or a wrong one."""


@dataclass(frozen=True)
class MarkerJoints(Clocked):
    """Joints made of markers."""

    frames: Array
    """(T, J, 3, C) axes (columns) in which a joint may keep a place beside its markers, in the marker world. Three turn
    with the markers (for a joint of one marker they are the world's). Three more, where hinges are known, turn with the
    bone that ends there, which pronation does not turn; zeros elsewhere."""

    shifts: tuple[bool, ...]
    """(J,) whether the frame turns, so that a constant distance of the joint from its markers' middle can show."""

    def frames_at(self, times_s: Array) -> Array:
        """(T', J, 3, C) interpolated linearly: they are nearly axes."""
        n_joints, n_axes = self.points.shape[1], self.frames.shape[-1]
        between = Clocked(self.times_s, self.frames.reshape(len(self.times_s), -1, n_axes)).at(times_s)
        return between.reshape(-1, n_joints, 3, n_axes)

    def chosen(self, kept: list[int]) -> MarkerJoints:
        """Some of the joints."""
        shifts = tuple(self.shifts[k] for k in kept)
        return MarkerJoints(self.times_s, self.points[:, kept], self.frames[:, kept], shifts)


def load_marker_set(path: Path) -> MarkerSet:
    """Reads a marker set file.

    Raises:
        ConfigError: it is missing, not TOML, has other keys than `joints`, `angles` and `unit`, or names a marker
            twice.
    """
    table: dict[str, Any] = toml_of(path, ConfigError, "the marker set")
    try:
        markers = MarkerSet.model_validate(table)
    except pydantic.ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"])) or "joints"
        raise ConfigError(f"{path} [{where}]: {first['msg'].removeprefix('Value error, ')}") from error
    for joint, names in markers.joints.items():
        if not names or len(set(names)) != len(names):
            raise ConfigError(f"{path} [joints.{joint}]: expected one marker or more, each once")
    for one, other in itertools.combinations(markers.joints, 2):
        if set(markers.joints[one]) == set(markers.joints[other]):
            raise ConfigError(
                f"{path} [joints]: {one} and {other} are made of the same markers: {', '.join(markers.joints[one])}"
            )
    return markers


def check_marker_set(markers: MarkerSet, path: Path, recording: Markers, joints: Iterable[str]) -> None:
    """Checks that a recording has the markers, and the body the joints, of a set.

    Raises:
        ConfigError: one is missing; the message names the nearest valid one.
    """
    valid = tuple(joints)
    for joint, names in markers.joints.items():
        if joint not in valid:
            raise ConfigError(f'{path} [joints]: the result has no joint "{joint}"; {nearest(joint, valid)}')
        for name in names:
            column(name, path, recording)
    for angle, chain in markers.angles.items():
        for joint in chain:
            if joint not in markers.joints:
                known = nearest(joint, markers.joints)
                raise ConfigError(f'{path} [angles.{angle}]: no joint "{joint}" in this set; {known}')
        if len(set(chain)) < len(chain):
            raise ConfigError(f"{path} [angles.{angle}]: {', '.join(chain)}: expected three different joints")


def column(name: str, path: Path, recording: Markers) -> int:
    """Column of a marker in the recording.

    `LELB` is found also as `Anna:LELB`, as Vicon names it, and `pelvis` as `pelvis_4X4`, as Theia names a segment.

    Raises:
        ConfigError: it is missing, or several markers or subjects have the name.
    """
    spelt = (name, f"{name}{_SEGMENT}")
    ways = [[k for k, own in enumerate(recording.names) if own == one] for one in spelt]
    ways.append([k for k, own in enumerate(recording.names) if own.rpartition(":")[2] in spelt])
    found = next(filter(None, ways), [])
    if len(found) == 1:
        return found[0]
    if not found:
        known = "; ".join([nearest(name, recording.names), *recording.remarks])
        raise ConfigError(f'{path} [joints]: the recording has no marker "{name}"; {known}')
    owners = list(dict.fromkeys(recording.names[k] for k in found))
    if len(owners) < len(found):
        raise ConfigError(
            f'{path} [joints]: {len(found)} markers of the recording are called "{name}": rename the others '
            "in the program that wrote it, or leave the joint out of the set"
        )
    raise ConfigError(f'{path} [joints]: "{name}" is a marker of several subjects: write one of {", ".join(owners)}')


def joints_of(
    markers: MarkerSet, path: Path, recording: Markers, hinges: Iterable[tuple[int, int, int]] = ()
) -> MarkerJoints:
    """The joints of a set, in its order; NaN where one of a joint's markers is missing.

    Args:
        markers: the set, checked.
        path: of its file, for messages.
        recording: positions of the markers.
        hinges: columns of the joint before, the hinge, and the joint behind, where bones end.
    """
    own = [[column(name, path, recording) for name in names] for names in markers.joints.values()]
    middles = np.stack([recording.points[:, columns].mean(axis=1) for columns in own], axis=1)
    frames = np.tile(np.eye(3), (*middles.shape[:2], 1, 1))
    shifts = []
    for k, columns in enumerate(own):
        turning = _frames(recording.points[:, columns], np.delete(middles, k, axis=1))
        shifts.append(turning is not None)
        if turning is not None:
            frames[:, k] = turning
    bones = _bones(middles, frames, [hinge for hinge in hinges if shifts[hinge[1]] and shifts[hinge[2]]])
    return MarkerJoints(recording.times_s, middles, np.concatenate([frames, *bones], axis=-1), tuple(shifts))


def _bones(middles: Array, frames: Array, hinges: list[tuple[int, int, int]]) -> list[Array]:
    """Axes (T, J, 3, 3) of the bones behind hinges, with the hinge's pair of markers across; empty without hinges.

    Skin drags a wrist's markers along as the forearm turns, by 2 mm: its centre moves partly with them and partly with
    the bone. With the markers' axes alone a body without an arm was 0.30 and 0.38 deg off, now 0.25 and 0.28:
    docs/lab/marker_alignment.md.
    """
    if not hinges:
        return []
    bones = np.zeros_like(frames)
    for _, hinge, behind in hinges:
        along = _unit(middles[:, behind] - middles[:, hinge])
        pair = frames[:, hinge, :, 0]
        across = _unit(pair - along * (pair * along).sum(axis=1, keepdims=True))
        bones[:, behind] = np.stack([along, across, np.cross(along, across)], axis=-1)
    return [bones]


def _frames(markers: Array, others: Array) -> Array | None:
    """Axes (T, 3, 3) from a joint's first two markers and a point at fixed distances from both; None without one.

    Args:
        markers: (T, n, 3) of the joint.
        others: (T, m, 3) the other joints.
    """
    if markers.shape[1] < 2:
        return None
    one, two = markers[:, 0], markers[:, 1]
    along = _unit(one - two)
    best, chosen = np.inf, None
    for partner in np.concatenate([markers[:, 2:], others], axis=1).transpose(1, 0, 2):
        towards = partner - (one + two) / 2
        across = towards - along * (towards * along).sum(axis=1, keepdims=True)
        sine = np.linalg.norm(across, axis=1) / np.linalg.norm(towards, axis=1)
        known = np.isfinite(sine)
        if known.sum() < 2 or np.median(sine[known]) < _COLLINEAR:
            continue
        loose = sum(float(np.nanstd(np.linalg.norm(partner - marker, axis=1))) for marker in (one, two))
        if loose < best:
            best, chosen = loose, _unit(across)
    return None if chosen is None else np.stack([along, chosen, np.cross(along, chosen)], axis=-1)


def _unit(vectors: Array) -> Array:
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    unit: Array = vectors / np.where(lengths > 0, lengths, np.nan)
    return unit
