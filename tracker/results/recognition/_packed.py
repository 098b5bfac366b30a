"""A library as kernels take it: all variants of its performances behind each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from tracker.foundation.arrays import Array32, Integers, Mask, frozen
from tracker.foundation.errors import ConfigError
from tracker.kernels.movements import direction_gaps, warp_sequence
from tracker.results.recognition._variants import Variant, variants
from tracker.results.recognition.library import Library
from tracker.results.recognition.limb_directions import FEATURES, RATE_HZ, Course
from tracker.results.recognition.rule import Rule
from tracker.results.recognition.segment_directions import Features


class Piece(NamedTuple):
    """A stretch of a recording as a variant of a performance."""

    k: int
    """Number of the variant."""

    first: int
    behind: int
    """The first frame, and the one behind the last."""

    way: int
    """How many frames of the variant it passes."""


class Fit(NamedTuple):
    """How well one movement explains all frames."""

    misfit: float = np.inf
    """The angle over the largest that counts; infinite where the movement cannot explain them."""

    angle_deg: float = np.inf
    piece: Piece | None = None
    """The longest of those that explain the frames; None where nothing does."""


@dataclass(frozen=True)
class Packed:
    """All variants behind each other; K of them, N frames."""

    variants: tuple[Variant, ...]
    """(K,)."""

    first: Integers
    """(K + 1,) where each variant begins."""

    repeats: Mask
    """(K,)."""

    slack: Integers
    """(K,) frames; see `warp_sequence`."""

    library: Library
    rule: Rule

    @property
    def movements(self) -> tuple[str, ...]:
        """All that are known."""
        return tuple(dict.fromkeys(one.movement for one in self.variants))

    def gaps(self, course: Course) -> Array32:
        """(T, N) angles of every frame to every known one, over the limit of its variant."""
        over = np.zeros((len(course.known), int(self.first[-1])), dtype=np.float32)
        measured, last = np.zeros((0, 0), dtype=np.float32), None
        for k, one in enumerate(self.variants):
            if one.directions is not last:
                last, measured = one.directions, np.zeros((len(over), len(one.directions)), dtype=np.float32)
                direction_gaps(frozen(course.directions[:, one.counted], np.float32), last, measured)
            over[:, self.first[k] : self.first[k + 1]] = measured[:, one.shown] / np.float32(one.limit_deg)
        return over

    def pieces(self, gaps: Array32, evidence_s: float) -> list[Piece]:
        """What explains (T, N) gaps best, in order of time; frames in no piece are better left unknown."""
        rules = self.first, self.repeats, self.slack
        return _path(gaps, rules, 1.0, evidence_s * RATE_HZ)[1]

    def fit(self, gaps: Array32, movement: str) -> Fit:
        """How well one movement explains all frames of (T, N) gaps; not at all if they are too few or too many."""
        cost, pieces = self._explained(gaps, [k for k, one in enumerate(self.variants) if one.movement == movement])
        if not pieces:
            return Fit()
        angles = [
            self._explained(gaps[one.first : one.behind], [one.k])[0] * self.variants[one.k].limit_deg for one in pieces
        ]
        longest = max(pieces, key=lambda one: one.behind - one.first)
        return Fit(cost / len(gaps), sum(angles) / len(gaps), longest)

    def angle_by(self, course: Course, movement: str, counted: Integers) -> float:
        """The angle to a movement, degrees, by these directions alone."""
        one = self.library.movements[movement]
        told = one.description.model_copy(update={"told_by": tuple(course.features.names[n] for n in counted)})
        alone = replace(self.library, movements={movement: replace(one, description=told)})
        known = packed(alone, self.rule, course.features)
        return known.fit(known.gaps(course), movement).angle_deg

    def _explained(self, gaps: Array32, chosen: Sequence[int]) -> tuple[float, list[Piece]]:
        """The cost of (T, N) gaps where chosen variants have to explain every frame, and which do; none if none can."""
        columns = np.concatenate([np.arange(self.first[k], self.first[k + 1]) for k in chosen])
        first = frozen(np.cumsum([0, *(self.first[k + 1] - self.first[k] for k in chosen)]), np.int64)
        # what repeats need not go on for long where nothing else is to explain the frames
        slack = frozen(np.where(self.repeats, 0, self.slack)[chosen], np.int64)
        rules = first, frozen(self.repeats[chosen], np.bool_), slack
        cost, pieces = _path(np.ascontiguousarray(gaps[:, columns]), rules, np.inf, 0.0)
        return cost, [one._replace(k=chosen[one.k]) for one in pieces]


def _path(
    gaps: Array32, rules: tuple[Integers, Mask, Integers], unknown: float, entry: float
) -> tuple[float, list[Piece]]:
    """The cost of the best path, and its pieces in order of time."""
    found = np.zeros((len(gaps) + 1, 3), dtype=np.int64)
    cost: float = warp_sequence(gaps, *rules, unknown, entry, found)
    pieces, behind = [], len(gaps)
    while np.isfinite(cost) and behind > 0:
        k, first, way = (int(value) for value in found[behind])
        if k >= 0:
            pieces.append(Piece(k, first, behind, way))
        behind = first
    return cost, pieces[::-1]


def packed(library: Library, rule: Rule, features: Features) -> Packed:
    """Puts a library's performances behind each other, with their variants.

    Raises:
        ConfigError: it is of another body than that with these features, or a movement is told by what they lack.
    """
    _check_body(library, features)
    found = tuple(variants(library, rule, features))
    return Packed(
        found,
        frozen(np.cumsum([0, *(len(one.shown) for one in found)]), np.int64),
        frozen([one.repeats for one in found], np.bool_),
        frozen([one.slack for one in found], np.int64),
        library,
        rule,
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
        f"the movements are of another body ({told or 'in another order'}): {person}"
        "bodytrack result recognize --add makes a --library of this one"
    )
