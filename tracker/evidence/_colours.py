"""Memory of region evidence: the colours inside and outside of every part, in every view."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import cv2
import numpy as np

from tracker.bodies.contours import Contours, expected_region
from tracker.foundation.arrays import Array, Array32, Image, Integers, Mask, Numbers16, Region, frozen
from tracker.images.operations.appearance import appearance
from tracker.images.operations.level_set import Densities, colour_codes
from tracker.images.sight import Sight
from tracker.kernels.regions import (
    EVEN,
    N_COLOURS,
    Looks,
    Picture,
    Samples,
    Tables,
    encode,
    hides,
    learn_lines,
    tabulate_posteriors,
)


@dataclass(frozen=True)
class Levels:
    """Limits from which colours count as changed, or as a person's."""

    changed: float
    """Least change in a channel against the background, grey levels."""

    still: float
    """Most change in a channel against the frame before, grey levels."""

    odds: float
    """Least logarithm of the odds of a colour in the person against the surroundings."""


@dataclass(frozen=True)
class KnownView:
    """Knowledge of one view: the background where the person was not, and the person's colours."""

    factor: int
    """Pixels of an image, along each side, for one of the small picture; the same in all views."""

    picture: Array32
    """(h, w, 3) BGR of the small picture."""

    known: Mask
    """(h, w) pixels that have been seen without the person."""

    n_person: int
    """Pixels of the small picture that the person covers."""

    gaps: Array32
    """(h, w) distance to the person, px of the image."""

    looks: Densities | None
    """Colours of the person and of the surroundings."""

    last: Array32
    """(h, w, 3) the small picture of the frame before."""

    own: Mask
    """(h, w) pixels of it that showed the person."""

    strangers: Mask
    """(h, w) pixels of it that showed another person."""

    def changed(self, small: Image, levels: Levels) -> Mask:
        """(h, w) pixels that differ from the known background."""
        change = np.abs(small - self.picture).max(axis=2)
        found: Mask = self.known & (change > levels.changed)
        return found

    def like_person(self, small: Image, levels: Levels) -> Mask:
        """(h, w) pixels in colours that the person has and the surroundings lack."""
        if self.looks is None:
            return np.zeros_like(self.known)
        found: Mask = self.looks.log_odds((colour_codes(small),)) > levels.odds
        return found

    def of_person(self, small: Image, levels: Levels) -> Mask:
        """(h, w) pixels in colours of the person, judged against the known background behind them.

        A hand is as brown as wood beside it. Where the wood was seen, the pixel is the wood in other light or it is
        not.
        """
        if self.looks is None:
            return np.zeros_like(self.known)
        hers = self.looks.log_shares((colour_codes(small),)) > levels.odds
        came = self.changed(small, levels) & ~self._relit(small, levels)
        found: Mask = self.like_person(small, levels) | (hers & came)
        return found

    def _relit(self, small: Image, levels: Levels) -> Mask:
        """(h, w) pixels whose colour is that of the background times a factor: shade, or a lamp (Horprasert 1999)."""
        factor = (small * self.picture).sum(axis=2) / np.maximum((self.picture**2).sum(axis=2), 1.0)
        other = np.abs(small - factor[..., None] * self.picture).max(axis=2)
        found: Mask = other < levels.changed / 2
        return found

    def staying(self, small: Image, levels: Levels) -> Mask:
        """(h, w) pixels that showed the person in the frame before and have not changed: they still do."""
        still = np.abs(small - self.last).max(axis=2) < levels.still
        background = self.known & ~self.changed(small, levels)
        found: Mask = self.own & still & ~background & ~self.strangers & self.of_person(small, levels)
        return found

    def touched(self, linked_px: float) -> bool:
        """Whether another person is so near that departures may be theirs."""
        return bool((self.gaps[self.strangers] < linked_px).any())

    def passers_by(self, changed: Mask, gaps: Array32, least_px: float, linked_px: float) -> Mask:
        """(h, w) changed regions beside the person that belong to another person.

        A person who comes along is apart at first, and larger than a limb. The region stays another person's when it
        touches the outline; departures elsewhere meanwhile may be, too.

        Args:
            changed: (h, w) in the present frame.
            gaps: (h, w) distance to the person in it, px of the image.
            least_px: pixels of the small picture, more than a limb has.
            linked_px: distance up to which a region belongs to the person, px of the image.
        """
        _, labels, sizes, _ = cv2.connectedComponentsWithStats(changed.astype(np.uint8))
        others: Mask = np.asarray(sizes[:, cv2.CC_STAT_AREA] > least_px)
        others[np.unique(labels[gaps < linked_px])] = False
        others[np.unique(labels[self.strangers & changed])] = True
        others |= self.touched(linked_px)
        others[0] = False
        found: Mask = others[labels]
        return found


