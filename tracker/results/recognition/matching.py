"""Which known movements a recording shows, from when to when: dynamic time warping in one pass.

Gavrila & Davis, Towards 3-D model-based tracking and recognition of human movement (1995): joint angles, matched by
dynamic time warping. Here all movements are matched at once, one after the other (Ney 1984), so that beginnings and
ends are found too; what is like no known movement stays unknown.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from tracker.results.recognition._packed import Fit, Packed, Variant, angles_between, packed
from tracker.results.recognition.directions import RATE_HZ, Course
from tracker.results.recognition.library import Library
from tracker.results.recognition.rule import Rule


@dataclass(frozen=True)
class Recognized:
    """A movement in a recording."""

    movement: str
    start_s: float
    end_s: float
    angle_deg: float
    """Root mean square angle of the limbs to those of the known movement, averaged over its time."""

    misfit: float
    """The angle over the largest that counts as this movement: 0 where it is the same, 1 where it is unknown."""

    second: str
    """The movement that is next best; empty if no other one fits its length."""

    second_deg: float
    """The angle to that one over the same frames, degrees; infinite if none fits."""

    mirrored: bool
    """Whether it is the known performance with left and right exchanged."""

    performance: str
    """The known performance it is nearest to."""

    size: float
    """How far apart its two most different poses are, times those of that performance; NaN of what does not move."""

    tempo: float
    """How many times as fast as that performance; NaN of what does not move."""


def recognize(course: Course, library: Library, rule: Rule = Rule()) -> tuple[Recognized, ...]:  # noqa: B008
    """Finds known movements.

    A stretch is found by how much of a movement's own extent is left, so that large and small movements have equal
    chances against the unknown; its name is that of the movement of the smallest angle, of those that fit.

    Args:
        course: how one person moved.
        library: the movements that are known.
        rule: when something counts.

    Returns:
        What was found, in order of time; repetitions of a repeating movement are one.

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
    """The parts of a course whose frames are known."""
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
    """The movement of the smallest angle that fits, and the next best of all; None where nobody moves as far as that.

    Args:
        course: a stretch.
        known: the movements that are known.
        own: the one that the stretch was found by.
        fits: how well every movement explains all of it.
    """
    shown = {name: (fit, fit.piece, known.variants[fit.piece.k]) for name, fit in fits.items() if fit.piece is not None}
    # a movement that repeats must last as long here as where it is found
    lasting = {name: one for name, one in shown.items() if name == own or len(course.known) >= one[2].least_frames}
    order = sorted(lasting, key=lambda name: lasting[name][0].angle_deg)
    fitting = [name for name in order if lasting[name][0].misfit < 1] or [own]
    least, _, loose = lasting[fitting[0]]
    # a movement that is told by more says more, where it is as like by what both are told by
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
        )
    return None


def _size(course: Course, variant: Variant) -> float:
    """How far apart the most different poses are, times those of a known performance; NaN of one that does not move."""
    if variant.reach_deg == 0:
        return np.nan
    return float(angles_between(course.directions[:, variant.counted]).max()) / variant.reach_deg


def _joined(found: list[Recognized], library: Library) -> Iterator[Recognized]:
    """Repetitions that follow one another at once as one, where the movement repeats."""
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
    """Two repetitions as one: angles averaged over time, names those of the longer one.

    The next best movement's angle is the longer one's, too, where it was not the same movement in both.
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
        second_deg=mean(last.second_deg, one.second_deg) if last.second == one.second else longer.second_deg,
    )
