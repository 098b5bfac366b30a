"""A low-pass filter whose cut-off rises with speed."""

from __future__ import annotations

import numpy as np
import pydantic

from tracker.foundation.arrays import Array
from tracker.foundation.configuration.components import component
from tracker.results.smoothing import Stretch, Stretchwise, without_gaps

_SPEED_CUTOFF_HZ = 1.0
"""Cut-off of the filter of the speed, as in the paper."""


@component
class OneEuro(Stretchwise):
    """The 1-euro filter (Casiez, Roussel, Vogel, CHI 2012): causal, for live views, and therefore late."""

    cutoff_hz: float = pydantic.Field(default=4.0, gt=0)
    """Cut-off at rest, waves per second (Hz): lower means less jitter."""

    beta: float = pydantic.Field(default=10.0, ge=0)
    """Factor: Hz by which the cut-off rises for each rad/s or m/s; higher means less lag."""

    def _smoothed(self, stretch: Stretch) -> Array:
        poses, intervals = without_gaps(stretch), np.diff(stretch.times_s)
        smooth, speed = [poses[0]], np.zeros(poses.shape[1])
        for before, pose, dt in zip(poses[:-1], poses[1:], intervals, strict=True):
            speed = speed + _share(_SPEED_CUTOFF_HZ, dt) * ((pose - before) / dt - speed)
            smooth.append(smooth[-1] + _share(self.cutoff_hz + self.beta * np.abs(speed), dt) * (pose - smooth[-1]))
        return np.array(smooth)


def _share(cutoff_hz: float | Array, dt: float) -> Array:
    """Weight of a new value (the paper's alpha, eq. 3)."""
    return np.asarray(1 / (1 + 1 / (2 * np.pi * cutoff_hz * dt)))
