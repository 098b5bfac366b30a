"""Several kinds of evidence together: distances, equations and accounts times their weights."""

from __future__ import annotations

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
from tracker.evidence import Evidence, Memory, Observed
from tracker.evidence.contours import ContourEvidence
from tracker.evidence.silhouettes import SilhouetteEvidence
from tracker.scene import Scene
from tracker.sight import Sight


@component
class TogetherEvidence(Evidence):
    """The weighted sum of what several kinds of evidence say."""

    of: tuple[Evidence, ...] = (ContourEvidence(), SilhouetteEvidence())
    """The kinds of evidence."""

    weights: tuple[pydantic.NonNegativeFloat, ...] = ()
    """What each of them counts in distances, equations and accounts; empty for 1 each."""

    def __post_init__(self) -> None:
        """Checks that every kind has a weight.

        Raises:
            ConfigError: it has not.
        """
        if not self.of:
            raise ConfigError('together: no evidence, expected at least one, e.g. of = [{ use = "contours" }]')
        if self.weights and len(self.weights) != len(self.of):
            raise ConfigError(f"together: {len(self.weights)} weights for {len(self.of)} kinds of evidence")

    def look(self, sight: Sight, around: Contours) -> None:
        """What each of them does ahead."""
        for one in self.of:
            one.look(sight, around)

    def observe(self, sight: Sight, expected: Contours | None, memory: Memory = None) -> tuple[Observed, ...]:
        """What each of them observes."""
        pairs = zip(self.of, self._memories(memory), strict=True)
        return tuple(one.observe(sight, expected, known) for one, known in pairs)

    def distances(self, asked: Comparison, poses: Array) -> Array:
        """(B,) weighted sum, px."""
        total: Array = np.sum([weight * one.distances(own, poses) for one, weight, own in self._each(asked)], axis=0)
        return total

    def equations(self, asked: Comparison, q: Array, gate_px: float) -> Equations:
        """Weighted sum; see `tracker.evidence.Evidence.equations`."""
        found = [one.equations(own, q, gate_px) for one, _, own in self._each(asked)]
        return combined(found, self._weights)

    def account(self, asked: Comparison, q: Array) -> Account:
        """Weighted sum; see `tracker.account.summed`."""
        return summed([one.account(own, q) for one, _, own in self._each(asked)], self._weights)

    def learned(self, memory: Memory, sight: Sight, scene: Scene, fitted: Contours, trusted: Mask) -> Memory:
        """What each of them has learned."""
        pairs = zip(self.of, self._memories(memory), strict=True)
        return tuple(one.learned(known, sight, scene, fitted, trusted) for one, known in pairs)

    @property
    def _weights(self) -> tuple[float, ...]:
        return self.weights or (1.0,) * len(self.of)

    def _memories(self, memory: Memory) -> tuple[Memory, ...]:
        return (None,) * len(self.of) if memory is None else memory

    def _each(self, asked: Comparison) -> list[tuple[Evidence, float, Comparison]]:
        """Each kind of evidence with its weight and the question as it is put to it."""
        questions = (replace(asked, observed=one) for one in asked.observed)
        return list(zip(self.of, self._weights, questions, strict=True))
