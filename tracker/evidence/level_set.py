"""Evidence of contours by level sets, without clean plates (Rosenhahn et al. 2006, sections 2.1 and 3.1)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import cv2
import numpy as np
import pydantic

from tracker.bodies.contours import Contours
from tracker.bodies.scene import Scene
from tracker.evidence import GUESSED, EvidencePicture, Memory, Observed
from tracker.evidence._around import Around, Channels, Reach, around
from tracker.evidence.measures.account import Account
from tracker.evidence.measures.correspondences import Equations
from tracker.evidence.measures.outlines import Comparison
from tracker.evidence.silhouettes import Foregrounds, SilhouetteEvidence
from tracker.foundation.arrays import Array, Mask
from tracker.foundation.configuration.components import component
from tracker.images.operations.level_set import Densities, Forces, descent, threshold_dynamics
from tracker.images.sight import Sight
from tracker.synthesis.cpu import CpuSynthesis

_STRANGE = 4.0
"""Bound on the odds against the person of pixels beyond the reach: a pixel can prove no more."""

_LEAST_SHARE, _MOST_SHARE = 0.5, 2.0
"""A region with fewer or more of the model's pixels than this is another thing's: the view does not count."""

_TRUSTED = 0.5
"""Share of the parts that must be trusted for the frame to teach."""

_APART = np.ones((3, 3), dtype=np.uint8)
"""Least difference of two contours that are apart, px of the small picture."""

Learned = tuple[Densities | None, ...]
"""Knowledge of each view."""


@dataclass(frozen=True, eq=False)
class ObservedLevels:
    """The images of a frame; the first question, which gives the expected pose, finds the contours."""

    sight: Sight
    memory: Learned | None
    blind: bool
    """Whether there is no expected pose, or only a guess: a contour drawn towards it would confirm it."""

    _found: list[Foregrounds] = field(default_factory=list, repr=False)

    def foregrounds(self, scene: Scene, by: LevelSetEvidence) -> Foregrounds:
        """The regions of all persons of a scene near the predicted poses."""
        if not self._found:
            self._found.append(by.seen(*by.drawn(self, scene)))
        return self._found[0]


@component
class LevelSetEvidence(SilhouetteEvidence):
    """The outline of the region in the persons' colours, against the outline of the model; needs no plates.

    A contour starts at the model's outline and moves to where colours inside and outside differ most, held by its
    length and by the model's shape (eq. 4). `estimation = { use = "coupled" }` alternates it with the pose.
    """

    way: Literal["threshold_dynamics", "descent"] = "threshold_dynamics"
    """Minimization of the energy; `descent` is the paper's gradient descent in a narrow band, and slow."""

    length: float = pydantic.Field(default=3.0, ge=0)
    """Weight of the contour's length, odds a px of the small picture."""

    shape: float = pydantic.Field(default=0.03, ge=0)
    """Weight lambda of the model's shape, odds a px^2: 10 px from the model's outline it is worth odds of 1.5."""

    channels: Channels = "appearance"
    """Features of a pixel: its appearance, as in evidence of colours; `colours`, the paper's, blue, green and red; or
    `tensor`, with the structure tensor besides."""

    witness: bool = True
    """Draw a second contour without the model's shape: where only the shape holds the contour, it says nothing about
    the pose, and counts neither for nor against it."""

    adaptations: int = pydantic.Field(default=0, ge=0)
    """Number of alternations in a frame between densities and contour (EM)."""

    around_px: float = pydantic.Field(default=30.0, gt=0)
    """Reach of the region outside of the model's outline, px of the image."""

    longest_px: int = pydantic.Field(default=384, ge=32)
    """Longer side of the examined image: larger ones are made smaller by a whole factor."""

    news: float = pydantic.Field(default=0.2, gt=0, le=1)
    """Share of a new frame in the densities."""

    def look(self, sight: Sight, around: Contours) -> None:
        """Nothing: only a question gives the expected pose."""

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
        """(B,) bare part of the region and cover beside it; see `SilhouetteEvidence.distances`."""
        return super().distances(self._put(asked), poses)

    def equations(self, asked: Comparison, q: Array, gate_px: float) -> Equations:
        """Outline against zero level; see `tracker.evidence.Evidence.equations`."""
        return super().equations(self._put(asked), q, gate_px)

    def account(self, asked: Comparison, q: Array) -> Account:
        """The model's outline on the zero level, and the part of that it misses; not view by view.

        A part that a zero level drawn from the pose itself leaves out is not hidden in that view: a pelvis was then
        left out of one, and the man was lost within four frames.
        """
        return replace(super().account(self._put(asked), q), by_view_px=None)

    def pictures(self, asked: Comparison, sight: Sight, view: int) -> tuple[EvidencePicture, ...]:
        """The region inside of the zero level; see `SilhouetteEvidence.pictures`."""
        return super().pictures(self._put(asked), sight, view)

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
        """(H, W) the region of the persons in every view; see `drawn`."""
        return self.drawn(seen, scene)[0]

    def drawn(self, seen: ObservedLevels, scene: Scene) -> tuple[tuple[Mask | None, ...], tuple[Mask | None, ...]]:
        """(H, W) the region of the persons in every view, and where only the model's shape holds it.

        None if there is none.

        Args:
            seen: the frame, and the knowledge.
            scene: the persons near the expected poses.
        """
        if seen.blind:
            return ((None,) * len(scene.rig),) * 2
        known = seen.memory or (None,) * len(scene.rig)
        silhouettes = CpuSynthesis().silhouettes(scene)
        found = [
            self._region(seen.sight, v, mask, one) for v, (mask, one) in enumerate(zip(silhouettes, known, strict=True))
        ]
        return tuple(region for region, _ in found), tuple(held for _, held in found)

    def _put(self, asked: Comparison) -> Comparison:
        """The question for silhouettes."""
        return replace(asked, observed=asked.observed.foregrounds(asked.scene, self))

    def stages(
        self, sight: Sight, v: int, masks: tuple[Mask, Mask], known: Densities | None, n_steps: Sequence[int]
    ) -> tuple[Mask, ...]:
        """(H, W) the region in a view after each number of steps, for pictures; empty if there is none.

        Args:
            sight: the frame.
            v: number of the view.
            masks: (H, W) the initial contour, and the silhouette that is its shape prior.
            known: densities of the view; None takes those of the prior.
            n_steps: of the chosen minimization.
        """
        found = self._around(sight, v, masks[1])
        known = None if found is None else known or found.taught(found.prior > 0)
        if found is None or known is None:
            return ()
        start, forces = found.cut(masks[0]), self._forces(found, known)
        return tuple(found.uncut(self._drawn(start, forces, n), masks[1].shape) for n in n_steps)

    def _region(
        self, sight: Sight, v: int, silhouette: Mask, known: Densities | None
    ) -> tuple[Mask | None, Mask | None]:
        found = self._around(sight, v, silhouette)
        if found is None:
            return None, None
        start = found.prior > 0
        known = known or found.taught(start)
        if known is None:
            return None, None
        region = self._drawn(start, self._forces(found, known))
        for _ in range(self.adaptations):
            known = found.taught(region) or known
            region = self._drawn(start, self._forces(found, known))
        share = np.count_nonzero(region) / max(int(np.count_nonzero(start)), 1)
        if not _LEAST_SHARE <= share <= _MOST_SHARE:
            return None, None
        shape, held = silhouette.shape, None
        if self.witness:
            alone = self._drawn(start, replace(self._forces(found, known), prior=None))
            apart = cv2.morphologyEx((region ^ alone).view(np.uint8), cv2.MORPH_OPEN, _APART)
            held = found.uncut(apart > 0, shape)
        return found.uncut(region, shape), held

    def _forces(self, seen: Around, known: Densities) -> Forces:
        odds = np.where(seen.near, known.log_odds(seen.codes), np.float32(-_STRANGE))
        return Forces(odds, self.length, seen.prior, self.shape)

    def _drawn(self, start: Mask, forces: Forces, n_steps: int | None = None) -> Mask:
        """The region of a contour drawn from a start, until it rests or for so many steps."""
        most = {} if n_steps is None else {"n_steps": n_steps}
        return descent(start, forces, **most)[0] if self.way == "descent" else threshold_dynamics(start, forces, **most)

    def _taught(self, known: Densities | None, sight: Sight, v: int, silhouette: Mask) -> Densities | None:
        found = self._around(sight, v, silhouette)
        if found is None:
            return known
        newer = found.taught(found.prior > 0)
        return known if newer is None else newer if known is None else known.mixed(newer, self.news)

    def _around(self, sight: Sight, v: int, silhouette: Mask) -> Around | None:
        factor = max(1, round(max(silhouette.shape) / self.longest_px))
        return around(sight, v, silhouette, Reach(self.around_px, factor, self.channels))
