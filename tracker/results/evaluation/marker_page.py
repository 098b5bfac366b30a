"""What a comparison with markers leaves: a table of every frame, diagrams, a page that needs no other file."""

from __future__ import annotations

import base64
import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tracker.foundation.arrays import Array
from tracker.foundation.files import csv_lines, replacing, write_json, write_whole
from tracker.foundation.pages import filled
from tracker.results.evaluation.marker_comparison import MarkerComparison

_OURS, _MARKERS, _GAP = "#2a6f85", "#1d2733", "#c2571a"
_DOUBT = {"lost": "#d9534f", "doubtful": "#e39b2d", "ambiguous": "#f2c464"}
"""How frames are shaded in which the result itself is not sure."""

_USUAL_DEG = 10.0
"""Differences of angles are drawn at least to so much on both sides: noise does not look like an error."""


def write_comparison(made: MarkerComparison, folder: Path, sources: tuple[str, str, str]) -> tuple[Path, ...]:
    """Writes `comparison.html`, `.csv`, `.json` and `.png`.

    Args:
        made: what was compared.
        folder: where to, it exists.
        sources: result, markers and marker set, as they were given.

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
    """What `write_comparison` writes there: page, table, values and picture."""
    return tuple(folder / f"comparison.{kind}" for kind in ("html", "csv", "json", "png"))


def _rows(made: MarkerComparison) -> list[list[object]]:
    """The table of every frame, its header first; what is unknown is empty."""
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
    """Frames in which the result itself is not sure."""
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
