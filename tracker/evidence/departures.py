"""Evidence of departures: where the person has come to be seen before a background that earlier frames have shown."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import cv2
import numpy as np
import pydantic

from tracker.account import Account
from tracker.arrays import Array, Array32, Image, Mask, Region, frozen
from tracker.comparison import Comparison
from tracker.components import component
from tracker.contours import Contours
from tracker.equations import Equations
from tracker.evidence import GUESSED, Evidence, Memory
from tracker.evidence._shares import over_views
from tracker.evidence.silhouettes import Foregrounds, covered_by
from tracker.expectation import expected_samples, region_around
from tracker.imaging.densities import Densities, colour_codes, densities
from tracker.scene import Scene
from tracker.sight import Sight
from tracker.synthesis.cpu import CpuSynthesis

_SMALL_PX = 180
"""The longer side of an image is brought to about this: a forearm is then 5 px wide, and noise is a quarter."""

_LEAST_SHARE = 0.5
"""Share of the parts that must be trusted for a frame to teach what the person looks like."""

# Opening with it takes single pixels and lines of one away: noise, and the seam between light and shade.
_SQUARE = np.ones((2, 2), np.uint8)


@dataclass(frozen=True)
class Background:
    """What is known of one view: what was seen where the person was not, and how the person looks."""

    picture: Array32
    """(h, w, 3) BGR of the small picture."""

    known: Mask
    """(h, w) pixels that have been seen without the person."""

    n_person: int
    """Pixels of the small picture that the person covers."""

    gaps: Array32
    """(h, w) distance to the person, px of the image."""

    looks: Densities | None
    """Colours of the person and of what is beside it."""


@component
class DeparturesEvidence(Evidence):
    """Places that have changed, have the person's colours and are left bare by the model. Needs no plates.

    Contours only say whether the model's own are in the images. A limb that is taken to be before or behind the trunk,
    where it has no contour to be judged by, stays there, though the images show it elsewhere: there the background of
    earlier frames is covered by something in the person's colours, and the pose has to account for that.
    """

    scale_px: float = pydantic.Field(default=400.0, gt=0)
    """Distance of a pose that leaves as much bare as a person usually covers, px: a forearm in one of four views is
    worth 1 to 2 px, ten times what contours and colours say of where it is when it hides before the trunk."""

    least_levels: float = pydantic.Field(default=24.0, gt=0)
    """Change in a channel from which a pixel departs from what was seen there, grey levels."""

    least_odds: float = pydantic.Field(default=1.0, ge=0)
    """By what factor a colour must be more frequent in the person than beside it to be the person's, its logarithm."""

    around: float = pydantic.Field(default=0.12, ge=0, le=1)
    """So far around the prediction is looked, as a share of an image's longer side."""

    margin_px: float = pydantic.Field(default=14.0, ge=0)
    """So far from the model's outline the background is believed to be background, px of the image."""

    linked_px: float = pydantic.Field(default=28.0, ge=0)
    """A region that comes nowhere so near to the person of the frame before hangs on somebody else, px."""

    most_share: float = pydantic.Field(default=0.25, gt=0)
    """A view in which more than this share of the person has changed shows somebody else who passes."""

    news: float = pydantic.Field(default=0.2, gt=0, le=1)
    """Share of a new frame in what is known: light that changes within seconds is followed."""

    def observe(self, sight: Sight, expected: Contours | None, memory: Memory = None) -> Foregrounds:
        """The places that have changed; none before a frame has taught what was there."""
        n_views = len(sight.frame.images)
        known = (None,) * n_views if memory is None or memory is GUESSED else memory
        masks = tuple(self._departed(sight, v, expected, one) for v, one in enumerate(known))
        cores = [None if mask is None else _core(mask) for mask in masks]
        factors = [_factor(image) for image in sight.frame.images if image is not None]
        regions, pictures, worth, start = [], [np.zeros((0, 2), dtype=np.float32)], [], 0
        for image, core in zip(sight.frame.images, cores, strict=True):
            height, width = (0, 0) if core is None else core.shape
            regions.append((start, width, height))
            bare = 0.0 if core is None else float(core.sum())
            worth.append(np.nan if image is None else bare)
            start += width * height
            if core is not None:
                pictures.append(np.stack([np.zeros(core.size), core.ravel()], axis=-1).astype(np.float32))
        packed = frozen(regions, np.int64), frozen(np.concatenate(pictures), np.float32), frozen(worth)
        return Foregrounds(masks, max(factors, default=1), *packed)

    def distances(self, asked: Comparison, poses: Array) -> Array:
        """(B,) what is left bare, as a share of the person; mean over the views."""
        return over_views(self._per_view(asked, poses), 0.0)

    def equations(self, asked: Comparison, q: Array, gate_px: float) -> Equations:
        """None: what is bare tells that a limb is missing, not which way it has to move."""
        return Equations.nothing(asked.body.dof)

    def account(self, asked: Comparison, q: Array) -> Account:
        """What is bare as contour that is missed, by the limb that is nearest to it."""
        per_view, n_parts = self._per_view(asked, q[None])[0], len(asked.body.parts)
        nothing = np.zeros(n_parts)
        missed = self._missed(asked, q) if np.nansum(asked.observed.worth) else nothing
        distance_px = float(over_views(per_view[None], 0.0)[0])
        return Account(distance_px, per_view, np.full(n_parts, np.nan), nothing, nothing, missed)

    def learned(self, memory: Memory, sight: Sight, scene: Scene, fitted: Contours, trusted: Mask) -> Memory:
        """What is seen beside the persons, and how they look; a running mean of both."""
        known = memory or (None,) * len(scene.rig)
        return tuple(
            self._taught(one, sight, v, small, trusted)
            for v, (one, small) in enumerate(zip(known, _silhouettes(scene, sight), strict=True))
        )

    def _per_view(self, asked: Comparison, poses: Array) -> Array:
        """(B, V) px."""
        seen: Foregrounds = asked.observed
        if not np.nansum(seen.worth):
            return np.tile(seen.worth, (len(poses), 1))
        covered = covered_by(asked, poses)[..., 1]
        own = np.array([max(camera.size[0] * camera.size[1], 1) for camera in asked.scene.rig.cameras])
        sizes = own * _TYPICAL_SHARE / seen.factor**2
        per_view: Array = self.scale_px * (seen.worth - covered) / sizes
        return per_view

    def _missed(self, asked: Comparison, q: Array) -> Array:
        """(P,) outline of what is bare by all limbs that reach it in the image, px.

        Of two hands nobody can tell which one it is, and one that is lost is often not the nearest.
        """
        body, seen = asked.body, asked.observed
        missed = np.zeros(len(body.parts))
        scene = asked.scene.with_pose(asked.person, q)
        rig = scene.rig.downscaled(seen.factor)
        covered = CpuSynthesis().silhouettes(replace(scene, rig=rig))
        places = scene.world_from_parts()[0][asked.own, :3, 3]
        radii, halves = scene.shapes[asked.own, :2].min(axis=1), scene.shapes[asked.own, 2]
        limbs = [np.flatnonzero(body.parts_of(group)) for group in body.fine_groups if body.partner_of(group)]
        for camera, mask, model in zip(rig.cameras, seen.masks, covered, strict=True):
            if mask is None or not limbs:
                continue
            thick = _core(mask & ~model[: mask.shape[0], : mask.shape[1]])
            rows, columns = np.nonzero(thick > 0.5)
            depths = camera.in_camera(places)[:, 2]
            if not len(rows) or (depths <= 0).any():
                continue
            gaps = np.linalg.norm(np.stack([columns, rows], axis=-1)[:, None] - camera.project(places)[None], axis=2)
            # a strip of a limb's width has two sides
            lengths = seen.factor / np.maximum(camera.matrix[0, 0] * radii / depths, 1.0)
            for parts in limbs:
                reach_m = (2 * halves[parts]).sum() - halves[parts[0]]
                which = gaps[:, parts[0]] <= camera.matrix[0, 0] * reach_m / depths[parts[0]]
                nearest = parts[gaps[:, parts].argmin(axis=1)]
                np.add.at(missed, nearest[which], (lengths[nearest] * thick[rows, columns])[which])
        return missed

    def _departed(self, sight: Sight, v: int, expected: Contours | None, known: Background | None) -> Mask | None:
        image = sight.frame.images[v]
        if image is None or known is None or known.looks is None:
            return None
        small = _small(sight, v, image)
        departs = _departs(small, known, self.least_levels) & (
            known.looks.log_odds((colour_codes(small),)) > self.least_odds
        )
        if expected is not None:
            size = image.shape[1], image.shape[0]
            x, y, width, height = region_around(expected_samples(expected, v), size, self.around * max(size))
            near, factor = np.zeros_like(departs), _factor(image)
            near[y // factor : (y + height) // factor + 1, x // factor : (x + width) // factor + 1] = True
            departs &= near
        found: Mask = cv2.morphologyEx(departs.view(np.uint8), cv2.MORPH_OPEN, _SQUARE) > 0
        found = _linked(found, known.gaps < self.linked_px)
        return None if np.count_nonzero(found) > self.most_share * known.n_person else found

    def _taught(
        self, known: Background | None, sight: Sight, v: int, silhouette: Mask, trusted: Mask
    ) -> Background | None:
        image = sight.frame.images[v]
        if image is None or trusted.mean() < _LEAST_SHARE:
            return known
        small, factor = _small(sight, v, image), _factor(image)
        silhouette = silhouette[: small.shape[0], : small.shape[1]]
        gaps = cv2.distanceTransform((~silhouette).astype(np.uint8), cv2.DIST_L2, 3) * factor
        codes, n_person = (colour_codes(small),), int(np.count_nonzero(silhouette))
        newer = densities(codes, silhouette, (gaps > 0) & (gaps < self.around * max(image.shape[:2])))
        if known is None:
            return Background(frozen(small, np.float32), frozen(gaps > self.margin_px, np.bool_), n_person, gaps, newer)
        looks = newer if known.looks is None else known.looks if newer is None else known.looks.mixed(newer, self.news)
        person = np.zeros_like(silhouette) if looks is None else looks.log_odds(codes) > self.least_odds
        away = (gaps > self.margin_px) & ~(known.known & person & _departs(small, known, self.least_levels))
        fresh = away & ~known.known & trusted.all()
        picture = known.picture.copy()
        picture[fresh] = small[fresh]
        old = away & known.known
        picture[old] += np.float32(self.news) * (small[old] - picture[old])
        return Background(frozen(picture, np.float32), frozen(known.known | fresh, np.bool_), n_person, gaps, looks)


_TYPICAL_SHARE = 0.05
"""Share of a view that a person covers, usually."""


def _departs(small: Image, known: Background, least_levels: float) -> Mask:
    """(h, w) pixels that have changed."""
    change = np.abs(small - known.picture).max(axis=2)
    found: Mask = known.known & (change > least_levels)
    return found


def _core(mask: Mask) -> Array32:
    """(h, w) worth of covering each pixel, 0 to 1: the rim is that of clothes, which the parts of a model are not."""
    inwards = cv2.distanceTransform(mask.astype(np.uint8), cv2.DIST_L2, 3)
    worth: Array32 = np.clip((inwards - 0.5) / 1.5, 0, 1).astype(np.float32)
    return worth


def _linked(mask: Mask, near: Mask) -> Mask:
    """(h, w) the regions of a mask that reach into another one."""
    _, labels = cv2.connectedComponents(mask.astype(np.uint8))
    kept: Mask = np.isin(labels, np.unique(labels[near & mask])) & mask
    return kept


def _silhouettes(scene: Scene, sight: Sight) -> tuple[Mask, ...]:
    """(h, w) what the persons cover of the small pictures."""
    factor = max((_factor(image) for image in sight.frame.images if image is not None), default=1)
    return CpuSynthesis().silhouettes(replace(scene, rig=scene.rig.downscaled(factor)))


def _factor(image: Image) -> int:
    longest: int = max(image.shape[:2])
    return max(1, round(longest / _SMALL_PX))


def _small(sight: Sight, v: int, image: Image) -> Image:
    """The image made smaller."""
    whole = 0, 0, image.shape[1], image.shape[0]
    found: Image = sight.once(DeparturesEvidence, v, whole, partial(_resized, image))[1]
    return found


def _resized(image: Image, region: Region) -> tuple[Region, Image]:
    factor = _factor(image)
    size = image.shape[1] // factor, image.shape[0] // factor
    whole = image[: size[1] * factor, : size[0] * factor]
    small: Image = cv2.resize(whole, size, interpolation=cv2.INTER_AREA)
    return region, small
