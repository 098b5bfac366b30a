"""Evidence of departures: places where the person now covers a background that earlier frames have shown."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import cv2
import numpy as np
import pydantic

from tracker.bodies.contours import Contours, expected_region
from tracker.bodies.scene import Scene
from tracker.evidence import GUESSED, Evidence, EvidencePicture, Memory
from tracker.evidence._bare import (
    AtStart,
    Bare,
    bare_in,
    begun_at,
    covered_by_skins,
    missed_by_limbs,
    reduced,
    reduced_silhouettes,
    reduction,
)
from tracker.evidence._colours import KnownView, Levels, linked
from tracker.evidence._shares import over_views
from tracker.evidence.measures.account import Account
from tracker.evidence.measures.correspondences import Equations
from tracker.evidence.measures.outlines import Comparison
from tracker.foundation.arrays import Array, Image, Mask, frozen
from tracker.foundation.configuration.components import component
from tracker.images.operations.level_set import colour_codes, densities
from tracker.images.operations.masks import opened
from tracker.images.sight import Sight
from tracker.synthesis import SurfaceSynthesis

_LEAST_SHARE = 0.5
"""Share of the parts that must be trusted for a frame to teach the person's colours."""

_SEAM = 2.0
"""Changes this near to the model's outline are clothes and shadow, pixels of the small picture."""

_TYPICAL_SHARE = 0.05
"""Share of a view that a person covers, usually."""


