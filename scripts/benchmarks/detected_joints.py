"""Joints of a run beside those that its 2-D detections have in space by themselves, triangulated robustly.

What a model is for: bones of constant length, feet that stand where they stand, no joint missing.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.recorded import Recorded
from benchmarks.recording_run import Asked
from tracker.bodies.body import BodyModel
from tracker.bodies.body.description import load_body
from tracker.bodies.keypoint_layouts.views import KeypointViews
from tracker.bodies.keypoints import limbs, skeletons, swapped_sides
from tracker.cameras.frame import Frame
from tracker.cameras.rig import Rig
from tracker.cameras.rig_layouts import load_rig
from tracker.foundation.arrays import Array, Mask
from tracker.foundation.resources import model_path
from tracker.results.evaluation.joints import Frames, JointNames, read_joints, read_rows

_SIDES = "left", "right"
JOINTS = tuple(f"{side}_{joint}" for joint in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle") for side in _SIDES)
"""What all detectors, models and truths have."""

BONES = tuple(
    (f"{side}_{one}", f"{side}_{other}")
    for one, other in (("shoulder", "elbow"), ("elbow", "wrist"), ("hip", "knee"), ("knee", "ankle"))
    for side in _SIDES
)

_STANDS_MM = 2.0
"""A true ankle that moves less than this from one frame to the next stands: at 25 frames a second, 5 cm/s."""

_LEAST_CONFIDENCE = 0.3
"""Detections of less are left out, as `initialization.keypoints` does."""


@dataclass(frozen=True)
class InSpace:
    """What joints in space are like; millimetres."""

    mean_mm: float
    """Distance to the truth, of the joints that are there."""

    removed_mm: float
    """The same with constant offsets removed."""

    worst_mm: float
    """The mean of the worst frame, with offsets removed."""

    bones_mm: float
    """RMS difference of bone lengths to the mean of each bone."""

    bones_worst_mm: float
    slide_mm: float
    """RMS step of an ankle from one frame to the next while the true one stands; NaN if it never does."""

    missing: float
    """Share of the joints that are not there."""

    frames_missing: int
    """Frames without any joint."""


_COLUMNS: dict[str, tuple[Callable[[InSpace], float], str]] = {
    "joints mm": (lambda one: one.mean_mm, ".0f"),
    "offsets removed": (lambda one: one.removed_mm, ".0f"),
    "worst frame": (lambda one: one.worst_mm, ".0f"),
    "bones RMS mm": (lambda one: one.bones_mm, ".1f"),
    "worst": (lambda one: one.bones_worst_mm, ".0f"),
    "slide mm a frame": (lambda one: one.slide_mm, ".1f"),
    "joints missing %": (lambda one: 100 * one.missing, ".1f"),
    "frames missing": (lambda one: one.frames_missing, ".0f"),
}
_LEGEND = (
    "detections triangulated by themselves, robustly / the run that used them; 12 joints: shoulders to wrists, hips to "
    "ankles. Bones: difference of a bone's length from its mean. Slide: RMS step of an ankle while the true one stands "
    f"(less than {_STANDS_MM:g} mm a frame)"
)


def print_beside(console: Console, runs: Sequence[tuple[Recorded, Asked, Path]]) -> None:
    """Prints for each run what its joints are like, beside those of its detections by themselves.

    Args:
        console: where to.
        runs: recording, what was run, and the result folder, which is not there if the run has failed.
    """
    table = Table(title="beside the detections' own triangulation", title_justify="left")
    for name in ("recording", "model", "start"):
        table.add_column(name, no_wrap=True)
    for name in _COLUMNS:
        table.add_column(name, justify="right")
    known: dict[str, DetectedRecording] = {}
    for recording, asked, result in runs:
        frames = tracked_frames(result)
        if frames:
            detected = known.setdefault(recording.name, DetectedRecording(recording))
            both = detected.triangulated(frames), detected.of_run(result, frames)
            cells = [" / ".join(f"{value(one):{shown}}" for one in both) for value, shown in _COLUMNS.values()]
            table.add_row(recording.name, asked.model, str(asked.start), *cells)
    console.print(table)
    console.print(_LEGEND, style="dim", soft_wrap=True)


def tracked_frames(result: Path) -> range:
    """The frames of a run; none if it has failed."""
    if not (result / "poses.csv").is_file():
        return range(0)
    numbers = [int(row["frame"]) for row in read_rows(result / "poses.csv")]
    return range(min(numbers), max(numbers) + 1)


def measured(found: Array, truth: Array) -> InSpace:
    """What joints are like, beside the truth.

    Args:
        found: (T, J, 3) metres, in the order of `JOINTS`; NaN for a joint that is missing.
        truth: (T, J, 3) metres; NaN where it does not know.
    """
    gaps = found - truth
    removed = np.linalg.norm(gaps - np.nanmean(gaps, axis=0), axis=-1)
    known, there = _given(truth), _given(found)
    lengths = np.stack(
        [np.linalg.norm(found[:, JOINTS.index(a)] - found[:, JOINTS.index(b)], axis=1) for a, b in BONES]
    )
    differences = lengths - np.nanmean(lengths, axis=1, keepdims=True)
    present = removed[there.any(axis=1) & known.any(axis=1)]
    return InSpace(
        mean_mm=1000 * float(np.nanmean(np.linalg.norm(gaps, axis=-1))),
        removed_mm=1000 * float(np.nanmean(removed)),
        worst_mm=1000 * float(np.nanmean(present, axis=1).max()),
        bones_mm=1000 * float(np.sqrt(np.nanmean(differences**2))),
        bones_worst_mm=1000 * float(np.nanmax(np.abs(differences))),
        slide_mm=1000 * _slide(found, truth),
        missing=float(np.count_nonzero(known & ~there) / max(int(np.count_nonzero(known)), 1)),
        frames_missing=int(np.count_nonzero(known.any(axis=1) & ~there.any(axis=1))),
    )


def _given(points: Array) -> Mask:
    """Which of points (..., 3) are there."""
    given: Mask = np.asarray(np.isfinite(points).all(axis=-1))
    return given


def _slide(found: Array, truth: Array) -> float:
    ankles = [k for k, name in enumerate(JOINTS) if name.endswith("ankle")]
    steps, true_steps = (np.linalg.norm(np.diff(one[:, ankles], axis=0), axis=-1) for one in (found, truth))
    standing = steps[true_steps < _STANDS_MM / 1000]
    standing = standing[np.isfinite(standing)]
    return float(np.sqrt(np.mean(standing**2))) if len(standing) else np.nan


@dataclass(frozen=True)
class DetectedRecording:
    """A recording of one person with its truth and its detections."""

    recording: Recorded
    _found: dict[int, Array] = field(default_factory=dict, repr=False, compare=False)

    def of_run(self, result: Path, frames: range) -> InSpace:
        """Joints of a result folder."""
        table = read_joints(result / "joints.csv").persons
        return measured(self._in_order(next(iter(table.values()), {}), frames), self.truth(frames))

    def triangulated(self, frames: range) -> InSpace:
        """The detections' own joints: robust triangulation, persons and sides sorted out between the views."""
        return measured(np.array([self._triangulated(frame) for frame in frames]), self.truth(frames))

    def truth(self, frames: range) -> Array:
        """(T, J, 3) metres; NaN where it does not know."""
        return self._in_order(next(iter(read_joints(self.recording.truth).persons.values())), frames)

    def _in_order(self, table: Frames, frames: range) -> Array:
        points = np.full((len(frames), len(JOINTS), 3), np.nan)
        for n, frame in enumerate(frames):
            joints = self._names.of(table.get(frame, {}))
            for k, name in enumerate(JOINTS):
                points[n, k] = joints.get(name, np.nan)
        return points

    def _triangulated(self, frame: int) -> Array:
        """(J, 3) metres; NaN where fewer than two views agree."""
        if frame not in self._found:
            views, body = self._views, self._body
            found = views.at(Frame(frame, 0.0, ()), self._rig, least_confidence=_LEAST_CONFIDENCE)
            orders = swapped_sides(views.names, body.mirror), limbs(views.names, body)
            persons = skeletons(self._rig, found, *orders, most=1)
            order = [views.names.index(name) for name in JOINTS]
            self._found[frame] = persons[0].points[order] if persons else np.full((len(JOINTS), 3), np.nan)
        return self._found[frame]

    @cached_property
    def _rig(self) -> Rig:
        path = os.path.expandvars(str(self.recording.reading["rig"]))
        return load_rig(Path(path))

    @cached_property
    def _views(self) -> KeypointViews:
        return KeypointViews.open(self.recording.keypoints, self._rig.names)

    @cached_property
    def _body(self) -> BodyModel:
        return load_body(model_path("human"))

    @property
    def _names(self) -> JointNames:
        return JointNames(self._body.joints, self._body.mirror)
