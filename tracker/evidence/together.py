"""Several kinds of evidence together: distances, equations and accounts times their weights."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

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
from tracker.kernels.descent import Asked, Kinds

# A choice: half the residual counts 16 times.
_SHARPNESS = 4.0
# Kinds of evidence that a compiled refinement uses, see `tracker.kernels.descent.Kinds`.
_SAID = ("edges", "colours", "places")
# Longer side of the images that thresholds in px are told for.
_USUAL_PX = 720.0


@component
class TogetherEvidence(Evidence):
    """The weighted sum of several kinds of evidence."""

    of: tuple[Evidence, ...] = (ContourEvidence(), SilhouetteEvidence())
    """The kinds of evidence."""

    ranking: tuple[pydantic.NonNegativeFloat, ...] = (1.0, 1.0)
    """Weights in distances: they direct the search, and rank poses."""

    refining: tuple[pydantic.NonNegativeFloat, ...] = (1.0, 0.0)
    """Weights in equations and in the shares of accounts. The outline of the foreground includes
    shadows and clothes, and says nothing about limbs before the body: with the same weight as edges, legs that walk
    past each other were exchanged (72 instead of 29 mm)."""

    exact_px: tuple[pydantic.NonNegativeFloat, ...] = ()
    """For each kind: RMS that its equations leave over below which it counts more in them, px, in images whose longer
    side is 720 px, and less in smaller ones; 0 for never, empty for none. A kind that fits so well knows the body; see
    `auto`."""

    def __post_init__(self) -> None:
        """Checks that every kind has its weights, and that a refinement has at least one kind.

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
        """Refuses what any of them refuses."""
        for one in self.of:
            one.check(scene)

    def told(self, known: Sequence[object | None]) -> str:
        """Their messages."""
        return "; ".join(filter(None, (one.told(known) for one in self.of)))

    def takes_part_plates(self) -> bool:
        """True if any of them does."""
        return any(one.takes_part_plates() for one in self.of)

    def look(self, sight: Sight, around: Contours) -> None:
        """Prepares all of them."""
        for one in self.of:
            one.look(sight, around)

    def observe(self, sight: Sight, expected: Contours | None, memory: Memory = None) -> tuple[Observed, ...]:
        """Their observations."""
        pairs = zip(self.of, self._memories(memory), strict=True)
        return tuple(one.observe(sight, expected, known) for one, known in pairs)

    def observe_again(self, asked: Comparison, q: Array) -> tuple[Observed, ...]:
        """Their repeated observations; see `tracker.evidence.Evidence.observe_again`."""
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
        """The compiled kinds; the others are called. None if nothing is compiled."""
        counted = [k for k, weight in enumerate(self.refining) if weight > 0]
        found = {k: self.of[k].kinds(asked.put(asked.observed[k])) for k in counted}
        weighed = [k for k, own in found.items() if own is not None and _are_weighed(own)]
        if len(weighed) == 1 and self.refining[weighed[0]] == 1 and not any(self.exact_px):
            return self._with_others(weighed[0], found)
        return self._together(found, asked)

    def _together(self, found: Mapping[int, Kinds | None], asked: Comparison) -> Kinds | None:
        """Kinds with one compiled form each; all others are called."""
        together, share, others = Kinds(), _share_of_usual(asked.scene.rig), []
        for k, own in found.items():
            weight, px = self.refining[k], share * (self.exact_px[k] if self.exact_px else 0.0)
            said = () if own is None else _said(own)
            if own is None or _are_weighed(own) or any(getattr(together, name) is not None for name in said):
                others.append(Asked(weight, px, partial(_answer, self.of[k], k)))
                continue
            counted = {name: getattr(own, name)._replace(weight=weight, exact_px=px) for name in said}
            silent = max(together.most_silent, weight * own.most_silent)
            together = together._replace(most_silent=silent, **counted)
        return together._replace(asked=tuple(others)) if _said(together) or not others else None

    def _with_others(self, k: int, found: Mapping[int, Kinds | None]) -> Kinds | None:
        """The kinds of number k, weighed among themselves as they are, and all others beside them."""
        own = found[k]
        assert own is not None
        inner = [one._replace(ask=partial(_passed_on, one.ask, k)) for one in own.asked]
        beside = [Asked(self.refining[n], 0.0, partial(_answer, self.of[n], n), apart=True) for n in found if n != k]
        return own._replace(asked=(*inner, *beside))

    def account(self, asked: Comparison, q: Array) -> Account:
        """Weighted sum of the shares, and the distance that ranks; see `tracker.evidence.measures.account.summed`."""
        questions = [asked.put(observed) for observed in asked.observed]
        found = {k: self.of[k].account(questions[k], q) for k, weight in enumerate(self.refining) if weight > 0}
        # the distance of an account is that of `distances`: it is not measured twice
        parts = [
            weight * (found[k].distance_px if k in found else float(self.of[k].distances(questions[k], q[None])[0]))
            for k, weight in enumerate(self.ranking)
            if weight > 0
        ]
        shares = summed(list(found.values()), [self.refining[k] for k in found])
        return replace(shares, distance_px=float(np.sum(parts)))

    def learned(self, memory: Memory, sight: Sight, scene: Scene, fitted: Contours, trusted: Mask) -> Memory:
        """Their knowledge."""
        pairs = zip(self.of, self._memories(memory), strict=True)
        return tuple(one.learned(known, sight, scene, fitted, trusted) for one, known in pairs)

    def pictures(self, asked: Comparison, sight: Sight, view: int) -> tuple[EvidencePicture, ...]:
        """Their pictures."""
        pairs = zip(self.of, asked.observed, strict=True)
        return tuple(made for one, seen in pairs for made in one.pictures(asked.put(seen), sight, view))

    def _memories(self, memory: Memory) -> tuple[Memory, ...]:
        return (memory,) * len(self.of) if memory is None or memory is GUESSED else memory

    def _each(self, asked: Comparison, weights: tuple[float, ...]) -> Iterator[tuple[Evidence, float, Comparison]]:
        """Each kind of evidence with a weight, its weight and its question."""
        for one, weight, observed in zip(self.of, weights, asked.observed, strict=True):
            if weight > 0:
                yield one, weight, asked.put(observed)