def linked(mask: Mask, near: Mask) -> Mask:
    """(h, w) the regions of a mask that reach into another one."""
    _, labels = cv2.connectedComponents(mask.astype(np.uint8))
    kept: Mask = np.isin(labels, np.unique(labels[near & mask])) & mask
    return kept


# Colour numbers of the pixels around the persons, for region evidence.

Codes = tuple[Region, Numbers16]
"""A region of a view and its colour numbers, row by row."""


def picture_around(sight: Sight, around: Contours | None, margin: float, least_px: Array | None = None) -> Picture:
    """The colour numbers of all views around some contours, joined; see `colour_numbers`."""
    picture: Picture = sight.joined(encoded, colour_numbers(sight, around, margin, least_px), packed)
    return picture


def colour_numbers(
    sight: Sight, around: Contours | None, margin: float, least_px: Array | None = None
) -> tuple[Codes | None, ...]:
    """The colour numbers of each view near some contours.

    Args:
        sight: the images; colour numbers are computed once for each.
        around: the contours; None for everywhere.
        margin: as a share of an image's longer side.
        least_px: (V,) margins where they are larger.

    Returns:
        For each view its region and numbers, None if its image is missing.
    """
    found: list[Codes | None] = []
    for v, image in enumerate(sight.frame.images):
        if image is None:
            found.append(None)
            continue
        size = image.shape[1], image.shape[0]
        margin_px = max(margin * max(size), 0.0 if least_px is None else float(least_px[v]))
        region = (0, 0, *size) if around is None else expected_region(around, v, size, min(margin_px, max(size)))
        found.append(sight.once(encoded, v, region, partial(encoded, image)))
    return tuple(found)


def packed(views: Sequence[Codes | None]) -> Picture:
    """The colour numbers of all views; None for a missing one."""
    codes, layout, start = [np.zeros(0, dtype=np.uint16)], [], 0
    for view in views:
        region, numbers = view or ((0, 0, 0, 0), codes[0])
        layout.append((start, *region))
        codes.append(numbers)
        start += len(numbers)
    flat: Numbers16 = np.concatenate(codes)
    flat.setflags(write=False)
    return Picture(flat, frozen(layout, np.int64))


def encoded(image: Image, region: Region) -> Codes:
    """The colour numbers of a region of an image (h, w, 3)."""
    codes = np.empty(region[2] * region[3], dtype=np.uint16)
    encode(appearance(image, region), codes)
    return region, codes


FLOOR = 2e-4
"""Share of an unseen colour: one of 4096 bins by chance."""

_MOST_ODDS = 4.0
"""Bound on the logarithm of the odds of one pixel: no single pixel is a proof."""

_STRANGE, _ALIKE = 0.4, 0.5
"""A view's colours of a part are another thing's if their likeness to other views' is below the first value, and below
the second times that of the view most alike. A part hidden at the start: 60 mm without, 44 mm with."""

_LEAST_LEFT = 0.3
"""Share of a part's colours that must be its own to be kept."""

_BOTH_SIDES = 0.5
"""Likeness of the colours on both sides of a contour from which on one thing is before both."""


