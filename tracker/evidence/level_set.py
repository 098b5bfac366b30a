"""Evidence of contours by level sets, without clean plates (Rosenhahn et al. 2006, sections 2.1 and 3.1)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import partial
from typing import Literal

import cv2
import numpy as np
import pydantic

from tracker.account import Account
from tracker.arrays import Array, Array32, Image, Mask, Region
from tracker.comparison import Comparison
from tracker.components import component
from tracker.contours import Contours
from tracker.equations import Equations
from tracker.evidence import GUESSED, Memory, Observed
from tracker.evidence.silhouettes import Foregrounds, SilhouetteEvidence
from tracker.imaging.densities import Codes, Densities, colour_codes, densities, texture_codes
from tracker.imaging.level_set import Forces, descent, signed_distance, threshold_dynamics
from tracker.scene import Scene
from tracker.sight import Sight
from tracker.synthesis.cpu import CpuSynthesis

_STRANGE = 4.0
"""Odds against the person of pixels beyond the reach: what one pixel can prove at most."""

_LEAST_SHARE, _MOST_SHARE = 0.5, 2.0
"""A region with fewer or more of the model's pixels than this is that of something else: the view does not count."""

_TRUSTED = 0.5
"""Share of the parts that must be trusted for the frame to teach anything."""

Learned = tuple[Densities | None, ...]
"""What is known of each view."""


@dataclass(frozen=True, eq=False)
class ObservedLevels:
    """The images of a frame; the contours are found when the first question tells where the model is expected."""

    sight: Sight
    memory: Learned | None
    blind: bool
    """Whether the pose expected is none, or but a guess: a contour drawn towards it would confirm it."""

    _found: list[Foregrounds] = field(default_factory=list, repr=False)

    def foregrounds(self, scene: Scene, by: LevelSetEvidence) -> Foregrounds:
        """The regions of all persons of a scene at about the predicted poses."""
        if not self._found:
            self._found.append(by.seen(by.regions(self, scene)))
        return self._found[0]


