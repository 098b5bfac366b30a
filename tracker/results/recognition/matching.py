"""Finds known movements in a recording, with begin and end: dynamic time warping in one pass.

Gavrila & Davis, Towards 3-D model-based tracking and recognition of human movement (1995): joint angles, matched by
dynamic time warping. Here all movements are matched at once, one after the other (Ney 1984), so that beginnings and
ends are found too; frames like no known movement stay unknown.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from tracker.results.recognition import RATE_HZ, Course
from tracker.results.recognition._packed import Fit, Packed, Rule, Variant, angles_between, packed
from tracker.results.recognition.library import Library


@dataclass(frozen=True)
class Recognized:
    """A known movement in a recording."""

    movement: str
    start_s: float
    end_s: float
    angle_deg: float
    """Root mean square angle of the limbs to those of the known movement, averaged over its time."""

    misfit: float
    """The angle over the largest that counts as this movement: 0 means equal, 1 unknown."""

    second: str
    """The next best movement; empty if no other one fits its length."""

    second_deg: float
    """The angle to that one over the same frames, degrees; infinite if none fits."""

    mirrored: bool
    """Whether it is the known performance with left and right exchanged."""

    performance: str
    """The nearest known performance."""

    size: float
    """Angle between its two most different poses, times that of the performance; NaN without movement."""

    tempo: float
    """Speed, times that of the performance; NaN without movement."""

    speed: float = np.nan
    """How fast the hips go over the floor, leg lengths a second; NaN where that is not known."""


def recognize(course: Course, library: Library, rule: Rule = Rule()) -> tuple[Recognized, ...]:  # noqa: B008
    """Finds known movements.

    A stretch is found by its share of a movement's own extent, so that large and small movements have equal chances
    against the unknown. Its name is that of the fitting movement with the smallest angle.

    Args:
        course: the movement of one person.
        library: the known movements.
        rule: limits of recognition.

    Returns:
        Known movements in order of time; repetitions of a repeating movement are one.

    Raises:
        ConfigError: the library is of another body.
    """
    known = packed(library, rule, course.features)
    found = [one for part in _unbroken(course) for one in _in_part(part, known, rule)]
    return tuple(_joined(found, library))


def angles_deg(course: Course, library: Library, rule: Rule = Rule()) -> dict[str, float]:  # noqa: B008
    """Angle of all known frames of a course to each movement, by its name; infinite if its length rules it out.

    Raises:
        ConfigError: the library is of another body.
    """
    known = packed(library, rule, course.features)
    gaps = known.gaps(course.part_known())
    return {name: known.fit(gaps, name).angle_deg for name in library.movements}


def _unbroken(course: Course) -> Iterator[Course]:
    """The parts of a course with known frames."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], course.known.astype(np.int64), [0]])))
    for first, behind in zip(edges[::2], edges[1::2], strict=True):
        yield course.part(int(first), int(behind))


def _in_part(course: Course, known: Packed, rule: Rule) -> Iterator[Recognized]:
    """Movements in frames without a gap."""
    gaps = known.gaps(course)
    for piece in known.pieces(gaps, rule.evidence_s):
        part = gaps[piece.first : piece.behind]
        fits = {name: known.fit(part, name) for name in known.movements}
        one = _named(course.part(piece.first, piece.behind), known, known.variants[piece.k].movement, fits)
        if one is not None:
            yield one


def _named(course: Course, known: Packed, own: str, fits: dict[str, Fit]) -> Recognized | None:
    """The fitting movement of the smallest angle, and the next best of all; None if none moves as far as the person.

    Args:
        course: a stretch.
        known: the known movements.
        own: the movement that found the stretch.
        fits: how well every movement explains all of it.
    """
    shown = {name: (fit, fit.piece, known.variants[fit.piece.k]) for name, fit in fits.items() if fit.piece is not None}
    # a movement that repeats must last as long here as where it is found
    lasting = {name: one for name, one in shown.items() if name == own or len(course.known) >= one[2].least_frames}
    order = sorted(lasting, key=lambda name: lasting[name][0].angle_deg)
    fitting = [name for name in order if lasting[name][0].misfit < 1] or [own]
    if course.speed > _GOES:
        fitting = [name for name in fitting if not known.library.movements[name].description.stays]
    if not fitting:
        return None
    least, _, loose = lasting[fitting[0]]
    # a movement with more decisive directions says more, if it is as near by the common ones
    fuller = [
        name
        for name in fitting
        if len(lasting[name][2].counted) > len(loose.counted)
        and known.angle_by(course, name, loose.counted) <= least.angle_deg
    ]
    for name in [*fuller, *fitting]:
        fit, piece, variant = lasting[name]
        size = _size(course, variant)
        # a limb that points a little elsewhere, and does not move, is no small movement
        if size < variant.least_size:
            continue
        second = next((other for other in order if other != name), "")
        return Recognized(
            movement=name,
            start_s=course.start_s,
            end_s=course.start_s + (len(course.known) - 1) / RATE_HZ,
            angle_deg=fit.angle_deg,
            misfit=fit.misfit,
            second=second,
            second_deg=fits[second].angle_deg if second else np.inf,
            mirrored=variant.mirrored,
            performance=variant.performance,
            size=size,
            tempo=piece.way * variant.tempo / (piece.behind - piece.first) if np.isfinite(size) else np.nan,
            speed=course.speed,
        )
    return None


