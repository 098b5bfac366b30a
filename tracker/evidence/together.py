"""Several kinds of evidence together: distances, equations and accounts times their weights."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import pydantic

from tracker.bodies.contours import Contours
from tracker.bodies.scene import Scene
from tracker.cameras.rig import Rig
from tracker.evidence import GUESSED, Evidence, EvidencePicture, Memory, Observed
from tracker.evidence.contours import ContourEvidence
from tracker.evidence.measures.account import Account, summed
from tracker.evidence.measures.correspondences import Equations, combined
from tracker.evidence.measures.outlines import Comparison
from tracker.evidence.silhouettes import SilhouetteEvidence
from tracker.foundation.arrays import Array, Mask
from tracker.foundation.configuration.components import component
from tracker.foundation.errors import ConfigError
from tracker.images.sight import Sight
from tracker.kernels.descent import Kinds

# A choice: half the residual counts 16 times.
_SHARPNESS = 4.0
# What a compiled refinement is on, see `tracker.kernels.descent.Kinds`.
_SAID = ("edges", "colours", "places")
# Longer side of the images that thresholds in px are told for.
_USUAL_PX = 720.0


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

    exact_px: tuple[pydantic.NonNegativeFloat, ...] = ()
    """For each kind: what its equations leave over, RMS where the longer side of images has 720 px and less in smaller
    ones, under which it counts more in them, px; 0 for never, empty for none. A kind that fits so well knows the body;
    see `auto`."""

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
        if len(self.exact_px) not in (0, len(self.of)):
            raise ConfigError(
                f"together: exact_px has {len(self.exact_px)} values for {len(self.of)} kinds of evidence"
            )

    def check(self, scene: Scene) -> None:
        """What each of them refuses."""
        for one in self.of:
            one.check(scene)

    def told(self, known: Sequence[object | None]) -> str:
        """What each of them goes by."""
        return "; ".join(filter(None, (one.told(known) for one in self.of)))

    def takes_part_plates(self) -> bool:
        """If one of them does."""
        return any(one.takes_part_plates() for one in self.of)

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
        return tuple(one.observe_again(asked.put(observed), q) for one, observed in pairs)

    def distances(self, asked: Comparison, poses: Array) -> Array:
        """(B,) weighted sum, px."""
        parts = [weight * one.distances(own, poses) for one, weight, own in self._each(asked, self.ranking)]
        total: Array = np.sum(parts, axis=0)
        return total

    def equations(self, asked: Comparison, q: Array, gate_px: float) -> Equations:
        """Weighted sum; see `tracker.evidence.Evidence.equations`."""
        found = [one.equations(own, q, gate_px) for one, _, own in self._each(asked, self.refining)]
        counted = [k for k, weight in enumerate(self.refining) if weight > 0]
        weights = [self.refining[k] for k in counted]
        if self.exact_px:
            share = _share_of_usual(asked.scene.rig)
            weights = _sharpened(weights, found, [self.exact_px[k] * share for k in counted])
        return combined(found, weights)

    def kinds(self, asked: Comparison) -> Kinds | None:
        """All of them, if each is compiled and says one thing."""
        together, share = Kinds(), _share_of_usual(asked.scene.rig)
        exact_px = self.exact_px or (0.0,) * len(self.of)
        for one, weight, observed, px in zip(self.of, self.refining, asked.observed, exact_px, strict=True):
            if weight == 0:
                continue
            own = one.kinds(asked.put(observed))
            said = () if own is None else tuple(name for name in _SAID if getattr(own, name) is not None)
            if own is None or len(said) > 1 or any(getattr(together, name) is not None for name in said):
                return None
            counted = {name: getattr(own, name)._replace(weight=weight, exact_px=px * share) for name in said}
            silent = max(together.most_silent, weight * own.most_silent)
            together = together._replace(most_silent=silent, **counted)
        return together

    def account(self, asked: Comparison, q: Array) -> Account:
        """Weighted sum of the shares, and the distance that ranks; see `tracker.evidence.measures.account.summed`."""
        questions = [asked.put(observed) for observed in asked.observed]
        found = {k: self.of[k].account(questions[k], q) for k, weight in enumerate(self.refining) if weight > 0}
        # the distance of an account is what `distances` gives: it is not measured twice
        parts = [
            weight * (found[k].distance_px if k in found else float(self.of[k].distances(questions[k], q[None])[0]))
            for k, weight in enumerate(self.ranking)
            if weight > 0
        ]
        shares = summed(list(found.values()), [self.refining[k] for k in found])
        return replace(shares, distance_px=float(np.sum(parts)))

    def learned(self, memory: Memory, sight: Sight, scene: Scene, fitted: Contours, trusted: Mask) -> Memory:
        """What each of them has learned."""
        pairs = zip(self.of, self._memories(memory), strict=True)
        return tuple(one.learned(known, sight, scene, fitted, trusted) for one, known in pairs)

    def pictures(self, asked: Comparison, sight: Sight, view: int) -> tuple[EvidencePicture, ...]:
        """What each of them saw."""
        pairs = zip(self.of, asked.observed, strict=True)
        return tuple(made for one, seen in pairs for made in one.pictures(asked.put(seen), sight, view))

    def _memories(self, memory: Memory) -> tuple[Memory, ...]:
        return (memory,) * len(self.of) if memory is None or memory is GUESSED else memory

    def _each(self, asked: Comparison, weights: tuple[float, ...]) -> Iterator[tuple[Evidence, float, Comparison]]:
        """Each kind of evidence that counts, with its weight and the question as it is put to it."""
        for one, weight, observed in zip(self.of, weights, asked.observed, strict=True):
            if weight > 0:
                yield one, weight, asked.put(observed)


def _sharpened(weights: Sequence[float], found: Sequence[Equations], exact_px: Sequence[float]) -> list[float]:
    """Weights of equations, raised for those that leave less than `exact_px` over; the largest stays."""
    raised = []
    for weight, one, px in zip(weights, found, exact_px, strict=True):
        rms_px = math.sqrt(one.squares / one.total) if one.squares > 0 else math.inf
        raised.append(weight * max(px / rms_px, 1.0) ** _SHARPNESS)
    return [weight * max(weights) / max(raised) for weight in raised]


def _share_of_usual(rig: Rig) -> float:
    """What a pixel of the smallest view is of one at 720 px of width, at most 1."""
    return min(1.0, float(rig.sizes.max(axis=1).min()) / _USUAL_PX)
