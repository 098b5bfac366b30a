"""The scores of recordings as one picture: a row for each person, a column for each body and kind of evidence."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from benchmarks.scores import Score, by_person, newest
from tracker.foundation.errors import ConfigError
from tracker.foundation.files import replacing

# Millimetres with offsets removed: white and the darkest blue.
_RANGE_MM = 4.0, 34.0
_SILENT, _FLAGGED = "#c1121f", "#e09f3e"
# Settings that the column's words stand for.
_OF_KEYPOINTS = "evidence={", "initialization={"
_Cells = dict[tuple[str, str], list[Score]]


def draw(scores: Sequence[Score], path: Path) -> None:
    """Writes the picture as PNG; rows of the same cell are starts, of which the worst is shown.

    Of runs made again with other code the newest count.

    Raises:
        ConfigError: there are no scores.
    """
    cells: _Cells = {}
    scores = newest(scores)
    for (recording, person), runs in by_person(scores).items():
        for one in runs:
            cells.setdefault((f"{recording}, {person}" if person else recording, _column(one)), []).append(one)
    if not cells:
        raise ConfigError("no scores to draw: run `benchmark.py recordings` first, or name the folder it wrote to")
    rows, columns = sorted({row for row, _ in cells}), sorted({column for _, column in cells}, key=_place)
    figure = Figure(figsize=(2.6 + 2.0 * len(columns), 1.4 + 0.5 * len(rows)), layout="constrained")
    axes = figure.add_subplot()
    for (row, column), group in cells.items():
        _draw_cell(axes, columns.index(column), rows.index(row), group)
    axes.set(xlim=(-0.5, len(columns) - 0.5), ylim=(len(rows) - 0.5, -0.5))
    axes.set_xticks(range(len(columns)), columns, fontsize=9)
    axes.set_yticks(range(len(rows)), rows, fontsize=9)
    axes.tick_params(length=0, labeltop=True, labelbottom=False)
    axes.spines[:].set_visible(False)
    commits = ", ".join(sorted({one.commit for one in scores}))
    figure.supxlabel(
        "joints, mm: mean distance (with constant offsets removed), worst of the starts; below: frames of all starts.\n"
        "red: a joint is more than 150 mm off and nothing says so; amber: off and flagged; false: flagged, nothing off."
        f" Commit {commits}",
        fontsize=8,
        x=0.02,
        ha="left",
    )
    with replacing(path) as unfinished:
        figure.savefig(unfinished, dpi=110)


def _column(score: Score) -> str:
    evidence = "plates" if score.plates else "no plates"
    if "keypoints" in score.settings:
        evidence = f"keypoints, {evidence}"
    others = [word for word in score.settings.split() if not word.startswith(_OF_KEYPOINTS)]
    return "\n".join([f"{score.model}, {'acquired' if score.acquired else 'stature told'}", evidence, *others])


def _place(column: str) -> tuple[bool, bool, bool, bool, str]:
    """Where among the columns; by their words where nothing else tells."""
    return "human" not in column, "keypoints" in column, "no plates" in column, "acquired" in column, column


def worst_of(group: Sequence[Score]) -> tuple[str, str]:
    """What a cell says of the starts of one person: the worst errors, and frames of all starts."""
    if any(one.failed for one in group):
        return "failed", ""
    starts = f"  x{len(group)}" if len(group) > 1 else ""
    if any(one.is_lost_throughout for one in group):
        return f"lost{starts}", _said(group)
    mean_mm, removed_mm = max(one.mean_mm for one in group), max(one.removed_mm for one in group)
    return f"{mean_mm:.0f} ({removed_mm:.0f}){starts}", _said(group)


def _said(group: Sequence[Score]) -> str:
    """What the run said of its frames, in a few words."""
    names = "n_frames", "limb_off", "limb_off_flagged", "lost", "false_flags"
    n_frames, off, flagged, lost, false = (sum(getattr(one, name) for one in group) for name in names)
    words = [f"{off} of {n_frames} off, {flagged} flagged"] if off else []
    words = words or ([f"none of {n_frames - lost} off"] if n_frames > lost else [])
    words += [f"{lost} lost"] if lost else []
    words += [f"{false} false"] if false else []
    return "; ".join(words)


def _draw_cell(axes: Axes, x: int, y: int, group: Sequence[Score]) -> None:
    errors, frames = worst_of(group)
    if not frames:
        axes.text(x, y, errors, ha="center", va="center", color=_SILENT, fontsize=9)
        return
    worst_mm = max(_RANGE_MM[1] if one.is_lost_throughout else one.removed_mm for one in group)
    share = float(np.clip((worst_mm - _RANGE_MM[0]) / (_RANGE_MM[1] - _RANGE_MM[0]), 0, 1))
    colour = (1 - 0.75 * share, 1 - 0.45 * share, 1 - 0.15 * share)
    off, flagged = sum(one.limb_off for one in group), sum(one.limb_off_flagged for one in group)
    edge = _SILENT if off > flagged else _FLAGGED if off else "white"
    axes.add_patch(Rectangle((x - 0.48, y - 0.46), 0.96, 0.92, facecolor=colour, edgecolor=edge, linewidth=1.6))
    axes.text(x, y - 0.14, errors, ha="center", va="center", fontsize=9)
    axes.text(x, y + 0.2, frames, ha="center", va="center", fontsize=7)
