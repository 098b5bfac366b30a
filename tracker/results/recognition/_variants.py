"""Variants of a known performance that somebody else might show: mirrored, deeper or shallower, slower or quicker."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from tracker.foundation.arrays import Array32, Integers, frozen
from tracker.foundation.errors import ConfigError, nearest
from tracker.kernels.movements import direction_gaps
from tracker.results.recognition.library import LEAST_FRAMES, Library, Movement
from tracker.results.recognition.rule import Rule
from tracker.results.recognition.segment_directions import Features

_MOST_POSES = 400
"""Of a long stretch whose extent is measured: 16 seconds of all its frames, or some of a longer one."""


@dataclass(frozen=True)
class Variant:
    """A performance as somebody else might show it."""

    movement: str
    performance: str
    mirrored: bool
    repeats: bool

    counted: Integers
    """Numbers of the directions that it is told by."""

    directions: Array32
    """(D, L, 3) of these; variants of several tempos share them."""

    shown: Integers
    """(F,) which of the D frames it shows, one after the other; those of a slow one are there twice."""

    tempo: float
    """Times as fast as the known performance."""

    reach_deg: float
    """The largest angle between two poses of the known performance."""

    limit_deg: float
    """The largest angle that counts as this."""

    slack: int
    """Frames; see `warp_sequence`."""

    least_size: float
    """What is smaller is not told: half of the smallest variant."""

    @property
    def least_frames(self) -> int:
        """That it has to last."""
        return self.slack if self.repeats else 1


def variants(library: Library, rule: Rule, features: Features) -> Iterator[Variant]:
    """All of a library; those of several tempos follow one another.

    Raises:
        ConfigError: a movement is told by a direction that there is not.
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
    gaps = angles_between(directions[:, counted])
    extent_deg, reach_deg = float(gaps.mean(axis=0).min()), float(gaps.max())
    returns = not repeats and gaps[0, -1] <= rule.least_limit_deg
    usual = directions.mean(axis=0) if repeats else directions[0]
    sizes = rule.sizes if repeats else rule.depths if returns else (1.0,)
    for size in sizes:
        swung = _swung(directions, usual, size)
        # a shallow movement is told from standing still by less; a deep one must be as like as the known one
        limit_deg = max(rule.limit * extent_deg * (1.0 if repeats else min(size, 1.0)), rule.least_limit_deg)
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
                    frozen(at, np.int64),
                    tempo,
                    reach_deg,
                    limit_deg,
                    int(share * len(at)),
                    min(sizes) / 2,
                )


def angles_between(directions: Array32) -> Array32:
    """(T, T) angles between poses (T, L, 3), degrees; of many poses, between some."""
    some = frozen(directions[:: -(-len(directions) // _MOST_POSES)], np.float32)
    gaps = np.zeros((len(some), len(some)), dtype=np.float32)
    direction_gaps(some, some, gaps)
    return gaps


def _swung(directions: Array32, usual: Array32, size: float) -> Array32:
    """Directions (T, L, 3) so many times as far from usual ones (L, 3), along great circles."""
    usual = usual / np.maximum(np.linalg.norm(usual, axis=-1, keepdims=True), 1e-6)
    along = np.sum(directions * usual, axis=-1, keepdims=True)
    across = directions - along * usual
    length = np.linalg.norm(across, axis=-1, keepdims=True)
    angle = np.minimum(size * np.arctan2(length, along), np.pi)
    swung = np.cos(angle) * usual + np.sin(angle) * across / np.maximum(length, 1e-6)
    return frozen(np.where(length > 1e-6, swung, directions), np.float32)
