"""A library as kernels take it: all performances behind each other, and the variants that somebody else might show."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tracker.arrays import Array32, Integers, Mask, frozen
from tracker.errors import ConfigError
from tracker.kernels.movements.warping import direction_gaps, warp_sequence
from tracker.recognition.library import Library, Movement
from tracker.recognition.limb_directions import FEATURES, RATE_HZ, Course
from tracker.recognition.rule import Rule
from tracker.recognition.segment_directions import Features

Piece = tuple[int, int, int]
"""Number of a performance, the first frame that it explains, and the one behind the last."""


@dataclass(frozen=True)
class Packed:
    """All performances behind each other; K of them, N frames."""

    directions: Array32
    """(N, L, 3) of all frames."""

    first: Integers
    """(K + 1,) where each performance begins."""

    repeats: Mask
    """(K,)."""

    slack: Integers
    """(K,) frames; see `warp_sequence`."""

    limits: Array32
    """(N,) largest angle to each frame's movement, degrees."""

    movements: tuple[str, ...]
    """(K,) names."""

    performances: tuple[str, ...]
    """(K,) names."""

    mirrored: tuple[bool, ...]
    """(K,)."""

    def limit_deg(self, movement: str) -> float:
        """Largest angle to a movement."""
        return float(self.limits[self.first[self.movements.index(movement)]])

    def least_frames(self, k: int) -> int:
        """Frames that a performance has to last at least."""
        return int(self.slack[k]) if self.repeats[k] else 1

    def gaps(self, course: Course) -> Array32:
        """(T, N) angles of every frame to every known one, over the limit of its movement."""
        gaps = np.zeros((len(course.known), len(self.directions)), dtype=np.float32)
        direction_gaps(frozen(course.directions, np.float32), self.directions, gaps)
        over: Array32 = gaps / self.limits
        return over

    def pieces(self, gaps: Array32, evidence_s: float) -> list[Piece]:
        """What explains (T, N) gaps best, in order of time; frames in no piece are better left unknown."""
        rules = self.first, self.repeats, self.slack
        return _path(gaps, rules, 1.0, evidence_s * RATE_HZ)[1]

    def misfit(self, gaps: Array32, movement: str) -> tuple[float, int]:
        """Mean of (T, N) gaps to one movement that has to explain all frames, and its longest performance there.

        Infinite, and -1, if it cannot, because they are too few or too many.
        """
        chosen = [k for k, name in enumerate(self.movements) if name == movement]
        columns = np.concatenate([np.arange(self.first[k], self.first[k + 1]) for k in chosen])
        first = frozen(np.cumsum([0, *(self.first[k + 1] - self.first[k] for k in chosen)]), np.int64)
        # what repeats need not go on for long where nothing else is to explain the frames
        slack = frozen(np.where(self.repeats, 0, self.slack)[chosen], np.int64)
        rules = first, frozen(self.repeats[chosen], np.bool_), slack
        cost, pieces = _path(np.ascontiguousarray(gaps[:, columns]), rules, np.inf, 0.0)
        longest = max(pieces, key=lambda piece: piece[2] - piece[1])[0] if np.isfinite(cost) else -1
        return cost / len(gaps), chosen[longest] if longest >= 0 else -1


def _path(
    gaps: Array32, rules: tuple[Integers, Mask, Integers], unknown: float, entry: float
) -> tuple[float, list[Piece]]:
    """The cost of the best path, and its pieces in order of time."""
    found = np.zeros((len(gaps) + 1, 2), dtype=np.int64)
    cost: float = warp_sequence(gaps, *rules, unknown, entry, found)
    pieces, behind = [], len(gaps)
    while np.isfinite(cost) and behind > 0:
        k, first = (int(value) for value in found[behind])
        if k >= 0:
            pieces.append((k, first, behind))
        behind = first
    return cost, pieces[::-1]


def packed(library: Library, rule: Rule, features: Features) -> Packed:
    """Puts a library's performances behind each other, with their variants.

    Raises:
        ConfigError: it is of another body than that with these features.
    """
    _check_body(library, features)
    tables: list[Array32] = []
    names: list[tuple[str, str, bool]] = []
    limits, slack = [], []
    for name, movement in library.movements.items():
        limit, share = _limit_deg(movement, rule), rule.least_round if movement.description.repeats else rule.margin
        for key, directions in movement.performances.items():
            for table, mirrored in _variants(directions, movement.description.repeats, rule, features):
                tables.append(table)
                names.append((name, key, mirrored))
                limits.append(np.full(len(table), limit))
                slack.append(int(share * len(table)))
    movements, performances, mirrored_ones = zip(*names, strict=True)
    return Packed(
        frozen(np.concatenate(tables), np.float32),
        frozen(np.cumsum([0, *(len(table) for table in tables)]), np.int64),
        frozen([library.movements[name].description.repeats for name in movements], np.bool_),
        frozen(slack, np.int64),
        frozen(np.concatenate(limits), np.float32),
        movements,
        performances,
        mirrored_ones,
    )


def _check_body(library: Library, features: Features) -> None:
    if library.features == features.names:
        return
    alone, other = set(library.features) - set(features.names), set(features.names) - set(library.features)
    told = "; ".join(
        f"{', '.join(sorted(names)[:3])}{', ...' if len(names) > 3 else ''} only of the {whose}"
        for names, whose in ((alone, "movements"), (other, "result"))
        if names
    )
    person = (
        "a person's landmarks are called left_shoulder, left_elbow, left_wrist, left_hip, left_knee, left_ankle and so "
        "on the right, in the model's file or its [keypoints]; "
        if FEATURES in (library.features, features.names)
        else ""
    )
    raise ConfigError(
        f"the movements are of another body ({told or 'in another order'}): {person}bodytrack recognize --add makes a "
        "--library of this one"
    )


def _variants(directions: Array32, repeats: bool, rule: Rule, features: Features) -> list[tuple[Array32, bool]]:
    """A performance as it is and mirrored; one that repeats with limbs that swing less and more."""
    known = np.ones(len(directions), dtype=np.bool_)
    found = []
    for size in rule.sizes if repeats else (1.0,):
        course = _swung(Course(0.0, directions, known, features), size)
        found.append((course.directions, False))
        if features.partners:
            found.append((course.mirrored().directions, True))
    return found


def _swung(course: Course, size: float) -> Course:
    """The movement with limbs that swing so many times as far about their mean direction."""
    usual = course.directions.mean(axis=0)
    swung = usual + np.float32(size) * (course.directions - usual)
    lengths = np.maximum(np.linalg.norm(swung, axis=-1, keepdims=True), 1e-6)
    return replace(course, directions=frozen(swung / lengths, np.float32))


def _limit_deg(movement: Movement, rule: Rule) -> float:
    """Largest angle that counts as the movement, degrees."""
    extents = []
    for directions in movement.performances.values():
        gaps, same = np.zeros((len(directions), len(directions)), dtype=np.float32), frozen(directions, np.float32)
        direction_gaps(same, same, gaps)
        extents.append(float(gaps.mean(axis=0).min()))
    return max(rule.limit * float(np.mean(extents)), rule.least_limit_deg)
