"""Evidence of silhouettes: the foreground that the model covers, and its cover beside the foreground."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np
import pydantic

from tracker.bodies.contours import Contours, expected_region
from tracker.evidence import Evidence, EvidencePicture, Memory
from tracker.evidence._bare import SmallPictures
from tracker.evidence._shares import UNKNOWN, over_views, shares
from tracker.evidence.measures.account import Account
from tracker.evidence.measures.correspondences import Equations
from tracker.evidence.measures.outlines import Comparison, on_outline, outline_observation
from tracker.evidence.similarity.chamfer import ChamferSimilarity
from tracker.foundation.arrays import Array, Array32, Mask, frozen
from tracker.foundation.configuration.components import component
from tracker.images.sight import Observation, Sight
from tracker.kernels.pictures import cover_shares

# The longer side of an image is brought to about this for the overlap, px: a quarter of 720.
_SMALL_PX = 180

_STEP = 0.955
"""Distance that `cv2.distanceTransform` gives two pixels side by side, of its 3 x 3 mask: no two are nearer."""


@dataclass(frozen=True, eq=False)
class Foregrounds(SmallPictures):
    """The moving foreground of all V views.

    One of the two pictures is the cost of covering a pixel, the other its worth.
    """

    masks: tuple[Mask | None, ...]
    """(H, W) each; None if image or plate is missing."""

    worth: Array
    """(V,) sum of the worth; 0 without a foreground."""

    least: Array
    """(V,) least divisor of distances, in the unit of `worth`."""

    unknown: tuple[Mask | None, ...] = ()
    """(H, W) unknown pixels of each view; None, or no views, for none."""

    @cached_property
    def outlines(self) -> Observation:
        """The outlines of the foregrounds as edges."""
        return outline_observation(self.masks, self.unknown)


@component
class SilhouetteEvidence(Evidence):
    """The foreground that a pose leaves bare, and its cover beyond; needs background plates.

    A displaced limb lies outside the foreground, however many edges lie around it: in a search this term finds limbs
    that edges alone lose. A refinement moves the model's outline to that of the foreground.
    """

    scale_px: float = pydantic.Field(default=10.0, gt=0)
    """Distance of a pose that covers nothing of the foreground, px."""

    reach_px: float = pydantic.Field(default=20.0, gt=0)
    """A pixel this far outside of the foreground, or farther, costs as much as one inside is worth, px."""

    direction_deg: float = pydantic.Field(default=40.0, gt=0, le=90)
    """Largest angle between the outlines of model and foreground in a refinement, degrees."""

    votes: bool = False
    """Pair a segment of the foreground's outline with only one limb in a refinement; see `similarity.chamfer`."""

    explained_px: float = pydantic.Field(default=5.0, gt=0)
    """A sample of the model's outline this close to the foreground's counts as explained, px."""

    missed_px: float = pydantic.Field(default=10.0, gt=0)
    """An outline of the foreground farther than this from all of the model's counts as missed, px."""

    # See docs/lab/acquired_starts.md.
    least_share: float = pydantic.Field(default=0.3, ge=0, le=1)
    """Least size of a foreground in the distance, as a share of the model's earlier cover. Beside
    a person who stays, plates made from the recording showed only a fingertip in some views: left bare it cost as much
    as a whole person, and held a bending arm straight for 8 frames. With 0.05 joints of four recordings are the same,
    except that one has an arm in doubt in 34 of 270 frames instead of 16."""

    margin_px: float = pydantic.Field(default=48.0, ge=0)
    """Margin of the search for foreground around the expected contours, px."""

    def look(self, sight: Sight, around: Contours) -> None:
        """Prepares the foregrounds that other evidence has found in advance."""
        masks = tuple(map(sight.silhouette, range(len(sight.plates))))
        if any(mask is not None for mask in masks):
            self._ready(sight, masks)

    def observe(self, sight: Sight, expected: Contours | None, memory: Memory = None) -> Foregrounds:
        """The foreground near the expected pose; see `tracker.evidence.Evidence.observe`."""
        return self._ready(sight, tuple(self._mask(sight, expected, v) for v in range(len(sight.plates))))

    def _ready(self, sight: Sight, masks: tuple[Mask | None, ...]) -> Foregrounds:
        """Masks (H, W) of all views, prepared once."""
        views = range(len(masks))
        told = tuple(map(sight.unknown, views)), tuple(map(sight.model_px, views))
        ready: Foregrounds = sight.joined(self, masks, lambda _: self.seen(masks, *told))
        return ready

    def seen(
        self,
        masks: tuple[Mask | None, ...],
        unknown: tuple[Mask | None, ...] = (),
        model_px: tuple[float | None, ...] = (),
    ) -> Foregrounds:
        """Foregrounds prepared for comparison.

        Args:
            masks: (H, W) of each view; None for a view without one.
            unknown: (H, W) pixels of each view without cost and worth; None for none.
            model_px: cover of the persons shortly before in each view, px; None if unknown.
        """
        longest = max((max(mask.shape) for mask in masks if mask is not None), default=_SMALL_PX)
        factor = max(1, round(longest / _SMALL_PX))
        regions, pictures, worth, start = [], [np.zeros((0, 2), dtype=np.float32)], [], 0
        for mask, open_to_doubt in zip(masks, unknown or (None,) * len(masks), strict=True):
            picture = None if mask is None else self._picture(mask, open_to_doubt, factor)
            height, width = (0, 0) if picture is None else picture.shape[:2]
            regions.append((start, width, height))
            worth.append(0.0 if picture is None else float(picture[..., 1].sum()))
            start += width * height
            if picture is not None:
                pictures.append(picture.reshape(-1, 2))
        packed = frozen(regions, np.int64), frozen(np.concatenate(pictures), np.float32)
        least = self.least_share * np.array([pixels or 0.0 for pixels in model_px or (None,) * len(masks)]) / factor**2
        return Foregrounds(factor, *packed, masks, frozen(worth), frozen(least), unknown)

    def distances(self, asked: Comparison, poses: Array) -> Array:
        """(B,) bare foreground and cover beside it, as shares of the foreground; mean over the views."""
        return over_views(self._per_view(asked, poses), 0.0)

    def equations(self, asked: Comparison, q: Array, gate_px: float) -> Equations:
        """Outline against outline; see `tracker.evidence.Evidence.equations`."""
        outlines = asked.put(asked.observed.outlines).with_contours(q, self._outer(asked, q))
        return ChamferSimilarity(direction_deg=self.direction_deg, votes=self.votes).equations(outlines, q, gate_px)

    def account(self, asked: Comparison, q: Array) -> Account:
        """The model's outline on the foreground's, and the part of that it misses."""
        per_view = self._per_view(asked, q[None])
        near_px, distances = (self.explained_px, self.missed_px), (float(over_views(per_view, 0.0)[0]), per_view[0])
        outer, n_parts = self._outer(asked, q), len(asked.scene.shapes)
        return shares(outer, asked.observed.outlines, n_parts, near_px, distances).of(asked.own)

    def pictures(self, asked: Comparison, sight: Sight, view: int) -> tuple[EvidencePicture, ...]:
        """The foreground white, shadows and other changes grey, pixels unknown to the plate blue."""
        image, mask = sight.frame.images[view], asked.observed.masks[view]
        if image is None or mask is None:
            return (EvidencePicture("silhouettes: no foreground, because the plate is missing or not trusted", None),)
        changes = sight.changes(view, (0, 0, image.shape[1], image.shape[0]))
        unknown = sight.unknown(view)
        picture = np.zeros(image.shape, dtype=np.uint8)
        if changes is not None:
            picture[changes.moving] = 110
        if unknown is not None:
            picture[unknown] = UNKNOWN
        picture[mask] = 255
        return (EvidencePicture("foreground", picture),)

    def _per_view(self, asked: Comparison, poses: Array) -> Array:
        """(B, V) px; NaN for a view without a foreground."""
        seen: Foregrounds = asked.observed
        if not seen.worth.any():
            return np.full((len(poses), len(seen.worth)), np.nan)
        sums = seen.covered_by(asked, poses)
        worth = np.where(seen.worth > 0, seen.worth, np.nan)
        per_view: Array = self.scale_px * (sums[..., 0] + worth - sums[..., 1]) / np.maximum(worth, seen.least)
        return per_view

    def _outer(self, asked: Comparison, q: Array) -> Contours:
        """The contours of a pose (dof,) except those before another part of the model."""
        contours, scene = asked.fine(q), asked.scene.with_pose(asked.person, q)
        positions = contours.positions.copy()
        positions[0, ..., 4] = np.where(on_outline(contours, scene, asked.synthesis), positions[0, ..., 4], 0)
        return replace(contours, positions=positions)

    def _mask(self, sight: Sight, expected: Contours | None, v: int) -> Mask | None:
        image = sight.frame.images[v]
        if image is None:
            return None
        size = image.shape[1], image.shape[0]
        region = (0, 0, *size) if expected is None else expected_region(expected, v, size, self.margin_px)
        changes = sight.changes(v, region)
        return None if changes is None else changes.silhouette

    def _picture(self, mask: Mask, unknown: Mask | None, factor: int) -> Array32 | None:
        """(h, w, 2) cost and worth of covering each pixel of a small picture; the rim of the foreground counts less.

        None without a foreground pixel: specks alone have no distance.
        """
        inside = _smaller(mask, factor) >= 0.5
        if not inside.any():
            return None
        free = inside if unknown is None else inside | (_smaller(unknown, factor) > 0)
        picture = np.zeros((*inside.shape, 2), dtype=np.float32)
        picture[..., 0] = 1
        near = _around(free, math.ceil((self.reach_px / factor + 0.75) / _STEP))
        inside, free, cost, worth = inside[near], free[near], picture[near][..., 0], picture[near][..., 1]
        outwards = factor * cv2.distanceTransform((~free).view(np.uint8), cv2.DIST_L2, 3)
        inwards = cv2.distanceTransform(inside.astype(np.uint8), cv2.DIST_L2, 3)
        np.clip((outwards - 0.75 * factor) / self.reach_px, 0, 1, out=cost)
        np.multiply(inside, np.minimum(inwards / 2, 1), out=worth)
        return picture


def _around(mask: Mask, margin: int) -> tuple[slice, slice]:
    """The box of a mask (h, w) that is not empty, wider by so many pixels on all sides, inside the image."""
    x, y, width, height = cv2.boundingRect(mask.view(np.uint8))
    return slice(max(y - margin, 0), y + height + margin), slice(max(x - margin, 0), x + width + margin)


def _smaller(mask: Mask, factor: int) -> Array32:
    """(h, w) share of each pixel of a small picture that a mask (H, W) covers."""
    height, width = (length // factor for length in mask.shape)
    small = np.empty((height, width), dtype=np.float32)
    cover_shares(mask, factor, small)
    return small
