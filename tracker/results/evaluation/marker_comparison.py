"""A result against a marker system: offset of its clock and world, and differences of angles and joints."""

from __future__ import annotations

import base64
import io
import math
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tracker.bodies.body.sections import Joints
from tracker.foundation.arrays import Array
from tracker.foundation.errors import shortened
from tracker.foundation.files import csv_lines, replacing, write_json, write_whole
from tracker.foundation.pages import filled
from tracker.results.evaluation.joints import TrackedJoints, tracked_joints
from tracker.results.evaluation.marker_fit import Alignment, align
from tracker.results.evaluation.marker_set import MarkerSet, check_marker_set, joints_of, load_marker_set
from tracker.results.evaluation.time_correlation import Clocked, flexions
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
    """Distance of its centre from the middle of its markers, constant in the axes of the limb."""


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
    """Warnings."""

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
        marker_set: markers of each joint.
        person: who wore the markers; None if there is only one.
        offset_s: marker time minus video time, if known within a tenth of a second; None to find it.

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
    """Remarks of its file, and unused names of several markers."""
    repeated = [name for name, number in Counter(recording.names).items() if number > 1]
    told = f"several markers have the same name, and are not used: {', '.join(map(shortened, repeated[:_MOST_SHOWN]))}"
    return (*recording.remarks, told) if repeated else recording.remarks


_MOST_SHOWN = 10
"""Largest number of names in a finding."""


def _chains(chosen: MarkerSet, joints: Joints) -> dict[str, tuple[str, str, str]]:
    """Name -> three joints of every comparable angle: the body's hinges, then the set's own."""
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


# A comparison warns if time, direction or position are known worse than this, or if a joint lies farther beside its
# markers than flesh is thick: such errors are as large as those to be measured.
_VAGUE_S, _VAGUE_DEG, _VAGUE_MM, _BESIDE_MM = 0.01, 2.0, 20.0, 40.0

_APART_MM = 50.0
"""Right tracks lie 12 to 40 mm from their markers, and 46 mm or more from those of another moment."""

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
            f"joints and markers lie {told.placement.median_mm:.0f} mm apart (median): the track is wrong, or the "
            "alignment is: see whether the curves of the angles agree"
        )
    if told.placement.deciding < _DECIDING:
        share = 100 * told.placement.deciding
        said.append(f"only {share:.0f} % of the joints fit the alignment: the others are away from their markers")
    far = [f"{joint.name} {joint.beside_mm:.0f} mm" for joint in made.joints if joint.beside_mm > _BESIDE_MM]
    if far:
        said.append(f"lies far beside its markers: {', '.join(far)}: check the marker set")
    missing = len(made.track.frames) - made.n_compared
    if missing:
        said.append(f"{missing} of {len(made.track.frames)} frames have no joint in both")
    return replace(made, findings=tuple(said))


# Files of a comparison with markers: a table of every frame, diagrams, a self-contained page.

_OURS, _MARKERS, _GAP = "#2a6f85", "#1d2733", "#c2571a"
_DOUBT = {"lost": "#d9534f", "doubtful": "#e39b2d", "ambiguous": "#f2c464"}
"""Shade of frames in which the result itself is not sure."""

_USUAL_DEG = 10.0
"""Least range of differences of angles in a diagram: noise does not look like an error."""


def write_comparison(made: MarkerComparison, folder: Path, sources: tuple[str, str, str]) -> tuple[Path, ...]:
    """Writes `comparison.html`, `.csv`, `.json` and `.png`.

    Args:
        made: the comparison.
        folder: place of the files; it exists.
        sources: paths of result, markers and marker set.

    Returns:
        The files.
    """
    figure = angle_figure(made)
    page, table, values, picture = files = comparison_files(folder)
    write_whole(table, csv_lines(_rows(made)))
    write_json(values, made.as_dict() | dict(zip(("result", "markers", "marker_set"), sources, strict=True)))
    with replacing(picture) as unfinished:
        figure.savefig(unfinished, dpi=110)
    content = {"made": made, "sources": sources, "angles": _uri(figure), "distances": _uri(distance_figure(made))}
    write_whole(page, filled("tracker.results.evaluation", "_pages/comparison.html", content))
    return files


def comparison_files(folder: Path) -> tuple[Path, ...]:
    """Files of `write_comparison` in a folder: page, table, values and picture."""
    return tuple(folder / f"comparison.{kind}" for kind in ("html", "csv", "json", "png"))


