"""A result against a marker system: where its clock and world lie, and how far angles and joints are apart."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from tracker.bodies.body.sections import Joints
from tracker.foundation.arrays import Array
from tracker.foundation.errors import shortened
from tracker.results.evaluation.marker_alignment import Alignment, align
from tracker.results.evaluation.marker_set import MarkerSet, check_marker_set, joints_of, load_marker_set
from tracker.results.evaluation.time_correlation import Clocked, flexions
from tracker.results.evaluation.tracked_joints import TrackedJoints, tracked_joints
from tracker.results.marker_layouts import read_markers
from tracker.results.markers import Markers


@dataclass(frozen=True)
class AngleErrors:
    """One angle, ours minus that of the markers, degrees."""

    name: str
    n_frames: int
    """Frames in which both have it."""

    rms_deg: float
    offset_deg: float
    rms_offset_removed_deg: float
    worst_deg: float
    correlation: float


@dataclass(frozen=True)
class JointErrors:
    """One joint against the middle of its markers, millimetres."""

    name: str
    n_frames: int
    mean_mm: float
    mean_offset_removed_mm: float
    """After removing one constant offset in space."""

    p95_mm: float
    beside_mm: float
    """How far its centre lies from the middle of its markers, always to the same side seen from the limb."""


@dataclass(frozen=True)
class MarkerComparison:
    """Everything about one person."""

    track: TrackedJoints
    alignment: Alignment
    marker_rate_hz: float
    marker_gaps: float
    """Share of the markers' positions that are missing."""

    angles: tuple[AngleErrors, ...]
    joints: tuple[JointErrors, ...]
    ours_deg: Array
    """(T, A) angles."""

    theirs_deg: Array
    """(T, A) those of the markers at the same time."""

    distances_mm: Array
    """(T, J) of the joints of the set."""

    findings: tuple[str, ...]
    """What a reader must not overlook."""

    @property
    def n_compared(self) -> int:
        """Frames in which at least one joint is in both."""
        return int(np.isfinite(self.distances_mm).any(axis=1).sum())

    def as_dict(self) -> dict[str, Any]:
        """Plain values without the curves; what is unknown is None."""
        told, placed = self.alignment, self.alignment.placement
        return {
            "person": self.track.person,
            "frames": len(self.track.frames),
            "frames_compared": self.n_compared,
            "marker_time_minus_video_time_s": placed.offset_s,
            "rotation_marker_from_world": placed.rotation.tolist(),
            "translation_m": placed.translation_m.tolist(),
            "sigma": {
                "offset_s": told.offset_sigma_s,
                "rotation_deg": told.rotation_sigma_deg,
                "position_mm": told.position_sigma_mm,
            },
            "correlation": told.correlation,
            "median_distance_mm": placed.median_mm,
            "deciding": placed.deciding,
            "angles": [vars(angle) for angle in self.angles],
            "joints": [vars(joint) for joint in self.joints],
            "findings": list(self.findings),
        }


def compare(
    result: Path, markers: Path, marker_set: Path, person: str | None = None, offset_s: float | None = None
) -> MarkerComparison:
    """Compares a result folder with a marker recording of the same movement.

    Args:
        result: folder of a run, or of a smoothed one.
        markers: `.trc` or `.c3d`.
        marker_set: which markers make which joint.
        person: whom the markers were on; None where there is one only.
        offset_s: marker time minus video time where known within a tenth of a second; None to find it.

    Raises:
        SequenceError: files are missing or damaged, or do not show the same movement.
        ConfigError: the marker set does not fit the recording or the body.
    """
    chosen = load_marker_set(marker_set)
    track, names = tracked_joints(result, person)
    recording = read_markers(markers, chosen.unit)
    check_marker_set(chosen, marker_set, recording, track.names)
    ours = track.chosen(chosen.joints)
    chains = _chains(chosen, names.joints)
    columns = _columns(chosen, chains.values())
    theirs = joints_of(chosen, marker_set, recording, _columns(chosen, _hinges(chosen, names.joints).values()))
    alignment = align(ours, theirs, columns, offset_s)
    when = ours.times_s + alignment.placement.offset_s
    at_frames = Clocked(ours.times_s, alignment.placement.in_our_world(theirs.at(when)))
    beside = np.einsum("tjac,jc->tja", theirs.frames_at(when), alignment.placement.beside_m)
    beside_mm = 1000 * np.linalg.norm(beside, axis=-1)
    mine_deg = flexions(ours.points, columns)
    their_deg = Clocked(theirs.times_s, flexions(theirs.points, columns)[..., None]).at(when)[..., 0]
    gaps = 1000 * (ours.points - at_frames.points)
    return _with_findings(
        MarkerComparison(
            track=track,
            alignment=alignment,
            marker_rate_hz=recording.rate_hz,
            marker_gaps=recording.gaps,
            angles=tuple(_angle(name, mine_deg[:, k], their_deg[:, k]) for k, name in enumerate(chains)),
            joints=tuple(_joint(name, gaps[:, k], beside_mm[:, k]) for k, name in enumerate(chosen.joints)),
            ours_deg=mine_deg,
            theirs_deg=their_deg,
            distances_mm=np.linalg.norm(gaps, axis=-1),
            findings=_of_recording(recording),
        )
    )


