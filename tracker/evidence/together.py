"""Several kinds of evidence together: distances, equations and accounts times their weights."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pydantic

from tracker.account import Account, summed
from tracker.arrays import Array, Mask
from tracker.comparison import Comparison
from tracker.components import component
from tracker.contours import Contours
from tracker.equations import Equations, combined
from tracker.errors import ConfigError
from tracker.evidence import GUESSED, Evidence, Memory, Observed
from tracker.evidence.contours import ContourEvidence
from tracker.evidence.silhouettes import SilhouetteEvidence
from tracker.scene import Scene
from tracker.sight import Sight


@component
class TogetherEvidence(Evidence):
    """The weighted sum of what several kinds of evidence say."""

    of: tuple[Evidence, ...] = (ContourEvidence(), SilhouetteEvidence())
    """The kinds of evidence."""

    ranking: tuple[pydantic.NonNegativeFloat, ...] = (1.0, 1.0)
    """What each of them counts in distances: where a search goes, and which of several poses is better."""

    refining: tuple[pydantic.NonNegativeFloat, ...] = (1.0, 0.0)
    """What each of them counts in equations and in the shares of accounts. The outline of the foreground is that of
    shadows and of what clothes do, and says nothing of limbs before the body: where it counted as much as edges, legs
    that walk past each other were exchanged (72 instead of 29 mm)."""

    def __post_init__(self) -> None:
        """Checks that every kind has its weights, and that something is left to refine on.

        Raises:
            ConfigError: it has not.
        """
        for name, weights in (("ranking", self.ranking), ("refining", self.refining)):
            if len(weights) != len(self.of):
                raise ConfigError(f"together: {name} has {len(weights)} weights for {len(self.of)} kinds of evidence")
            if not sum(weights) > 0:
                raise ConfigError(f"together: no weight of {name} is greater than 0; expected at least one")

    def look(self, sight: Sight, around: Contours) -> None:
        """What each of them does ahead."""
        for one in self.of:
            one.look(sight, around)

    def observe(self, sight: Sight, expected: Contours | None, memory: Memory = None) -> tuple[Observed, ...]:
        """What each of them observes."""
        pairs = zip(self.of, self._memories(memory), strict=True)
        return tuple(one.observe(sight, expected, known) for one, known in pairs)

    def observe_again(self, asked: Comparison, q: Array) -> tuple[Observed, ...]:
        """What each of them observes; see `tracker.evidence.Evidence.observe_again`."""
        pairs = zip(self.of, asked.observed, strict=True)
        return tuple(one.observe_again(replace(asked, observed=observed), q) for one, observed in pairs)

    def distances(self, asked: Comparison, poses: Array) -> Array:
        """(B,) weighted sum, px."""
        parts = [weight * one.distances(own, poses) for one, weight, own in self._each(asked, self.ranking)]
        total: Array = np.sum(parts, axis=0)
        return total

    def equations(self, asked: Comparison, q: Array, gate_px: float) -> Equations:
        """Weighted sum; see `tracker.evidence.Evidence.equations`."""
        found = [(one.equations(own, q, gate_px), weight) for one, weight, own in self._each(asked, self.refining)]
        return combined(*zip(*found, strict=True))

    def account(self, asked: Comparison, q: Array) -> Account:
        """Weighted sum of the shares, and the distance that ranks; see `tracker.account.summed`."""
        found = [(one.account(own, q), weight) for one, weight, own in self._each(asked, self.refining)]
        shares = summed(*zip(*found, strict=True))
        return replace(shares, distance_px=float(self.distances(asked, q[None])[0]))

    def learned(self, memory: Memory, sight: Sight, scene: Scene, fitted: Contours, trusted: Mask) -> Memory:
        """What each of them has learned."""
        pairs = zip(self.of, self._memories(memory), strict=True)
        return tuple(one.learned(known, sight, scene, fitted, trusted) for one, known in pairs)

    def _memories(self, memory: Memory) -> tuple[Memory, ...]:
        return (memory,) * len(self.of) if memory is None or memory is GUESSED else memory

    def _each(self, asked: Comparison, weights: tuple[float, ...]) -> Iterator[tuple[Evidence, float, Comparison]]:
        """Each kind of evidence that counts, with its weight and the question as it is put to it."""
        for one, weight, observed in zip(self.of, weights, asked.observed, strict=True):
            if weight > 0:
                yield one, weight, replace(asked, observed=observed)
