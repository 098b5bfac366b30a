"""Polynomial extrapolation: degree 2 over a window is the paper's constant acceleration model."""

from __future__ import annotations

import numpy as np
import pydantic

from tracker.bodies.body import BodyModel
from tracker.foundation.arrays import Array
from tracker.foundation.configuration.components import component
from tracker.tracking.trajectory import KEPT, History


@component
class PolynomialPrediction:
    """Fits a polynomial to each parameter over the last frames (paper, section 4.2).

    Lower degrees down to holding the last pose are further candidates: constant acceleration overshoots where a limb
    stops, holding lags where it swings.
    """

    degree: int = pydantic.Field(default=2, ge=0, le=3)
    """Degree of the preferred prediction: 2 constant acceleration, 1 constant velocity, 0 hold."""

    window: int = pydantic.Field(default=5, ge=1, le=KEPT)
    """Number T of frames for a polynomial of degree 2 or 3."""

    velocity_window: int = pydantic.Field(default=3, ge=2, le=KEPT)
    """Number of frames for constant velocity."""

    candidates: bool = True
    """Also offer the lower degrees."""

    def predict(self, body: BodyModel, history: History, time_s: float) -> Array:
        """Candidate poses (C, dof), highest degree first; as many as the history supports."""
        highest = min(self.degree, len(history.times) - 1)
        degrees = range(highest, -1, -1) if self.candidates else [highest]
        poses = [self._extrapolate(history, degree, time_s) for degree in degrees]
        return body.clamped(np.array(poses))

    def _extrapolate(self, history: History, degree: int, time_s: float) -> Array:
        length = {0: 1, 1: self.velocity_window}.get(degree, self.window)
        length = max(length, degree + 1)
        times, poses = history.times[-length:], history.poses[-length:]
        # Times relative to the last one and in frames keep the normal equations well conditioned.
        frame = (times[-1] - times[0]) / (len(times) - 1) if len(times) > 1 else 1.0
        powers = np.vander((times - times[-1]) / frame, degree + 1)
        coefficients, *_ = np.linalg.lstsq(powers, poses, rcond=None)
        extrapolated: Array = (np.vander([(time_s - times[-1]) / frame], degree + 1) @ coefficients)[0]
        return extrapolated
