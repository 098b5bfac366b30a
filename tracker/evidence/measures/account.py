"""How well one pose of a person explains what was observed, view by view and part by part."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tracker.foundation.arrays import Array, Mask


@dataclass(frozen=True)
class Account:
    """What of a person's contour the images show, and what of the images the person leaves over.

    Lengths are in px of contour over all views; the P parts are the person's own.
    """

    distance_px: float
    """The distance that a search ranks by, averaged over the views present, px."""

    per_view_px: Array
    """(V,) distance of each view, px; NaN for a missing view."""

    per_part_px: Array
    """(P,) distance of each part's visible contour to what was observed, px; NaN for a hidden part."""

    visible_px: Array
    """(P,) contour of each part that should be seen."""

    explained_px: Array
    """(P,) how much of it is where the images show it."""

    missed_px: Array
    """(P,) what the images show beside each part and no contour explains."""

    by_view_px: Array | None = None
    """(3, V, P) what each view has of these three; None for evidence that cannot tell."""

    not_shown: Mask | None = None
    """(V, P) parts of limbs that a view does not show while others do, see `measures.occlusion`; None for none."""

    hidden: Mask | None = None
    """(V, P) those of them that were not shown for long, so that all else leaves them out; None for none."""

    @property
    def explained(self) -> float:
        """Share of the visible contour that the images show, 0 to 1; 0 where nothing is visible."""
        visible = float(self.visible_px.sum())
        return float(self.explained_px.sum()) / visible if visible > 0 else 0.0

    @property
    def left_over_px(self) -> Array:
        """(P,) contour that the images do not show, and what they show beside it that the model does not."""
        left: Array = self.visible_px - self.explained_px + self.missed_px
        return left

    @property
    def left_over(self) -> float:
        """What is left over of model and images, over the model's contour."""
        return float(self.left_over_px.sum() / max(float(self.visible_px.sum()), 1.0))

    def of(self, parts: Mask | slice) -> Account:
        """The account of some of the parts; the distances stay."""
        return Account(
            self.distance_px,
            self.per_view_px,
            self.per_part_px[parts],
            self.visible_px[parts],
            self.explained_px[parts],
            self.missed_px[parts],
            None if self.by_view_px is None else self.by_view_px[:, :, parts],
            None if self.not_shown is None else self.not_shown[:, parts],
            None if self.hidden is None else self.hidden[:, parts],
        )

    def without(self, hidden: Mask) -> Account:
        """The account without what views (V, P) say of parts that something hides from them."""
        if self.by_view_px is None or not hidden.any():
            return self
        visible, explained, missed = np.where(hidden, self.by_view_px, 0.0).sum(axis=1)
        return replace(
            self,
            visible_px=self.visible_px - visible,
            explained_px=self.explained_px - explained,
            missed_px=self.missed_px - missed,
            by_view_px=np.where(hidden, 0.0, self.by_view_px),
            hidden=hidden,
        )


def summed(accounts: Sequence[Account], weights: Sequence[float]) -> Account:
    """The account of several kinds of evidence: all lengths and distances times their weights.

    Args:
        accounts: of the same person and pose; one in which nothing is visible has no say in what is left over.
        weights: one each.
    """
    pairs = list(zip(weights, accounts, strict=True))
    total = sum(weight for weight, one in pairs if one.visible_px.any()) or 1.0
    known = np.array([np.isfinite(one.per_part_px) for one in accounts])
    parts = np.array([weight * np.nan_to_num(one.per_part_px) for weight, one in pairs])
    told = np.array([np.isfinite(one.per_view_px) for one in accounts])
    views = np.array([weight * np.nan_to_num(one.per_view_px) for weight, one in pairs])
    by_view = [weight / total * one.by_view_px for weight, one in pairs if one.by_view_px is not None]
    return Account(
        distance_px=float(sum(weight * one.distance_px for weight, one in pairs)),
        per_view_px=np.where(told.any(axis=0), views.sum(axis=0), np.nan),
        per_part_px=np.where(known.any(axis=0), parts.sum(axis=0), np.nan),
        visible_px=np.sum([weight / total * one.visible_px for weight, one in pairs], axis=0),
        explained_px=np.sum([weight / total * one.explained_px for weight, one in pairs], axis=0),
        missed_px=np.sum([weight / total * one.missed_px for weight, one in pairs], axis=0),
        by_view_px=np.sum(by_view, axis=0) if by_view else None,
    )
