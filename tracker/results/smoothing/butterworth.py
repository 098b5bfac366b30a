"""A low-pass filter without lag, as movement laboratories use it."""

from __future__ import annotations

import numpy as np
import pydantic
from scipy.signal import butter, sosfiltfilt

from tracker.foundation.arrays import Array
from tracker.foundation.configuration.components import component
from tracker.foundation.errors import ConfigError
from tracker.results.smoothing import Stretch, Stretchwise, without_gaps

_ORDER = 2
"""Order of each of the two passes, there and back: together fourth."""

_SHARE = (np.sqrt(2) - 1) ** (0.5 / _ORDER)
"""Cut-off of both passes over that of each: 0.80 (Winter, eq. 2.21), for the tangents of a digital filter's angles."""

_HIGHEST = 1 - 1e-6
"""Largest cut-off over half the frame rate: at half of it tangents end."""


@component
class Butterworth(Stretchwise):
    """Butterworth of fourth order, run forwards and backwards (Winter, Biomechanics of human movement, 2.2.4.4)."""

    cutoff_hz: float = pydantic.Field(default=6.0, gt=0)
    """Frequency above which movement counts as jitter, waves per second (Hz): 6 for walking, 12 for kicks."""

    def check(self, interval_s: float) -> None:
        """Half the frame rate is the highest frequency there is; see `tracker.results.smoothing.Smoothing.check`."""
        highest_hz = 0.5 / interval_s
        if self.cutoff_hz >= highest_hz:
            step_hz = 10.0 ** (np.floor(np.log10(highest_hz)) - 3)
            below_hz = step_hz * (
                np.ceil(highest_hz / step_hz) - 1
            )  # the number in the message must be possible itself
            raise ConfigError(
                f"smoothing: cutoff_hz = {self.cutoff_hz:g}, expected {below_hz:.4g} at most at the frame rate of "
                f"{1 / interval_s:.4g} Hz; leave the smoothing out, or use another one"
            )

    def _smoothed(self, stretch: Stretch) -> Array:
        """Filtered at even times: frames at uneven times are interpolated there and back."""
        times = stretch.times_s
        interval_s = float(np.median(np.diff(times)))
        if 2 * interval_s * self.cutoff_hz >= _HIGHEST:  # a stretch whose frames lie farther apart than usual
            interval_s = 0.25 / self.cutoff_hz
        even = np.linspace(times[0], times[-1], 1 + round((times[-1] - times[0]) / interval_s))
        filled = without_gaps(stretch)
        columns = np.stack([np.interp(even, times, column) for column in filled.T], axis=1)
        sections = butter(_ORDER, _each_pass(2 * interval_s * self.cutoff_hz), output="sos")
        filtered = sosfiltfilt(sections, columns, axis=0, padlen=min(len(even) - 1, 3 * (2 * len(sections) + 1)))
        smooth: Array = np.stack([np.interp(times, even, column) for column in filtered.T], axis=1)
        return smooth


def _each_pass(cutoff: float) -> float:
    """Cut-off of each of two passes with a common cut-off, over half the frame rate, below 1."""
    return float(2 / np.pi * np.arctan(np.tan(np.pi / 2 * cutoff) / _SHARE))
