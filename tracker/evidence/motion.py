"""Evidence of motion in the images: texture on clothes and skin moves with the part that carries it.

Contours show neither the turn of a round trunk about its axis, nor an arm before a trunk of the same colour. T. Brox,
B. Rosenhahn, J. Gall and D. Cremers, Combined region and motion-based 3D tracking of rigid and articulated objects,
PAMI 2010, add optical flow to regions for that; here it is the flow of textured places (Lucas & Kanade 1981).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import cv2
import numpy as np
import pydantic

from tracker.bodies.contours import Contours
from tracker.bodies.scene import Scene
from tracker.evidence import GUESSED, Evidence, EvidencePicture, Memory
from tracker.evidence._anchors import Anchors, Grey, attached, corners, seen_parts
from tracker.evidence._shares import gaps_picture, over_views
from tracker.evidence.measures.account import Account
from tracker.evidence.measures.correspondences import Equations
from tracker.evidence.measures.outlines import Comparison
from tracker.foundation.arrays import Array, Mask
from tracker.foundation.configuration.components import component
from tracker.images.sight import Sight
from tracker.kernels.body import anchor_equations, gaps_of
from tracker.kernels.descent import Kinds, Places
from tracker.kernels.rows import CarriedPlaceRow

_FACING = 0.1
"""Least cosine between a place's surface normal and the camera: beyond it the place is something else."""

# See docs/lab/motion.md.
_MARGIN_PX = 3
"""Least distance of a new place from the boundary of its visible part, px: near it the place may lie behind the part.
Without a distance between parts an arm was off in 9 to 13 frames from one start."""


@dataclass(frozen=True, eq=False)
class Remembered:
    """Knowledge after a frame: its images, and the places on them."""

    images: tuple[Grey | None, ...]
    """(H, W) of each view."""

    placements: Array
    """(P, 4, 4) the scene's parts in the world."""

    anchors: Anchors
    """Places of all views, including those without a person."""

    n_renewed: tuple[int, ...]
    """Number of places of each view when it last got new ones."""


@dataclass(frozen=True)
class ObservedMotion:
    """Positions of the earlier places in this frame."""

    seen: tuple[bool, ...]
    """Views that are not missing."""

    anchors: Anchors
    """Those on parts."""

    shares: Array
    """(N,) weights."""

    _own: dict[int, tuple[Anchors, Array]] = field(default_factory=dict, repr=False, compare=False)

    def of(self, asked: Comparison) -> tuple[Anchors, Array]:
        """Those on a person, and their weights."""
        if asked.person not in self._own:
            parts = self.anchors.parts
            rows = np.flatnonzero((parts >= asked.own.start) & (parts < asked.own.stop))
            self._own[asked.person] = self.anchors.chosen(rows), self.shares[rows]
        return self._own[asked.person]


