"""Smoothing: poses of a finished movement without jitter, short gaps filled, with velocities and accelerations."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
import pydantic
from scipy.interpolate import make_interp_spline

from tracker.foundation.arrays import Array, Integers, Mask
from tracker.foundation.configuration.components import component


@dataclass(frozen=True)
class Stretch:
    """Poses of one person without a long gap; the first and the last one are known."""

    times_s: Array
    """(T,) seconds, rising."""

    poses: Array
    """(T, dof) rad and m; angles go on without jumps. Unknown ones are not to be used."""

    covariances: Array
    """(T, dof, dof) of the poses; NaN where the estimation gave none."""

    known: Mask
    """(T,) frames in which the person was found."""

    @property
    def sigmas(self) -> Array:
        """(T, dof) standard deviations; 1 where unknown, so that all weigh the same."""
        variances = np.diagonal(self.covariances, axis1=1, axis2=2)
        sigmas: Array = np.sqrt(np.where(np.isfinite(variances) & (variances > 0), variances, 1.0))
        return sigmas


@dataclass(frozen=True)
class Smoothed:
    """A stretch without jitter."""

    poses: Array
    """(T, dof) rad and m, unknown frames filled."""

    velocities: Array
    """(T, dof) rad/s and m/s."""

    accelerations: Array
    """(T, dof) rad/s2 and m/s2."""

    covariances: Array
    """(T, dof, dof) of the poses; NaN in filled frames where the method gives none."""


@runtime_checkable
class Smoothing(Protocol):
    """A component that smooths movements."""

    @property
    def max_gap_s(self) -> float:
        """Longest gap that is filled, seconds without a pose."""
        ...

    def check(self, interval_s: float) -> None:
        """Whether the settings fit a recording; asked before it is tracked.

        Args:
            interval_s: usual time from one frame to the next.

        Raises:
            ConfigError: they do not.
        """
        ...

    def smooth(self, stretches: Sequence[Stretch]) -> list[Smoothed]:
        """Smooths the stretches of one person, all in the same way.

        Args:
            stretches: of `LEAST_FRAMES` known poses at least.
        """
        ...


LEAST_FRAMES = 8
"""Known poses below which a stretch is left as it is: nothing can be said of its jitter."""


def stretches_of(times_s: Array, known: Mask, interval_s: float, max_gap_s: float) -> list[slice]:
    """Where a movement can be smoothed in one piece.

    Args:
        times_s: (T,) of the frames.
        known: (T,) frames in which the person was found.
        interval_s: usual time from one frame to the next.
        max_gap_s: longest time without a pose that is bridged.

    Returns:
        Ranges of frames that begin and end with a known one and hold `LEAST_FRAMES` of them at least.
    """
    found: Integers = np.flatnonzero(known)
    if not len(found):
        return []
    gaps = np.diff(times_s[found]) - interval_s
    pieces = np.split(found, np.flatnonzero(gaps > max_gap_s + 1e-3 * interval_s) + 1)
    return [slice(int(piece[0]), int(piece[-1]) + 1) for piece in pieces if len(piece) >= LEAST_FRAMES]


# What smoothings have in common that treat every stretch by itself.


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
