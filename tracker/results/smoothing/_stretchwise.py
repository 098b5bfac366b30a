"""What smoothings have in common that treat every stretch by itself."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence

import numpy as np
import pydantic
from scipy.interpolate import make_interp_spline

from tracker.foundation.arrays import Array
from tracker.foundation.configuration.components import component
from tracker.results.smoothing import Smoothed, Stretch


@component
class Stretchwise:
    """Poses at all times of each stretch; where they have no velocities of their own, those of a quintic spline."""

    max_gap_s: float = pydantic.Field(default=0.2, ge=0)
    """Longest gap that is filled, seconds without a pose; frames of longer ones stay lost."""

    def check(self, interval_s: float) -> None:
        """Any frame rate will do; see `tracker.results.smoothing.Smoothing.check`."""

    def smooth(self, stretches: Sequence[Stretch]) -> list[Smoothed]:
        """Smooths each; see `tracker.results.smoothing.Smoothing.smooth`."""
        return [self._with_derivatives(stretch) for stretch in stretches]

    @abstractmethod
    def _smoothed(self, stretch: Stretch) -> Array:
        """(T, dof) poses of a stretch, its unknown frames filled."""

    def _with_derivatives(self, stretch: Stretch) -> Smoothed:
        covariances = np.where(stretch.known[:, None, None], stretch.covariances, np.nan)
        return Smoothed(*self._courses(stretch), covariances)

    def _courses(self, stretch: Stretch) -> tuple[Array, Array, Array]:
        """(T, dof) each: smooth poses, their velocities and accelerations."""
        poses = self._smoothed(stretch)
        spline = make_interp_spline(stretch.times_s, poses, k=5)
        return poses, spline(stretch.times_s, nu=1), spline(stretch.times_s, nu=2)


def without_gaps(stretch: Stretch) -> Array:
    """(T, dof) poses, those of unknown frames interpolated in time."""
    times = stretch.times_s[stretch.known]
    columns = stretch.poses[stretch.known].T
    filled: Array = np.stack([np.interp(stretch.times_s, times, column) for column in columns], axis=1)
    return filled