@component
class DeparturesEvidence(Evidence):
    """Changed places in the person's colours that the model leaves bare. Needs no plates.

    Contours only show whether the model's own are in the images. A limb wrongly placed before or behind the trunk,
    where it has no contour, stays there though the images show it elsewhere. There something in the person's colours
    covers the background of earlier frames, and the pose has to explain it.

    For a person whose own surface is known (a `[skin]`), places that showed the person in the frame before and have not
    changed
    must be covered, too: a hand seen where no background was ever visible cannot hide behind the trunk. Another person
    who comes along stays another person after touching the outline.
    """

    scale_px: float = pydantic.Field(default=400.0, gt=0)
    """Distance of a pose that leaves as much bare as a person usually covers, px: a forearm in one of four views is
    worth 1 to 2 px, ten times as much as contours and colours say of it when it hides before the trunk."""

    least_levels: float = pydantic.Field(default=24.0, gt=0)
    """Change in a channel from which on a pixel departs from its background, grey levels."""

    least_odds: float = pydantic.Field(default=1.0, ge=0)
    """Logarithm of the least factor by which a colour of the person is more frequent in the person than beside it."""

    around: float = pydantic.Field(default=0.12, ge=0, le=1)
    """Search region around the prediction, as a share of an image's longer side."""

    margin_px: float = pydantic.Field(default=14.0, ge=0)
    """Least distance from the model's outline of pixels that count as background, px of the image."""

    linked_px: float = pydantic.Field(default=28.0, ge=0)
    """A region that stays farther away from the person of the frame before belongs to another person, px."""

    most_share: float = pydantic.Field(default=0.25, gt=0)
    """A view in which more than this share of the person has changed beside it shows another person who passes."""

    limb_share: float = pydantic.Field(default=0.1, gt=0)
    """Largest share of the person that a limb covers: a larger change apart from the person is not a limb."""

    still_levels: float = pydantic.Field(default=8.0, gt=0)
    """Largest change in a channel from one frame to the next for an unchanged pixel, grey levels."""

    news: float = pydantic.Field(default=0.2, gt=0, le=1)
    """Share of a new frame in the background: it follows light that changes within seconds."""

    def observe(self, sight: Sight, expected: Contours | None, memory: Memory = None) -> Bare | AtStart:
        """The changed places; none before a frame has taught the background."""
        if memory is None and expected is not None:
            return AtStart(partial(self._begun, sight, expected))
        return self._observed(sight, expected, memory)

    def _begun(self, sight: Sight, expected: Contours, scene: Scene) -> Bare:
        everything = np.ones((len(scene.rig), len(scene.shapes)), dtype=np.bool_)
        return self._observed(sight, expected, self.learned(None, sight, scene, expected, everything))

    def _observed(self, sight: Sight, expected: Contours | None, memory: Memory) -> Bare:
        images = sight.frame.images
        known = (None,) * len(images) if memory is None or memory is GUESSED else memory
        views = [self._bare(sight, v, expected, one) for v, one in enumerate(known)]
        factor = next((one.factor for one in known if one is not None), 1)
        return bare_in(views, factor, np.array([image is None for image in images]))

    def distances(self, asked: Comparison, poses: Array) -> Array:
        """(B,) bare places, as a share of the person; mean over the views."""
        return over_views(self._per_view(asked, poses), 0.0)

    def equations(self, asked: Comparison, q: Array, gate_px: float) -> Equations:
        """None: a bare place shows that a limb is missing, not its direction."""
        return Equations.nothing(asked.body.dof)

    def account(self, asked: Comparison, q: Array) -> Account:
        """Bare places as missed contour, by the nearest limb."""
        per_view, n_parts = self._per_view(asked, q[None])[0], len(asked.body.parts)
        nothing = np.zeros(n_parts)
        asked = begun_at(asked)
        missed = missed_by_limbs(asked, q) if np.nansum(asked.observed.worth[:, 0]) else nothing
        distance_px = float(over_views(per_view[None], 0.0)[0])
        return Account(distance_px, per_view, np.full(n_parts, np.nan), nothing, nothing, missed)

    def learned(self, memory: Memory, sight: Sight, scene: Scene, fitted: Contours, trusted: Mask) -> Memory:
        """The surroundings of the persons, and their colours; a running mean of both."""
        known, factor = memory or (None,) * len(scene.rig), reduction(scene.rig)
        return tuple(
            self._taught(one, sight, v, factor, small, trusted[v])
            for v, (one, small) in enumerate(zip(known, reduced_silhouettes(scene, factor), strict=True))
        )

    def pictures(self, asked: Comparison, sight: Sight, view: int) -> tuple[EvidencePicture, ...]:
        """Departures from the background of earlier frames in the person's colours, white."""
        image, seen = sight.frame.images[view], begun_at(asked).observed
        if image is None or seen.masks[view] is None:
            return (EvidencePicture("departures: the background is not known yet", None),)
        size = image.shape[1], image.shape[0]
        grey = cv2.resize(np.uint8(255) * seen.masks[view], size, interpolation=cv2.INTER_NEAREST)
        picture: Image = np.repeat(grey[..., None], 3, axis=2)
        return (EvidencePicture("places that have changed, and a pose has to cover", picture),)

    def _per_view(self, asked: Comparison, poses: Array) -> Array:
        """(B, V) px."""
        asked = begun_at(asked)
        seen: Bare = asked.observed
        # Parts leave 4 % of a silhouette bare in the right pose: staying places are for surfaces that are known.
        column = int(asked.scene.has_skins)
        worth = seen.worth[:, column]
        if not np.nansum(worth):
            return np.tile(worth, (len(poses), 1))
        exact = asked.scene.has_skins and isinstance(asked.synthesis, SurfaceSynthesis)
        covered = covered_by_skins(asked, poses) if exact else seen.covered_by(asked, poses)[..., column]
        own = np.array([max(camera.size[0] * camera.size[1], 1) for camera in asked.scene.rig.cameras])
        sizes = own * _TYPICAL_SHARE / seen.factor**2
        per_view: Array = self.scale_px * (worth - covered) / sizes
        return per_view

    def _bare(
        self, sight: Sight, v: int, expected: Contours | None, known: KnownView | None
    ) -> tuple[Mask | None, Mask | None]:
        """(h, w) what a pose has to explain: departures, and staying places."""
        image = sight.frame.images[v]
        if image is None or known is None or known.looks is None:
            return None, None
        small, levels = reduced(sight, v, image, known.factor), self._levels
        changed = known.changed(small, levels)
        departs = changed & known.of_person(small, levels)
        if expected is not None:
            size = image.shape[1], image.shape[0]
            x, y, width, height = expected_region(expected, v, size, self.around * max(size))
            near, factor = np.zeros_like(departs), known.factor
            near[y // factor : (y + height) // factor + 1, x // factor : (x + width) // factor + 1] = True
            departs &= near
        found = linked(opened(departs), known.gaps < self.linked_px) & ~linked(opened(changed), known.strangers)
        # beside the person of the frame before: the rest is the person, before the background seen while the place was
        # empty
        beside = np.count_nonzero(found & (known.gaps > 0))
        if known.touched(self.linked_px) or beside > self.most_share * known.n_person:
            found = np.zeros_like(found)
        return found, opened(known.staying(small, levels))

    def _taught(
        self, known: KnownView | None, sight: Sight, v: int, factor: int, silhouette: Mask, trusted: Mask
    ) -> KnownView | None:
        image = sight.frame.images[v]
        if image is None or trusted.mean() < _LEAST_SHARE:
            return known
        small, levels = reduced(sight, v, image, factor), self._levels
        silhouette = silhouette[: small.shape[0], : small.shape[1]]
        # from a person who is not in the view all is as far as can be: OpenCV has it at the end of all numbers
        gaps = np.minimum(cv2.distanceTransform((~silhouette).astype(np.uint8), cv2.DIST_L2, 3), sum(small.shape))
        gaps *= factor
        codes, n_person, last = (colour_codes(small),), int(np.count_nonzero(silhouette)), frozen(small, np.float32)
        looks = densities(codes, silhouette, (gaps > 0) & (gaps < self.around * max(image.shape[:2])))
        if known is None:
            away, nobody = frozen(gaps > self.margin_px, np.bool_), np.zeros_like(silhouette)
            return KnownView(factor, last, away, n_person, gaps, looks, last, silhouette, nobody)
        if known.looks is not None:
            looks = known.looks if looks is None else known.looks.mixed(looks, self.news)
        newer, changed = replace(known, looks=looks), known.changed(small, levels)
        person = newer.of_person(small, levels)
        away = (gaps > self.margin_px) & ~(known.known & person & changed)
        fresh = away & ~known.known & trusted.all()
        picture = known.picture.copy()
        picture[fresh] = small[fresh]
        old = away & known.known
        picture[old] += np.float32(self.news) * (small[old] - picture[old])
        return replace(
            newer,
            picture=frozen(picture, np.float32),
            known=frozen(known.known | fresh, np.bool_),
            n_person=n_person,
            gaps=gaps,
            last=last,
            own=(silhouette & person) | newer.staying(small, levels),
            strangers=known.passers_by(
                opened(changed & (gaps > _SEAM * factor)), gaps, self.limb_share * n_person, self.linked_px
            ),
        )

    @property
    def _levels(self) -> Levels:
        return Levels(self.least_levels, self.still_levels, self.least_odds)
