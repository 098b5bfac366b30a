"""An adjusted rig: its cameras and objects, and how good it is, parameter by parameter and view by view."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tracker.cameras.calibration._bundle import Observations, State
from tracker.cameras.calibration._determinability import Held
from tracker.cameras.calibration._objects import transformed
from tracker.cameras.calibration._precision import correlation
from tracker.cameras.calibration._states import PARAMETERS, STATE_COLUMNS, UNITS, camera_of
from tracker.cameras.camera import Camera
from tracker.foundation.arrays import Array, Mask
from tracker.kernels.rows import BundleCameraRow, BundleUnknowns


@dataclass(frozen=True)
class Adjustment:
    """An adjusted rig, with everything that tells how good it is."""

    names: tuple[str, ...]
    sizes: tuple[tuple[int, int], ...]
    state: State
    observations: Observations
    used: Mask
    """(N,) observations that are no gross errors."""

    exchanged: Mask
    """(N,) observations whose bar had its ends exchanged in that view."""

    errors: Array
    """(N, 2) observed minus projected, px; NaN where a point is not determined."""

    sigma_px: float
    """A-priori standard deviation of an image coordinate."""

    s0: float
    """Standard deviation of unit weight: noise found over noise assumed."""

    redundancy: int
    covariance: Array
    """(17V, 17V) of the cameras' unknowns, scaled by s0; 0 for those held. The datum is the rig's own mean."""

    free: Mask
    """(V, 17) unknowns that were determined."""

    held: tuple[Held, ...]
    inflation: float = 1.0
    """Standard errors over those of independent residuals, the median: more than 1 if pictures of a board disagree."""

    bent_m: float = 0.0
    """By how much the board seems not to be flat, or not as printed; 0 if within the noise."""

    @property
    def cameras(self) -> tuple[Camera, ...]:
        """The calibrated cameras."""
        states = zip(self.state.cameras, self.names, self.sizes, strict=True)
        return tuple(camera_of(state, name, size) for state, name, size in states)

    @property
    def sigmas(self) -> Array:
        """(V, 17) standard errors, in `UNITS`."""
        return np.sqrt(np.diag(self.covariance)).reshape(-1, BundleUnknowns.N_UNKNOWNS)

    def in_world(self, motion: Array) -> Adjustment:
        """The same adjustment in another frame, with the standard errors along its axes.

        Args:
            motion: (4, 4) from the present frame to the other one.
        """
        cameras = self.state.cameras.copy()
        turned = cameras[:, BundleCameraRow.ROTATION].reshape(-1, 3, 3) @ motion[:3, :3].T
        cameras[:, BundleCameraRow.ROTATION] = turned.reshape(-1, 9)
        cameras[:, BundleCameraRow.CENTRE] = transformed(motion, cameras[:, BundleCameraRow.CENTRE])
        # the rotations are about the cameras' own axes, which move along
        slope = np.eye(BundleUnknowns.N_UNKNOWNS)
        slope[BundleUnknowns.CENTRE, BundleUnknowns.CENTRE] = motion[:3, :3]
        slopes = np.kron(np.eye(len(cameras)), slope)
        covariance = slopes @ self.covariance @ slopes.T
        np.fill_diagonal(covariance, np.maximum(np.diag(covariance), 0.0))  # of one camera they are 0 but for rounding
        return replace(self, state=State(cameras, self.state.objects.in_world(motion)), covariance=covariance)

    def rms_px(self, view: int) -> float:
        """RMS image coordinate residual of a view without its gross errors, px."""
        errors = self.errors[self.used & (self.observations.views == view)]
        return float(np.sqrt(np.mean(errors**2))) if len(errors) else float("nan")

    def correlations(self, at_least: float) -> list[tuple[float, str, str]]:
        """Correlated parameters of one camera, the highest first: correlation and the two names."""
        found = []
        for v, name in enumerate(self.names):
            block = correlation(self.covariance)[v * BundleUnknowns.N_UNKNOWNS :, v * BundleUnknowns.N_UNKNOWNS :]
            for i in range(BundleUnknowns.N_UNKNOWNS):
                for j in range(i):
                    if abs(block[i, j]) >= at_least:
                        pair = f"{name}: {PARAMETERS[j]}", PARAMETERS[i]
                        found.append((float(block[i, j]), *pair))
        return sorted(found, key=lambda entry: -abs(entry[0]))


def parameter_table(adjustment: Adjustment, view: int) -> list[tuple[str, float, float, str, bool]]:
    """Rows of a camera's unknowns: name, value, standard error, unit, determined; rotations have no value."""
    state = adjustment.state.cameras[view]
    values = np.where(np.array(STATE_COLUMNS) < 0, np.nan, state[list(STATE_COLUMNS)])
    rows = zip(PARAMETERS, values, adjustment.sigmas[view], UNITS, adjustment.free[view], strict=True)
    return [(name, float(value), float(sigma), unit, bool(free)) for name, value, sigma, unit, free in rows]
