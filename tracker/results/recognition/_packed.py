"""A library for the kernels: all variants of its performances one after the other."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from tracker.foundation.arrays import Array32, Integers, Mask, frozen
from tracker.foundation.errors import ConfigError, nearest
from tracker.kernels.movements import direction_gaps, warp_sequence
from tracker.results.recognition import FEATURES, RATE_HZ, Course, Features
from tracker.results.recognition.library import LEAST_FRAMES, Library, Movement


@dataclass(frozen=True)
class Rule:
    """Limits of recognition."""

    limit: float = 0.7
    """Share of a known movement's extent that the angles to it must stay below. The extent is the angle that the best
    single pose of the movement
    would leave: below 0.7, the movement explains more than half of the variance."""

    # See docs/lab/everyday_movements.md.
    least_limit_deg: float = 16.0
    """The limit for a movement of small extent: two persons stand differently. The walks of one person are 4 degrees
    apart, of two persons 9 to 13; a person with bent knees stands 14 degrees from the next one."""

    most_limit_deg: float = 32.0
    """The limit for a movement of large extent. Without one, arms swung round explained the beginning of all movements
    of arms. The runs of two persons are 25 degrees apart."""

    least_moved_deg: float = 10.0
    """Weight of a limb at rest: that of a limb that departs by this angle from its mean direction. If nine limbs count
    alike, one that points or waves matters little, and the postures of the others use up the limit."""

    evidence_s: float = 0.1
    """Least advantage of a movement over none, in seconds at no angle at all."""

    margin: float = 0.15
    """Share of a movement that may be missing at each end, if it does not repeat."""

    least_round: float = 0.5
    """Least share of a cycle of a repeating movement."""

    sizes: tuple[float, ...] = (0.75, 1.0, 1.35)
    """Largest swing of the limbs about their mean direction, times that of the known performance, of a repeating
    movement."""

    depths: tuple[float, ...] = (0.5, 0.75, 1.0, 1.35)
    """Range of the departure from the posture in which a movement begins and ends, times that of the known performance:
    a shallow squat and a deep one."""

    tempos: tuple[float, ...] = (0.65, 1.0, 1.5)
    """Range of speed, times the known performance's, of a movement that does not repeat, before warping halves or
    doubles it once more: it may take a third to three times as long."""


_MOST_POSES = 400
"""Frames of a long stretch that measure its extent: 16 seconds of all its frames, or some of a longer one."""


@dataclass(frozen=True)
class Variant:
    """A performance as another person might show it."""

    movement: str
    performance: str
    mirrored: bool
    repeats: bool

    counted: Integers
    """Numbers of its decisive directions."""

    directions: Array32
    """(D, L, 3) of these; variants of several tempos share them."""

    weights: Array32
    """(L,) their weights; the sum is 1."""

    shown: Integers
    """(F,) its frames among the D, one after the other; a slow variant has them twice."""

    tempo: float
    """Speed, times the known performance's."""

    reach_deg: float
    """The largest angle between two poses of the known performance."""

    limit_deg: float
    """Largest angle that counts as this movement."""

    slack: int
    """Frames; see `warp_sequence`."""

    least_size: float
    """Least extent: half of the smallest variant's, or 0.7 of it if half a cycle is enough. The beginning of a
    cartwheel is like half a cycle of a jumping jack 0.48 times as large; a person's run is 0.56 times as large as
    another one's."""

    @property
    def least_frames(self) -> int:
        """Least duration."""
        return self.slack if self.repeats else 1


def variants(library: Library, rule: Rule, features: Features) -> Iterator[Variant]:
    """All variants of a library; those of several tempos follow one another.

    Raises:
        ConfigError: a decisive direction of a movement does not exist.
    """
    for movement in library.movements.values():
        counted = _counted(movement, features)
        for name, directions in movement.performances.items():
            yield from _of_performance(movement, name, directions, (counted, features, rule))


def _counted(movement: Movement, features: Features) -> list[int]:
    told_by = movement.description.told_by or features.names
    for name in told_by:
        if name not in features.names:
            raise ConfigError(f'movement "{movement.name}": told_by: "{name}"; {nearest(name, features.names)}')
    return [features.names.index(name) for name in told_by]


def _of_performance(
    movement: Movement, name: str, directions: Array32, by: tuple[list[int], Features, Rule]
) -> Iterator[Variant]:
    counted, features, rule = by
    repeats = movement.description.repeats
    weights = weights_of(directions[:, counted], rule)
    gaps = angles_between(directions[:, counted], weights)
    extent_deg, reach_deg = float(gaps.mean(axis=0).min()), float(gaps.max())
    returns = not repeats and gaps[0, -1] <= rule.least_limit_deg
    usual = directions.mean(axis=0) if repeats else directions[0]
    sizes = rule.sizes if repeats else rule.depths if returns else (1.0,)
    for size in sizes:
        swung = _swung(directions, usual, size)
        # a shallow movement is told from standing still by less; a deep one must be as like as the known one
        share = rule.limit * (1.0 if repeats else min(size, 1.0))
        limit_deg = min(max(share * extent_deg, rule.least_limit_deg), rule.most_limit_deg)
        for mirrored in (False, True) if features.partners else (False,):
            shown = features.mirrored(swung) if mirrored else swung
            own = [features.partners[n] for n in counted] if mirrored else counted
            for tempo in (1.0,) if repeats else rule.tempos:
                at = np.floor(np.arange(0, len(directions), tempo)).astype(np.int64)
                if len(at) < LEAST_FRAMES:
                    continue
                share = rule.least_round if repeats else rule.margin
                yield Variant(
                    movement.name,
                    name,
                    mirrored,
                    repeats,
                    frozen(own, np.int64),
                    frozen(shown[:, own], np.float32),
                    weights,
                    frozen(at, np.int64),
                    tempo,
                    reach_deg,
                    limit_deg,
                    int(share * len(at)),
                    (0.7 if repeats else 0.5) * min(sizes),
                )


