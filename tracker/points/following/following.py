"""Parameters of following points (D'Apuzzo et al. 2000, section 2.3)."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
import pydantic

from tracker.foundation.arrays import Integers
from tracker.foundation.configuration.components import component
from tracker.points.following.keys import Keys, Quality
from tracker.points.following.points import NewPoints, Points, born
from tracker.points.surfaces import LeastSquaresMatching, PatchImage


@component
class TemporalMatching(LeastSquaresMatching):
    """Finding of a key patch in a later image: the paper's temporal least squares matching."""

    smoothing_px: float = pydantic.Field(default=0.5, ge=0, le=5)
    """Standard deviation of the Gaussian that both images are smoothed with; 0 for none.

    Less than across views, where it is a question of interpolation: light changes on a surface that turns, coarse
    structure most. Chosen on the left and right views of `closerange`, each followed alone: 0.3 to 0.5 px were 7 to
    13 % better than 0.8 px, 1.2 px 17 % worse.
    """

    prior_sd: float | None = pydantic.Field(default=0.01, gt=0)
    """Standard deviation of the affine terms' changes from frame to frame; None for free terms."""


@component
class Following:
    """Following of points from frame to frame."""

    template: Literal["key", "previous"] = "key"
    """Template of each view's patch: that of the point's birth, or (the paper's way) of the frame before.

    Key patches do not drift; where they fit no more, the frame before takes their place, which is recorded.
    """

    start: Literal["neighbours", "correlation"] = "neighbours"
    """Linear prediction corrected by the flow of neighbouring points, or (the paper's way) by a search of the best
    cross-correlation, in a larger box where that fails."""

    search_px: int = pydantic.Field(default=8, ge=1, le=64)
    """Cross-correlation is searched this far around the prediction, and twice as far in the second attempt, px."""

    find_again: bool = True
    """Look for hidden points where their neighbours are expecting them."""

    min_views: int | None = pydantic.Field(default=None, ge=1)
    """Views that must show a point; None for all that showed it at its birth, but no more than three."""

    max_residual_px: float = pydantic.Field(default=0.5, gt=0)
    """Points whose rays miss one another by more (RMS of the reprojection) are not accepted, px."""

    max_across_px: float = pydantic.Field(default=1.0, gt=0)
    """A point with a new key is matched between the views too, and accepted if that agrees within this, px."""

    max_surprise_px: float = pydantic.Field(default=2.5, gt=0)
    """Points found again, and those with a new key, lie no farther than this from where neighbours expect them, px."""

    correct_curvature: bool = True
    """Correct the matches for curvature that grows within a patch while the surface turns, where neighbours agree."""

    reach_px: float = pydantic.Field(default=40.0, gt=0)
    """Points farther apart than this at their birth are no neighbours, px."""

    min_correlation: float = pydantic.Field(default=0.85, ge=0, le=1)
    """Matches whose patches agree less are rejected."""

    max_sigma0_grey: float = pydantic.Field(default=12.0, gt=0)
    """Matches with a larger a-posteriori standard deviation of unit weight are rejected, grey levels."""

    max_sigma_px: float = pydantic.Field(default=0.3, gt=0)
    """Matches with a larger standard deviation of the shift in x or y are rejected, px.

    Points of weak texture are followed too, with the sigma they deserve: at 0.1 px a tenth of the points of a printed
    shirt was lost within 50 frames, at 0.3 px half of that, and none of them was wrong.
    """

    max_stretch: float = pydantic.Field(default=2.5, gt=1)
    """Matches whose patch is stretched or compressed more since the key are rejected."""

    matching: TemporalMatching = pydantic.Field(default_factory=TemporalMatching)
    """Finding of a patch in the next frame."""

    alone_patch_px: int = pydantic.Field(default=15, ge=5, le=63)
    """Least side of the patches where a view is followed alone (2-D mode), odd, px; `matching.patch_px` may be larger.

    No other view averages the noise there: on the left and right views of `closerange`, 15 px were 4 % better than 13.
    """

    @pydantic.field_validator("alone_patch_px")
    @classmethod
    def _odd(cls, patch_px: int) -> int:
        if patch_px % 2 == 0:
            raise ValueError(f"alone_patch_px = {patch_px}: expected an odd number, a patch has a centre pixel")
        return patch_px

    def for_views(self, n_views: int) -> Following:
        """The same for so many views."""
        if n_views > 1 or self.matching.patch_px >= self.alone_patch_px:
            return self
        return replace(self, matching=self.matching.with_patch(self.alone_patch_px))

    @property
    def quality(self) -> Quality:
        """Limits of a match."""
        return Quality(self.max_sigma0_grey, self.max_sigma_px, self.min_correlation, self.max_stretch)

    def needed(self, points: Points) -> Integers:
        """(N,) views that must show each point."""
        most = 3 if self.min_views is None else self.min_views
        needed: Integers = np.minimum(points.needed, most)
        return needed

    def begin(
        self, new: NewPoints, images: tuple[PatchImage | None, ...], index: int, living: Points | None = None
    ) -> Points:
        """Points are born in the present frame, whose number is the index."""
        half = self.matching.patch_px // 2
        n = len(new.positions)
        keys = tuple(
            Keys.empty(n, half) if image is None else Keys.cut(image, new.pixels[v], half)
            for v, image in enumerate(images)
        )
        return born(new, keys, living, self.reach_px, index)