@component
class LevelSetEvidence(SilhouetteEvidence):
    """The outline of the region that looks as the persons did, against the outline of the model; needs no plates.

    A contour that starts at the model's outline is drawn to where colours inside and outside part best, held by its
    length and by the model's shape (eq. 4). `estimation = { use = "coupled" }` alternates it with the pose.
    """

    way: Literal["threshold_dynamics", "descent"] = "threshold_dynamics"
    """How the energy is minimized; `descent` is the paper's gradient descent in a narrow band, and slow."""

    length: float = pydantic.Field(default=3.0, ge=0)
    """Weight of the contour's length, odds a px of the small picture."""

    shape: float = pydantic.Field(default=0.075, ge=0)
    """Weight lambda of the model's shape, odds a px^2: at 10 px from the model's outline it is worth 1.5 of odds."""

    texture: bool = False
    """Whether the structure tensor is looked at besides colours; on four recordings it changed nothing."""

    adaptations: int = pydantic.Field(default=0, ge=0)
    """How often in a frame the densities are estimated anew from the contour found (EM), and it from them."""

    around_px: float = pydantic.Field(default=30.0, gt=0)
    """How far outside of the model's outline the region may reach, px of the image."""

    longest_px: int = pydantic.Field(default=384, ge=32)
    """Longer side of an image that is looked at: larger ones are made smaller by a whole factor."""

    news: float = pydantic.Field(default=0.2, gt=0, le=1)
    """Share of a new frame in the densities."""

    def look(self, sight: Sight, around: Contours) -> None:
        """Nothing: where the model is, only the question tells."""

    def observe(self, sight: Sight, expected: Contours | None, memory: Memory = None) -> Observed:
        """Keeps the frame; see `tracker.evidence.Evidence.observe`."""
        blind = expected is None or memory is GUESSED
        return ObservedLevels(sight, None if blind else memory, blind)

    def observe_again(self, asked: Comparison, q: Array) -> ObservedLevels:
        """The same frame with the person at a pose (dof,) as the prior of the contour."""
        seen: ObservedLevels = asked.observed
        again = ObservedLevels(seen.sight, seen.memory, seen.blind)
        again.foregrounds(asked.scene.with_pose(asked.person, q), self)
        return again

    def distances(self, asked: Comparison, poses: Array) -> Array:
        """(B,) what is left bare of the region and what is covered beside it; see `SilhouetteEvidence.distances`."""
        return super().distances(self._put(asked), poses)

    def equations(self, asked: Comparison, q: Array, gate_px: float) -> Equations:
        """Outline against zero level; see `tracker.evidence.Evidence.equations`."""
        return super().equations(self._put(asked), q, gate_px)

    def account(self, asked: Comparison, q: Array) -> Account:
        """What of the model's outline lies on the zero level, and what of that it misses."""
        return super().account(self._put(asked), q)

    def learned(self, memory: Memory, sight: Sight, scene: Scene, fitted: Contours, trusted: Mask) -> Memory:
        """Densities inside and outside of the model's outline, a running mean."""
        if trusted.mean() < _TRUSTED:
            return memory
        known = memory or (None,) * len(scene.rig)
        silhouettes = CpuSynthesis().silhouettes(scene)
        return tuple(
            self._taught(one, sight, v, mask) for v, (one, mask) in enumerate(zip(known, silhouettes, strict=True))
        )

    def regions(self, seen: ObservedLevels, scene: Scene) -> tuple[Mask | None, ...]:
        """(H, W) the region of the persons in every view; None where nothing can be said.

        Args:
            seen: the frame, and what is known.
            scene: the persons at about the poses expected.
        """
        if seen.blind:
            return (None,) * len(scene.rig)
        known = seen.memory or (None,) * len(scene.rig)
        silhouettes = CpuSynthesis().silhouettes(scene)
        return tuple(
            self._region(seen.sight, v, mask, one) for v, (mask, one) in enumerate(zip(silhouettes, known, strict=True))
        )

    def _put(self, asked: Comparison) -> Comparison:
        """The question as it is put to silhouettes."""
        return replace(asked, observed=asked.observed.foregrounds(asked.scene, self))

    def _region(self, sight: Sight, v: int, silhouette: Mask, known: Densities | None) -> Mask | None:
        found = self._model(sight, v, silhouette)
        if found is None:
            return None
        (x, y, width, height), codes, prior = found
        near = prior > -self.around_px / self._factor(silhouette)
        known = known or densities(codes, prior > 0, near & (prior <= 0))
        if known is None:
            return None
        region = self._drawn(known, codes, prior, near)
        for _ in range(self.adaptations):
            known = densities(codes, region, near & ~region) or known
            region = self._drawn(known, codes, prior, near)
        share = np.count_nonzero(region) / max(int(np.count_nonzero(prior > 0)), 1)
        if not _LEAST_SHARE <= share <= _MOST_SHARE:
            return None
        mask = np.zeros(silhouette.shape, dtype=np.bool_)
        mask[y : y + height, x : x + width] = cv2.resize(region.astype(np.float32), (width, height)) > 0.5
        return mask

    def _drawn(self, known: Densities, codes: Codes, prior: Array32, near: Mask) -> Mask:
        """The contour from the model's outline on."""
        odds = np.where(near, known.log_odds(codes), np.float32(-_STRANGE))
        forces = Forces(odds, self.length, prior, self.shape)
        start = prior > 0
        return descent(start, forces)[0] if self.way == "descent" else threshold_dynamics(start, forces)

    def _taught(self, known: Densities | None, sight: Sight, v: int, silhouette: Mask) -> Densities | None:
        found = self._model(sight, v, silhouette)
        if found is None:
            return known
        _, codes, prior = found
        near = prior > -self.around_px / self._factor(silhouette)
        newer = densities(codes, prior > 0, near & (prior <= 0))
        return known if newer is None else newer if known is None else known.mixed(newer, self.news)

    def _model(self, sight: Sight, v: int, silhouette: Mask) -> tuple[Region, Codes, Array32] | None:
        """Where to look, what is seen there, and the signed distance to the model's outline; None without either."""
        image = sight.frame.images[v]
        if image is None or not silhouette.any():
            return None
        factor = self._factor(silhouette)
        wanted = _aligned(silhouette, int(self.around_px) + 2 * factor, factor)
        key = LevelSetEvidence, factor, self.texture
        region, codes = sight.once(key, v, wanted, partial(_encoded, image, factor, self.texture))
        x, y, width, height = region
        inside = silhouette[y : y + height : factor, x : x + width : factor]
        return (
            region,
            codes,
            signed_distance(inside[: height // factor, : width // factor], 2 * self.around_px / factor),
        )

    def _factor(self, silhouette: Mask) -> int:
        longest: int = max(silhouette.shape)
        return max(1, round(longest / self.longest_px))


def _aligned(silhouette: Mask, margin: int, factor: int) -> Region:
    """The box of a silhouette with a margin, inside the image, its sides multiples of the factor."""
    x, y, width, height = cv2.boundingRect(silhouette.view(np.uint8))
    left, top = max(x - margin, 0) // factor * factor, max(y - margin, 0) // factor * factor
    right, bottom = min(x + width + margin, silhouette.shape[1]), min(y + height + margin, silhouette.shape[0])
    return left, top, (right - left) // factor * factor, (bottom - top) // factor * factor


def _encoded(image: Image, factor: int, texture: bool, region: Region) -> tuple[Region, Codes]:
    """The features of a part of an image made smaller."""
    x, y, width, height = region
    part = image[y : y + height, x : x + width]
    if factor > 1:
        part = cv2.resize(part, (width // factor, height // factor), interpolation=cv2.INTER_AREA)
    return region, (colour_codes(part), texture_codes(part)) if texture else (colour_codes(part),)