def _rows(made: MarkerComparison) -> list[list[object]]:
    """The table of every frame, its header first; unknown values are empty."""
    angles = [angle.name for angle in made.angles]
    head: list[object] = ["frame", "time_s", "marker_time_s", "status"]
    head += [column for name in angles for column in (f"{name}_deg", f"{name}_markers_deg", f"{name}_difference_deg")]
    head += [f"{joint.name}_distance_mm" for joint in made.joints]
    rows = [head]
    times_s, offset_s = made.track.motion.times_s, made.alignment.placement.offset_s
    for t, frame in enumerate(made.track.frames.tolist()):
        ours, theirs = made.ours_deg[t], made.theirs_deg[t]
        values = np.stack([ours, theirs, ours - theirs], axis=1).ravel()
        row: list[object] = [frame, f"{times_s[t]:.6f}", f"{times_s[t] + offset_s:.6f}", made.track.statuses[t]]
        row += ["" if np.isnan(value) else f"{value:.3f}" for value in (*values, *made.distances_mm[t])]
        rows.append(row)
    return rows


def angle_figure(made: MarkerComparison) -> Figure:
    """Every angle against time, ours and the markers' (the paper's figures 6 and 7), and below it their difference."""
    n = max(len(made.angles), 1)
    figure = Figure(figsize=(9.5, 2.9 * n), layout="constrained")
    heights = [3, 1] * n
    axes: Any = figure.subplots(2 * n, 1, sharex=True, squeeze=False, height_ratios=heights)[:, 0]
    for k, angle in enumerate(made.angles):
        above, below = axes[2 * k : 2 * k + 2]
        times_s = made.track.motion.times_s
        above.plot(times_s, made.ours_deg[:, k], "-", color=_OURS, lw=1.6, label="ours")
        above.plot(times_s, made.theirs_deg[:, k], ":", color=_MARKERS, lw=1.8, label="markers")
        told = f"{angle.rms_deg:.1f} deg RMS, {angle.rms_offset_removed_deg:.1f} with the offset removed"
        above.set_title(f"{angle.name.replace('_', ' ')}: {told}", fontsize=10, loc="left")
        above.set_ylabel("degrees")
        above.legend(loc="upper right", fontsize=8, frameon=False, ncols=2)
        gap = made.ours_deg[:, k] - made.theirs_deg[:, k]
        below.axhline(0, color="#999999", lw=0.8)
        below.plot(times_s, gap, color=_GAP, lw=1.2)
        widest = float(np.nanmax(np.abs(gap))) if np.isfinite(gap).any() else 0.0
        below.set_ylim(*(1.1 * max(_USUAL_DEG, widest) * np.array([-1.0, 1.0])))
        below.set_ylabel("ours -\nmarkers", fontsize=8)
        _shaded((above, below), made)
    axes[-1].set_xlabel("time of the video, s")
    return figure


def distance_figure(made: MarkerComparison) -> Figure:
    """Distance of every joint from the middle of its markers against time."""
    figure = Figure(figsize=(9.5, 3.4), layout="constrained")
    axis = figure.subplots()
    for k, joint in enumerate(made.joints):
        style = "--" if joint.name.startswith("right") else "-"
        label = joint.name.replace("_", " ")
        axis.plot(made.track.motion.times_s, made.distances_mm[:, k], style, lw=1.2, label=label)
    axis.set_ylabel("joint to markers, mm")
    axis.set_xlabel("time of the video, s")
    axis.set_ylim(bottom=0)
    axis.legend(loc="upper left", bbox_to_anchor=(1.01, 1), fontsize=8, frameon=False)
    _shaded((axis,), made)
    return figure


def _shaded(axes: tuple[Axes, ...], made: MarkerComparison) -> None:
    """Shades the frames in which the result itself is not sure."""
    times_s = made.track.motion.times_s
    half: Array = np.gradient(times_s) / 2
    for axis in axes:
        axis.grid(alpha=0.3)
        for t, status in enumerate(made.track.statuses):
            if status in _DOUBT:
                axis.axvspan(times_s[t] - half[t], times_s[t] + half[t], color=_DOUBT[status], alpha=0.25, lw=0)


def _uri(figure: Figure) -> str:
    buffer = io.BytesIO()
    write: Callable[..., None] = figure.savefig
    write(buffer, format="png", dpi=95)
    return f"data:image/png;base64,{base64.b64encode(buffer.getvalue()).decode()}"