def weights_of(directions: Array32, rule: Rule) -> Array32:
    """(L,) weights of the limbs in a movement (T, L, 3): they grow with the departure from the mean direction."""
    mean = directions.mean(axis=0)
    mean /= np.maximum(np.linalg.norm(mean, axis=-1, keepdims=True), 1e-6)
    chords = np.linalg.norm(directions - mean, axis=-1)
    moved_deg = np.degrees(np.sqrt(np.mean((2 * np.arcsin(np.minimum(chords / 2, 1))) ** 2, axis=0)))
    counts = rule.least_moved_deg + moved_deg
    return frozen(counts / counts.sum(), np.float32)


def angles_between(directions: Array32, weights: Array32) -> Array32:
    """(T, T) angles between poses (T, L, 3), degrees; of many poses, between some."""
    some = frozen(directions[:: -(-len(directions) // _MOST_POSES)], np.float32)
    gaps = np.zeros((len(some), len(some)), dtype=np.float32)
    direction_gaps(some, some, weights, gaps)
    return gaps


def _swung(directions: Array32, usual: Array32, size: float) -> Array32:
    """Directions (T, L, 3) moved away from usual ones (L, 3) by a factor, along great circles."""
    usual = usual / np.maximum(np.linalg.norm(usual, axis=-1, keepdims=True), 1e-6)
    along = np.sum(directions * usual, axis=-1, keepdims=True)
    across = directions - along * usual
    length = np.linalg.norm(across, axis=-1, keepdims=True)
    angle = np.minimum(size * np.arctan2(length, along), np.pi)
    swung = np.cos(angle) * usual + np.sin(angle) * across / np.maximum(length, 1e-6)
    return frozen(np.where(length > 1e-6, swung, directions), np.float32)


class Piece(NamedTuple):
    """A stretch of a recording as a variant of a performance."""

    k: int
    """Number of the variant."""

    first: int
    behind: int
    """The first frame, and the one behind the last."""

    way: int
    """Number of the variant's frames that it passes."""


class Fit(NamedTuple):
    """How well one movement explains all frames."""

    misfit: float = np.inf
    """The angle over the largest that counts; infinite if the movement cannot explain the frames."""

    angle_deg: float = np.inf
    piece: Piece | None = None
    """The longest stretch among those that explain the frames; None if nothing does."""


@dataclass(frozen=True)
class Packed:
    """All variants one after the other; K of them, N frames."""

    variants: tuple[Variant, ...]
    """(K,)."""

    first: Integers
    """(K + 1,) first frame of each variant."""

    repeats: Mask
    """(K,)."""

    slack: Integers
    """(K,) frames; see `warp_sequence`."""

    library: Library
    rule: Rule

    @property
    def movements(self) -> tuple[str, ...]:
        """Variants of all movements."""
        return tuple(dict.fromkeys(one.movement for one in self.variants))

    def gaps(self, course: Course) -> Array32:
        """(T, N) angles of every frame to every known one, over the limit of its variant."""
        over = np.zeros((len(course.known), int(self.first[-1])), dtype=np.float32)
        measured, last = np.zeros((0, 0), dtype=np.float32), None
        for k, one in enumerate(self.variants):
            if one.directions is not last:
                last, measured = one.directions, np.zeros((len(over), len(one.directions)), dtype=np.float32)
                direction_gaps(frozen(course.directions[:, one.counted], np.float32), last, one.weights, measured)
            over[:, self.first[k] : self.first[k + 1]] = measured[:, one.shown] / np.float32(one.limit_deg)
        return over

    def pieces(self, gaps: Array32, evidence_s: float) -> list[Piece]:
        """The best explanation of (T, N) gaps, in order of time; frames in no piece are better left unknown."""
        rules = self.first, self.repeats, self.slack
        return _path(gaps, rules, 1.0, evidence_s * RATE_HZ)[1]

    def fit(self, gaps: Array32, movement: str) -> Fit:
        """How well one movement explains all frames of (T, N) gaps; not at all if there are too few or too many."""
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
        """The cost of (T, N) gaps if chosen variants must explain every frame, and pieces; none if they cannot."""
        columns = np.concatenate([np.arange(self.first[k], self.first[k + 1]) for k in chosen])
        first = frozen(np.cumsum([0, *(self.first[k + 1] - self.first[k] for k in chosen)]), np.int64)
        # a repeating movement may be short if nothing else has to explain the frames
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
    """Joins a library's performances, with their variants.

    Raises:
        ConfigError: it is of another body than the features, or a movement's decisive direction is missing.
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
