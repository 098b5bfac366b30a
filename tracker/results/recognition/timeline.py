"""What was recognized in a recording, from its beginning to its end: as a table, and as a strip over time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from tracker.results.recognition.directions import RATE_HZ, Course
from tracker.results.recognition.matching import Recognized

UNKNOWN, LOST = "unknown", "lost"
"""What is told where no known movement fits, and where the person was not found."""

_LEAST_S = 0.2
"""Shorter stretches between two movements are their seam, seconds."""

_HEAD = (
    "person",
    "movement",
    "start_s",
    "end_s",
    "angle_deg",
    "misfit",
    "second",
    "second_deg",
    "mirrored",
    "performance",
    "size",
    "tempo",
)


@dataclass(frozen=True)
class Stretch:
    """A part of a recording."""

    what: str
    """A movement, `UNKNOWN` or `LOST`."""

    start_s: float
    end_s: float
    recognized: Recognized | None = None
    """None where nothing was."""

    @property
    def seconds(self) -> float:
        """How long it is."""
        return self.end_s - self.start_s


def timeline(course: Course, found: Sequence[Recognized]) -> tuple[Stretch, ...]:
    """The whole recording: movements, and between them what is unknown, and where the person is lost."""
    times, known = course.times_s, course.known
    free = np.ones(len(known), dtype=np.bool_)
    for one in found:
        free &= (times < one.start_s - 0.5 / RATE_HZ) | (times > one.end_s + 0.5 / RATE_HZ)
    stretches = [Stretch(one.movement, one.start_s, one.end_s, one) for one in found]
    for what, mask in ((UNKNOWN, free & known), (LOST, free & ~known)):
        edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(np.int64), [0]])))
        for first, behind in zip(edges[::2], edges[1::2], strict=True):
            stretches.append(Stretch(what, float(times[first]), float(times[behind - 1])))
    kept = (one for one in stretches if one.recognized is not None or one.seconds >= _LEAST_S)
    return tuple(sorted(kept, key=lambda one: one.start_s))


def table_rows(persons: Mapping[str, Sequence[Stretch]]) -> Iterator[Sequence[str]]:
    """The rows of `movements.csv`, its head first; values of what was not recognized are empty."""
    yield _HEAD
    for person, stretches in persons.items():
        for one in stretches:
            yield (person, one.what, f"{one.start_s:.2f}", f"{one.end_s:.2f}", *_values(one.recognized))


def _values(one: Recognized | None) -> tuple[str, ...]:
    if one is None:
        return ("",) * 8
    beside = f"{one.second_deg:.2f}" if one.second else ""
    mirrored = "yes" if one.mirrored else "no"
    size, tempo = ("" if np.isnan(value) else f"{value:.2f}" for value in (one.size, one.tempo))
    return f"{one.angle_deg:.2f}", f"{one.misfit:.3f}", one.second, beside, mirrored, one.performance, size, tempo


def strip(title: str, persons: Mapping[str, Sequence[Stretch]]) -> Figure:
    """Movements over time, a line for each person; grey is unknown, hatched lost.

    Args:
        title: of the picture.
        persons: name -> what was recognized.
    """
    figure = Figure(figsize=(11.0, 1.6 + 0.75 * len(persons)), layout="constrained")
    axes = figure.subplots()
    names = list(dict.fromkeys(one.what for line in persons.values() for one in line if one.recognized is not None))
    colours = {name: colormaps["tab20"](k % 20) for k, name in enumerate(names)}
    for row, line in enumerate(persons.values()):
        for one in line:
            span = one.seconds + 1 / RATE_HZ
            axes.add_patch(_box(one, row, span, colours))
            if one.recognized is not None:
                label = f"{one.what.replace('_', ' ')}\n{one.recognized.angle_deg:.0f}°"
                # what is too narrow for its name has it upright
                upright = span < 0.012 * len(one.what) * _length(persons)
                axes.text(
                    one.start_s + span / 2,
                    row,
                    label,
                    ha="center",
                    va="center",
                    fontsize=6.5 if upright else 8,
                    rotation=90 if upright else 0,
                )
    axes.set_yticks(range(len(persons)), list(persons))
    axes.autoscale_view()
    axes.set_ylim(len(persons) - 0.5, -0.5)
    axes.set_xlabel("time, s")
    axes.set_title(f"{title}: movements, and how far the limbs are from the known ones (grey: unknown)", fontsize=10)
    return figure


def _box(one: Stretch, row: int, span: float, colours: Mapping[str, Any]) -> Rectangle:
    """What is drawn of a stretch in a line."""
    colour = colours[one.what] if one.recognized is not None else "white" if one.what == LOST else "0.88"
    hatch = "///" if one.what == LOST else None
    return Rectangle((one.start_s, row - 0.36), span, 0.72, facecolor=colour, edgecolor="0.4", hatch=hatch)


def _length(persons: Mapping[str, Sequence[Stretch]]) -> float:
    ends = [one.end_s for line in persons.values() for one in line]
    starts = [one.start_s for line in persons.values() for one in line]
    return max(max(ends, default=1.0) - min(starts, default=0.0), 0.1)