def _of_recording(recording: Markers) -> tuple[str, ...]:
    """What its file did not give, and names of several markers, which the set did not ask for."""
    repeated = [name for name, number in Counter(recording.names).items() if number > 1]
    told = f"several markers are called the same, and are not used: {', '.join(map(shortened, repeated[:_MOST_SHOWN]))}"
    return (*recording.remarks, told) if repeated else recording.remarks


_MOST_SHOWN = 10
"""Names of a finding."""


def _chains(chosen: MarkerSet, joints: Joints) -> dict[str, tuple[str, str, str]]:
    """Name -> three joints of every angle that can be compared: the body's hinges, then the set's own."""
    return {f"{name}_flexion": chain for name, chain in _hinges(chosen, joints).items()} | chosen.angles


def _hinges(chosen: MarkerSet, joints: Joints) -> dict[str, tuple[str, str, str]]:
    return {name: chain for name, chain in joints.chains().items() if set(chain) <= set(chosen.joints)}


def _columns(chosen: MarkerSet, chains: Iterable[tuple[str, str, str]]) -> list[tuple[int, int, int]]:
    of = list(chosen.joints).index
    return [(of(before), of(joint), of(behind)) for before, joint, behind in chains]


def _angle(name: str, ours: Array, theirs: Array) -> AngleErrors:
    both = np.isfinite(ours) & np.isfinite(theirs)
    gap = (ours - theirs)[both]
    if not len(gap):
        return AngleErrors(name, 0, *(math.nan,) * 5)
    moving = len(gap) > 2 and ours[both].std() > 0 and theirs[both].std() > 0
    alike = float(np.corrcoef(ours[both], theirs[both])[0, 1]) if moving else math.nan
    rms = float(np.sqrt((gap**2).mean()))
    return AngleErrors(name, len(gap), rms, float(gap.mean()), float(gap.std()), float(np.abs(gap).max()), alike)


def _joint(name: str, gaps_mm: Array, beside_mm: Array) -> JointErrors:
    known = beside_mm[np.isfinite(beside_mm)]
    beside = float(np.median(known)) if len(known) else math.nan
    gap = gaps_mm[np.isfinite(gaps_mm).all(axis=1)]
    if not len(gap):
        return JointErrors(name, 0, math.nan, math.nan, math.nan, beside)
    distance = np.linalg.norm(gap, axis=1)
    removed = np.linalg.norm(gap - gap.mean(axis=0), axis=1)
    p95 = float(np.percentile(distance, 95))
    return JointErrors(name, len(gap), float(distance.mean()), float(removed.mean()), p95, beside)


# A comparison says so when time, direction or place are known worse than this, or when a joint lies farther beside its
# markers than flesh is thick: such errors are as large as what is to be measured.
_VAGUE_S, _VAGUE_DEG, _VAGUE_MM, _BESIDE_MM = 0.01, 2.0, 20.0, 40.0

_APART_MM = 50.0
"""Right tracks lie 12 to 40 mm from their markers, and from those of another moment 46 and more."""

_DECIDING = 0.6
"""Two thirds are right where one arm is wrong."""


def _with_findings(made: MarkerComparison) -> MarkerComparison:
    told, said = made.alignment, list(made.findings)
    if not math.isnan(told.rival_offset_s):
        said.append(
            f"an offset of {told.rival_offset_s:.3f} s fits nearly as well as {told.placement.offset_s:.3f} s, as with "
            "movement that repeats: check it, and give --offset"
        )
    vague = told.offset_sigma_s > _VAGUE_S or told.rotation_sigma_deg > _VAGUE_DEG
    if vague or told.position_sigma_mm > _VAGUE_MM:
        said.append(
            f"the alignment is uncertain by {1000 * told.offset_sigma_s:.0f} ms, {told.rotation_sigma_deg:.1f} deg, "
            f"{told.position_sigma_mm:.0f} mm: positions may be off by that; angles of joints are not"
        )
    if told.placement.median_mm > _APART_MM:
        said.append(
            f"joints and markers lie {told.placement.median_mm:.0f} mm apart in the middle: the track is wrong, or the "
            "alignment is: see whether the curves of the angles agree"
        )
    if told.placement.deciding < _DECIDING:
        share = 100 * told.placement.deciding
        said.append(f"only {share:.0f} % of the joints fit the alignment: the others are elsewhere than their markers")
    far = [f"{joint.name} {joint.beside_mm:.0f} mm" for joint in made.joints if joint.beside_mm > _BESIDE_MM]
    if far:
        said.append(f"lies far beside its markers: {', '.join(far)}: check the marker set")
    missing = len(made.track.frames) - made.n_compared
    if missing:
        said.append(f"{missing} of {len(made.track.frames)} frames have no joint in both")
    return replace(made, findings=tuple(said))
