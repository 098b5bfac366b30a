"""Which known movements a recording shows, from when to when: dynamic time warping in one pass.

Gavrila & Davis, Towards 3-D model-based tracking and recognition of human movement (1995): joint angles, matched by
dynamic time warping. Here all movements are matched at once, one after the other (Ney 1984), so that beginnings and
ends are found too; what is like no known movement stays unknown.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from tracker.recognition._packed import Packed, Piece, packed
from tracker.recognition.library import Library
from tracker.recognition.limb_directions import RATE_HZ, Course
from tracker.recognition.rule import Rule


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
    return {name: known.misfit(gaps, name)[0] * known.limit_deg(name) for name in library.movements}


def _unbroken(course: Course) -> Iterator[Course]:
    """The parts of a course whose frames are known."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], course.known.astype(np.int64), [0]])))
    for first, behind in zip(edges[::2], edges[1::2], strict=True):
        yield course.part(int(first), int(behind))


def _in_part(course: Course, known: Packed, rule: Rule) -> Iterator[Recognized]:
    """Movements in frames without a gap."""
    gaps = known.gaps(course)
    for piece in known.pieces(gaps, rule.evidence_s):
        misfits = {name: known.misfit(gaps[piece[1] : piece[2]], name) for name in dict.fromkeys(known.movements)}
        yield _named(course, known, piece, misfits)


def _named(course: Course, known: Packed, piece: Piece, misfits: dict[str, tuple[float, int]]) -> Recognized:
    """The movement of the smallest angle that fits, and the next best of all."""
    k, first, behind = piece
    own = known.movements[k]
    # a movement that repeats must last as long here as where it is found
    lasting = [one for one, (_, j) in misfits.items() if one == own or behind - first >= known.least_frames(j)]
    angles = {one: misfits[one][0] * known.limit_deg(one) for one in lasting}
    name = min((one for one in lasting if misfits[one][0] < 1), key=lambda one: angles[one], default=own)
    nearest = misfits[name][1] if name != own else k
    second = min((other for other in angles if other != name), key=lambda one: angles[one], default="")
    beside = angles.get(second, np.inf)
    return Recognized(
        movement=name,
        start_s=course.start_s + first / RATE_HZ,
        end_s=course.start_s + (behind - 1) / RATE_HZ,
        angle_deg=angles[name],
        misfit=misfits[name][0],
        second=second if np.isfinite(beside) else "",
        second_deg=beside,
        mirrored=known.mirrored[nearest],
        performance=known.performances[nearest],
    )


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
        second_deg=mean(last.second_deg, one.second_deg) if last.second == one.second else longer.second_deg,
    )