@dataclass(frozen=True)
class Colours:
    """Tables of a scene's parts; a frozen value."""

    tables: Tables
    posteriors: Image
    """(V, P, 4096) see `tabulate_posteriors`."""

    known: Mask
    """(V, P) parts whose inside was learnt in a view."""

    half_extents: Array
    """(P,) smaller half extent of each part across its axis, metres."""

    @staticmethod
    def none(n_views: int, shapes: Array) -> Colours:
        """Nothing learnt yet of parts with packed shapes (P, 7)."""
        layout = (n_views, len(shapes), N_COLOURS)
        inside, outside = (frozen(np.zeros(layout), np.float32) for _ in range(2))
        hiders: Array32 = frozen(np.zeros((n_views, N_COLOURS)), np.float32)
        known: Mask = frozen(np.zeros(layout[:2]), np.bool_)
        posteriors: Image = frozen(np.full(layout, EVEN), np.uint8)
        return Colours(Tables(inside, outside, hiders), posteriors, known, frozen(shapes[:, :2].min(axis=1)))

    @property
    def looks(self) -> Looks:
        """For the kernels."""
        return Looks(self.tables, self.posteriors, self.known, self.half_extents)

    def after(
        self,
        picture: Picture,
        samples: Samples,
        beside: Integers,
        cameras: Array,
        useful: Mask,
        spans: tuple[float, float],
    ) -> Colours:
        """The colours one frame on.

        Args:
            picture: the frame's colours.
            samples: contours of the scene at its estimated poses.
            beside: (V, M, 2) parts beside them.
            cameras: (V, 29) from `Rig.packed`.
            useful: (V, M) samples to learn from.
            spans: distance of places on a line, metres; weight of the frame in the running mean.
        """
        tables = Tables(*(values.copy() for values in self.tables))
        learning = picture, samples, beside, cameras, self.half_extents, useful, *spans, self.posteriors
        changed = learn_lines(*learning, tables)
        known = self.known.copy()
        fresh = changed & ~known
        known[fresh] = tables.inside[fresh].any(axis=1)
        changed |= corrected(tables, known & ~self.known, known)
        posteriors = self.posteriors.copy()
        tabulate_posteriors(tables, (FLOOR, _MOST_ODDS), changed, posteriors)
        for values in (*tables, posteriors, known):
            values.setflags(write=False)
        return Colours(tables, posteriors, known, self.half_extents)


def corrected(tables: Tables, fresh: Mask, known: Mask) -> Mask:
    """Removes the colours of things that hide the part from colours learnt for the first time.

    A part hidden at the start teaches the colours of the thing before it, unlike those in all other views: it gets the
    mean of those. If both sides of its contour then show that thing, it hides other parts of that view as well.

    Args:
        tables: in and out.
        fresh: (V, P) learnt in this frame for the first time.
        known: (V, P) learnt at all.

    Returns:
        (V, P) parts whose colours, or hiding thing's colours, were changed.
    """
    inside, changed = tables.inside, np.zeros_like(fresh)
    for p in np.flatnonzero(fresh.any(axis=0)):
        views = np.flatnonzero(known[:, p])
        if len(views) < 3:
            # If two differ, either may be right.
            continue
        roots = np.sqrt(inside[views, p])
        coefficients = roots @ roots.T
        alike = (coefficients.sum(axis=1) - np.diag(coefficients)) / (len(views) - 1)
        strange = (alike < _STRANGE) & (alike < _ALIKE * alike.max()) & fresh[views, p]
        for v in views[strange]:
            if np.sqrt(inside[v, p]) @ np.sqrt(tables.outside[v, p]) > _BOTH_SIDES:
                np.maximum(tables.hiders[v], inside[v, p], out=tables.hiders[v])
                changed[v] = True
        if strange.any():
            inside[views[strange], p] = inside[views[~strange], p].mean(axis=0)
            changed[views[strange], p] = True
    for v, p in np.argwhere(fresh & changed):
        others = np.flatnonzero(known[:, p] & (np.arange(len(known)) != v))
        if len(others):
            _take_out(tables.hiders[v], inside[others, p].mean(axis=0), inside[v, p])
    return changed


def _take_out(hider: Array32, elsewhere: Array32, table: Array32) -> None:
    """Removes the colours of a hiding thing from a part's table (4096,); those it has elsewhere stay."""
    table[hides(hider, elsewhere)] = 0
    left = table.sum()
    if left < _LEAST_LEFT:
        table[:] = elsewhere
    else:
        table /= left