_GOES = 0.3
"""Who is faster goes over the floor, leg lengths a second: walks of CMU's persons and of slow simulated ones go 0.69 to
2.4, who walks on the spot goes 0."""


def _size(course: Course, variant: Variant) -> float:
    """Angle between the most different poses, times that of a known performance; NaN without movement."""
    if variant.reach_deg == 0:
        return np.nan
    return float(angles_between(course.directions[:, variant.counted], variant.weights).max()) / variant.reach_deg


def _joined(found: list[Recognized], library: Library) -> Iterator[Recognized]:
    """Joins repetitions that follow one another at once, if the movement repeats."""
    last: Recognized | None = None
    for one in found:
        if last is not None and _goes_on(last, one) and library.movements[one.movement].description.repeats:
            last = _together(last, one)
            continue
        if last is not None:
            yield last
        last = one
    if last is not None:
        yield last


def _goes_on(last: Recognized, one: Recognized) -> bool:
    return last.movement == one.movement and one.start_s - last.end_s < 1.5 / RATE_HZ


def _together(last: Recognized, one: Recognized) -> Recognized:
    """Two repetitions as one: angles averaged over time, names of the longer one.

    The next best movement's angle is the longer one's, too, if the movements differ.
    """
    durations = np.array([last.end_s - last.start_s, one.end_s - one.start_s]) + 1 / RATE_HZ

    def mean(first: float, second: float) -> float:
        return float(np.average([first, second], weights=durations))

    longer = last if durations[0] >= durations[1] else one
    return replace(
        longer,
        start_s=last.start_s,
        end_s=one.end_s,
        angle_deg=mean(last.angle_deg, one.angle_deg),
        misfit=mean(last.misfit, one.misfit),
        size=mean(last.size, one.size),
        tempo=mean(last.tempo, one.tempo),
        speed=mean(last.speed, one.speed),
        second_deg=mean(last.second_deg, one.second_deg) if last.second == one.second else longer.second_deg,
    )


UNKNOWN, LOST = "unknown", "lost"
"""Names of stretches where no known movement fits, and where the person is lost."""

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
    "speed",
)


@dataclass(frozen=True)
class Stretch:
    """A part of a recording."""

    what: str
    """A movement, `UNKNOWN` or `LOST`."""

    start_s: float
    end_s: float
    recognized: Recognized | None = None
    """None if no movement is known."""

    @property
    def seconds(self) -> float:
        """Duration, seconds."""
        return self.end_s - self.start_s


def timeline(course: Course, found: Sequence[Recognized]) -> tuple[Stretch, ...]:
    """The whole recording: movements, and between them stretches where the movement is unknown or the person lost."""
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
    """The rows of `movements.csv`, its head first; values of unknown stretches are empty."""
    yield _HEAD
    for person, stretches in persons.items():
        for one in stretches:
            yield (person, one.what, f"{one.start_s:.2f}", f"{one.end_s:.2f}", *_values(one.recognized))


def _values(one: Recognized | None) -> tuple[str, ...]:
    if one is None:
        return ("",) * 9
    beside = f"{one.second_deg:.2f}" if one.second else ""
    mirrored = "yes" if one.mirrored else "no"
    done = ("" if np.isnan(value) else f"{value:.2f}" for value in (one.size, one.tempo, one.speed))
    return f"{one.angle_deg:.2f}", f"{one.misfit:.3f}", one.second, beside, mirrored, one.performance, *done


def strip(title: str, persons: Mapping[str, Sequence[Stretch]]) -> Figure:
    """Movements over time, a line for each person; grey is unknown, hatched lost.

    Args:
        title: of the picture.
        persons: name -> known movements.
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
                # a stretch too narrow for its name has it upright
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
    axes.set_title(f"{title}: movements, and the angle of the limbs to the known ones (grey: unknown)", fontsize=10)
    return figure


def _box(one: Stretch, row: int, span: float, colours: Mapping[str, Any]) -> Rectangle:
    """Drawing of a stretch in a line."""
    colour = colours[one.what] if one.recognized is not None else "white" if one.what == LOST else "0.88"
    hatch = "///" if one.what == LOST else None
    return Rectangle((one.start_s, row - 0.36), span, 0.72, facecolor=colour, edgecolor="0.4", hatch=hatch)


def _length(persons: Mapping[str, Sequence[Stretch]]) -> float:
    ends = [one.end_s for line in persons.values() for one in line]
    starts = [one.start_s for line in persons.values() for one in line]
    return max(max(ends, default=1.0) - min(starts, default=0.0), 0.1)