def _said(kinds: Kinds) -> tuple[str, ...]:
    """Names of the compiled kinds."""
    return tuple(name for name in _SAID if getattr(kinds, name) is not None)


def _are_weighed(kinds: Kinds) -> bool:
    """Whether kinds count as much as others among them say: they cannot be given another weight each."""
    said = [getattr(kinds, name) for name in _said(kinds)]
    plain = all(one.weight == 1 and one.exact_px == 0 for one in said)
    return bool(kinds.asked) or len(said) > 1 or not plain or (bool(said) and kinds.most_silent > 0)


def _passed_on(ask: Callable[..., Any], k: int, asked: Comparison, q: Array, gate_px: float) -> Any:
    """Answer of one of the kinds of number k."""
    return ask(asked.put(asked.observed[k]), q, gate_px)


def _answer(one: Evidence, k: int, asked: Comparison, q: Array, gate_px: float) -> tuple[Array, Array, float, float]:
    """The equations of the kind that has the number k, of a question that is put to all."""
    found = one.equations(asked.put(asked.observed[k]), q, gate_px)
    return found.matrix, found.vector, found.squares, found.total


def _sharpened(weights: Sequence[float], found: Sequence[Equations], exact_px: Sequence[float]) -> list[float]:
    """Weights of equations, raised for kinds that leave less than `exact_px` over; the largest stays."""
    raised = []
    for weight, one, px in zip(weights, found, exact_px, strict=True):
        rms_px = math.sqrt(one.squares / one.total) if one.squares > 0 else math.inf
        raised.append(weight * max(px / rms_px, 1.0) ** _SHARPNESS)
    return [weight * max(weights) / max(raised) for weight in raised]


def _share_of_usual(rig: Rig) -> float:
    """Size of a pixel of the smallest view at 720 px of width, at most 1."""
    return min(1.0, float(rig.sizes.max(axis=1).min()) / _USUAL_PX)