@component
class MotionEvidence(Evidence):
    """Textured places on the persons, followed from one image to the next.

    A place was attached at a pose, so it confirms no pose: it is used beside other kinds of evidence, in refinements.
    It is silent in a first frame.
    """

    window_px: int = pydantic.Field(default=11, ge=5, le=31)
    """Side of the compared window around a place, px; arms are 20 to 25 px wide at 720x576."""

    spacing_px: int = pydantic.Field(default=8, ge=2)
    """Least distance of new places from others in an image, px."""

    facing: float = pydantic.Field(default=0.5, gt=0, lt=1)
    """Least cosine between surface normal and camera for new places."""

    surface_m: float = pydantic.Field(default=0.015, gt=0)
    """Standard deviation of the model's surface from the true one, metres: the depth of a place."""

    slide_m: float = pydantic.Field(default=0.008, gt=0)
    """Standard deviation of a place against the rigid part that carries it, metres: clothes slide, skin stretches."""

    drift_px: float = pydantic.Field(default=0.15, gt=0)
    """Standard deviation of following from one image to the next, px: places followed for long are less sure."""

    observations: float = pydantic.Field(default=8.0, gt=0)
    """Most independent observations of the places on a part in a view."""

    reach_px: float = pydantic.Field(default=3.0, gt=0)
    """A place that is off by this, or by three standard deviations, has a quarter of its weight: places on a wrong limb
    must not hold it there."""

    outlier_sigmas: float = pydantic.Field(default=4.0, gt=0)
    """A place farther than this from its position by the part disagrees, standard deviations."""

    patience: int = pydantic.Field(default=2, ge=1)
    """Consecutive frames in which a place may disagree before it is dropped."""

    def look(self, sight: Sight, around: Contours) -> None:
        """Makes the images grey ahead."""
        for v in range(len(sight.frame.images)):
            _grey(sight, v)

    def observe(self, sight: Sight, expected: Contours | None, memory: Memory = None) -> ObservedMotion:
        """Follows the places into the frame; see `tracker.evidence.Evidence.observe`."""
        anchors = Anchors.none() if memory is None or memory is GUESSED else self._followed(memory, sight)
        anchors = anchors.chosen(anchors.parts >= 0)
        seen = tuple(one is not None for one in sight.frame.images)
        return ObservedMotion(seen, anchors, anchors.shares(self.observations))

    def distances(self, asked: Comparison, poses: Array) -> Array:
        """(B,) mean distance of places from their positions by the parts, over places and views, px; 0 without any."""
        return over_views(self._per_view(asked, poses), 0.0)

    def equations(self, asked: Comparison, q: Array, gate_px: float) -> Equations:
        """Brings the parts to their places in the images, robustly weighted (Geman & McClure)."""
        anchors, shares = asked.observed.of(asked)
        if not len(shares):
            return Equations.nothing(asked.body.dof)
        placements = asked.placements(q[None])
        found = anchors.residuals(placements, asked.scene.rig, self.slide_m)
        squares, variances = (
            found[:, CarriedPlaceRow.U] ** 2 + found[:, CarriedPlaceRow.W] ** 2,
            found[:, CarriedPlaceRow.VARIANCE],
        )
        scale = min(0.5 * gate_px, self.reach_px) ** 2 + 9 * variances
        weights = (
            (1 + squares / scale) ** -2
            * shares
            * ((found[:, CarriedPlaceRow.FACING] > _FACING) & (anchors.strikes == 0))
            / variances
        )
        put = placements, anchors.carried, found, weights, asked.ends, asked.twists(q), asked.body.moves
        return Equations(*anchor_equations(*put))

    def kinds(self, asked: Comparison) -> Kinds | None:
        """The places on the person; empty without any."""
        if type(self) is not MotionEvidence:
            return None
        anchors, shares = asked.observed.of(asked)
        if not len(shares):
            return Kinds(most_silent=1.0)
        counted = np.where(anchors.strikes == 0, shares, 0.0)
        return Kinds(places=Places(1.0, 0.0, anchors.carried, counted, self.slide_m, self.reach_px, _FACING))

    def pictures(self, asked: Comparison, sight: Sight, view: int) -> tuple[EvidencePicture, ...]:
        """Places where the image shows them, with a line to their position by the pose; red if that is too far."""
        image, (anchors, _) = sight.frame.images[view], asked.observed.of(asked)
        anchors = anchors.chosen(anchors.views == view)
        if image is None or not len(anchors.parts):
            return (EvidencePicture("motion: follows no place in this view from the frame before", None),)
        found = anchors.residuals(asked.scene.world_from_parts(), asked.scene.rig, self.slide_m)
        gaps = found[:, [CarriedPlaceRow.U, CarriedPlaceRow.W]]
        off = (gaps**2).sum(axis=1) > 2 * self.outlier_sigmas**2 * found[:, CarriedPlaceRow.VARIANCE]
        picture = gaps_picture(image, anchors.pixels, anchors.pixels + gaps, off)
        return (EvidencePicture("places followed, and their positions by the pose", picture),)

    def account(self, asked: Comparison, q: Array) -> Account:
        """The distance alone: places attached at a pose explain nothing."""
        nothing, per_view = np.zeros(len(asked.body.parts)), self._per_view(asked, q[None])
        distance_px = float(over_views(per_view, 0.0)[0])
        return Account(distance_px, per_view[0], np.full(len(nothing), np.nan), nothing, nothing, nothing)

    def learned(self, memory: Memory, sight: Sight, scene: Scene, fitted: Contours, trusted: Mask) -> Remembered:
        """The places after a frame: those that left their parts are dropped, new ones attached to trusted parts.

        The view that has lost most since it got new ones gets them again, whatever the order of the views; a view
        without any gets them at once. A place that stands still while its part moves on is before the part: it stays,
        without a part, as long as it is visible, so that nothing is attached there again.
        """
        known = None if memory is None or memory is GUESSED else memory
        images = tuple(_grey(sight, v) for v in range(len(sight.frame.images)))
        placements = scene.world_from_parts()
        kept, n_renewed = Anchors.none(), (0,) * len(images)
        if known is not None:
            n_renewed = known.n_renewed
            followed = self._followed(known, sight)
            foreign = followed.chosen((followed.parts < 0) & followed.standing)
            kept = self._judged(followed.chosen(followed.parts >= 0), scene, trusted).joined(foreign)
        groups = [kept.chosen(kept.views == v) for v in range(len(images))]
        gone = {v: n_renewed[v] - len(groups[v].parts) for v, image in enumerate(images) if image is not None}
        for v, image in enumerate(images):
            if image is not None and (not len(groups[v].parts) or gone[v] == max(gone.values())):
                groups[v] = self._replenished(v, image, groups[v], scene, trusted)
                n_renewed = (*n_renewed[:v], len(groups[v].parts), *n_renewed[v + 1 :])
        kept = Anchors.none().joined(*groups)
        if known is not None:
            kept = replace(kept, ahead=_moved(kept, known.placements[None], placements, scene))
        return Remembered(images, placements[0], kept, n_renewed)

    def _followed(self, memory: Remembered, sight: Sight) -> Anchors:
        """The places of the frame before in this one; found once."""

        def find(_: object) -> Anchors:
            groups = []
            for v, before in enumerate(memory.images):
                now = _grey(sight, v)
                if before is not None and now is not None:
                    groups.append(memory.anchors.followed(v, before, now, self.window_px, self.drift_px))
            return Anchors.none().joined(*groups)

        return sight.joined((MotionEvidence, self.window_px, self.drift_px), (memory,), find)

    def _judged(self, anchors: Anchors, scene: Scene, trusted: Mask) -> Anchors:
        """Places at the poses of a frame, except those that left their parts; places that block a part lose it."""
        found = anchors.residuals(scene.world_from_parts(), scene.rig, self.slide_m)
        squares = found[:, CarriedPlaceRow.U] ** 2 + found[:, CarriedPlaceRow.W] ** 2
        blocking = anchors.standing & (squares > self.reach_px**2)
        off = (squares / (2 * found[:, CarriedPlaceRow.VARIANCE]) > self.outlier_sigmas**2) | blocking
        strikes = np.where(off, anchors.strikes + 1, 0)
        kept = (
            (strikes < self.patience)
            & trusted[anchors.views, anchors.parts]
            & (found[:, CarriedPlaceRow.FACING] > _FACING)
        )
        foreign = blocking & (strikes >= self.patience)
        judged = replace(anchors, strikes=strikes, parts=np.where(foreign, -1, anchors.parts))
        return judged.chosen(kept | foreign)

    def _replenished(self, view: int, image: Grey, anchors: Anchors, scene: Scene, trusted: Mask) -> Anchors:
        """The places of a view without those that are covered now, and new ones between them."""
        shown = seen_parts(scene, view)
        anchors = anchors.chosen((shown.at(anchors.pixels) == anchors.parts) | (anchors.parts < 0))
        where = shown.inner(_MARGIN_PX, trusted[view])
        pixels = corners(image, where, shown.corner, anchors.pixels, self.spacing_px)
        parts = shown.at(pixels)
        fresh = attached(scene, view, pixels, parts, self.facing, (self.surface_m, self.drift_px))
        return anchors.joined(fresh)

    def _per_view(self, asked: Comparison, poses: Array) -> Array:
        """(B, V) mean distance, px; NaN for a view without places."""
        anchors, _ = asked.observed.of(asked)
        gaps = np.empty((len(poses), len(anchors.parts)))
        most_m = self.outlier_sigmas * float(np.hypot(self.slide_m, self.surface_m))
        gaps_of(asked.placements(poses), asked.scene.rig.packed, anchors.carried, most_m, gaps)
        per_view = np.full((len(poses), len(asked.scene.rig)), np.nan)
        for v, there in enumerate(asked.observed.seen):
            own = anchors.views == v
            if there and own.any():
                per_view[:, v] = gaps[:, own].mean(axis=1)
        return per_view


def _grey(sight: Sight, view: int) -> Grey | None:
    """The image of a view in grey, made once."""
    image = sight.frame.images[view]
    if image is None:
        return None
    whole = (0, 0, image.shape[1], image.shape[0])
    grey: Grey = sight.once(_grey, view, whole, lambda _: cv2.cvtColor(image, cv2.COLOR_BGR2GRAY))
    return grey


def _moved(anchors: Anchors, before: Array, after: Array, scene: Scene) -> Array:
    """(N, 2) how far parts moved the places from placements (1, P, 4, 4) to others, px."""
    moved, own = np.zeros_like(anchors.pixels), anchors.parts >= 0
    carried = anchors.chosen(own)
    ends = [
        carried.residuals(placements, scene.rig, 0.0)[:, [CarriedPlaceRow.U, CarriedPlaceRow.W]]
        for placements in (before, after)
    ]
    moved[own] = ends[1] - ends[0]
    return moved
