"""What is known of a view without plates: its background, how the person looks, who else is in it, what has changed."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from tracker.foundation.arrays import Array32, Image, Mask
from tracker.images.operations.level_set import Densities, colour_codes


@dataclass(frozen=True)
class Levels:
    """From when on colours count as changed, or as somebody's."""

    changed: float
    """Least change in a channel against the background, grey levels."""

    still: float
    """Most change in a channel against the frame before, grey levels."""

    odds: float
    """By what factor a colour must be more frequent in the person than beside it, its logarithm."""


@dataclass(frozen=True)
class KnownView:
    """What is known of one view: what was seen where the person was not, and how the person looks."""

    factor: int
    """How many pixels of an image, along each side, one of the small picture stands for; the same in all views."""

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

    last: Array32
    """(h, w, 3) the small picture of the frame before."""

    own: Mask
    """(h, w) pixels of it that showed the person."""

    strangers: Mask
    """(h, w) pixels of it that showed somebody who is not in the model."""

    def changed(self, small: Image, levels: Levels) -> Mask:
        """(h, w) pixels that are not what was seen there without the person."""
        change = np.abs(small - self.picture).max(axis=2)
        found: Mask = self.known & (change > levels.changed)
        return found

    def like_person(self, small: Image, levels: Levels) -> Mask:
        """(h, w) pixels in colours that the person has and what is beside it has not."""
        if self.looks is None:
            return np.zeros_like(self.known)
        found: Mask = self.looks.log_odds((colour_codes(small),)) > levels.odds
        return found

    def of_person(self, small: Image, levels: Levels) -> Mask:
        """(h, w) pixels in colours of the person, judged by what is known to be behind them where that is known.

        A hand is as brown as wood beside her. Where the wood was seen it is the wood in other light or it is not.
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
        """(h, w) pixels that showed the person in the frame before and look as they did: they show it still."""
        still = np.abs(small - self.last).max(axis=2) < levels.still
        background = self.known & ~self.changed(small, levels)
        found: Mask = self.own & still & ~background & ~self.strangers & self.of_person(small, levels)
        return found

    def touched(self, linked_px: float) -> bool:
        """Whether somebody else is so near to the person that what comes out there may be his."""
        return bool((self.gaps[self.strangers] < linked_px).any())

    def passers_by(self, changed: Mask, gaps: Array32, least_px: float, linked_px: float) -> Mask:
        """(h, w) regions of what has changed beside the person that are somebody else's.

        Who comes along is first apart from the person, and more than a limb. He is the same when he touches the
        person's outline; what comes out of it elsewhere meanwhile may be his as well.

        Args:
            changed: (h, w) in the frame at hand.
            gaps: (h, w) distance to the person in it, px of the image.
            least_px: pixels of the small picture that are more than a limb.
            linked_px: so near to the person a region hangs on it, px of the image.
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
