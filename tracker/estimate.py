"""The estimate of one person's pose in one frame, with its evidence."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from tracker.arrays import Array


class Status(StrEnum):
    """How a pose came about."""

    TRACKED = "tracked"
    """Found near the prediction."""

    BOOTSTRAPPED = "bootstrapped"
    """Found without a prediction, in the first frame."""

    RECOVERED = "recovered"
    """Found without a prediction, after a loss."""

    LOST = "lost"
    """Not found: the pose is the last prediction and not to be used."""


@dataclass(frozen=True)
class Estimate:
    """One person's pose with the distance it leaves and its uncertainty."""

    q: Array
    """(dof,) pose, rad and m."""

    covariance: Array
    """(dof, dof) covariance of q; NaN where the method gives none."""

    distance_px: float
    """Similarity distance, summed over the views and divided by their number, px."""

    per_view_px: Array
    """(V,) distance of each view, px; NaN for a missing view."""

    per_part_px: Array
    """(P,) directed chamfer distance of the person's visible part contours, px; NaN for a hidden part."""

    visible_px: Array
    """(P,) visible contour of each part over all views, px."""

    unexplained_px: Array
    """(P,) how much of it is not on scene edges, and scene contour beside it that the model misses, px."""

    explained: float
    """Share of the person's visible contour that lies on accepted scene edges, 0 to 1."""

    evaluations: int
    """Poses synthesized and compared."""

    search_s: float = 0.0
    """Time spent searching, seconds; the rest of the estimation is refinement."""

    status: Status = Status.TRACKED

    @property
    def left_over(self) -> float:
        """Contour of the model without a scene edge, and of the scene without the model, over the model's contour."""
        return float(self.unexplained_px.sum() / max(float(self.visible_px.sum()), 1.0))

    @property
    def lost(self) -> bool:
        """Whether the pose is not to be used."""
        return self.status is Status.LOST
