"""The reference bar: two targets, moved through the volume (Maas 1998; D'Apuzzo 2000, section 2.1)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import pydantic

from tracker.cameras.calibration._adjustment import Adjustment, Calibrated, Measure
from tracker.cameras.calibration._bar_images import BarImages, measure_bar
from tracker.cameras.calibration._bundle import Observations, State
from tracker.cameras.calibration._objects import Bars, nominal_state, transformed
from tracker.cameras.calibration._report import advice
from tracker.cameras.calibration._self_calibration import (
    NOTICED_FRAMES,
    NOTICED_SIGMAS,
    check_synchronized,
    chosen_unknowns,
    lag_advice,
    lag_measures,
    self_calibrated,
    time_offsets,
)
from tracker.cameras.calibration._start import bar_observations, start_values
from tracker.cameras.calibration._world import WorldFrame, bar_fault, focal_fault
from tracker.cameras.frame import Views
from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array, Mask
from tracker.foundation.configuration.components import component
from tracker.foundation.errors import CalibrationError
from tracker.foundation.progress import Progress
from tracker.kernels.rows import BundleCameraRow

__all__ = ["BarImages", "ReferenceBarCalibration"]

Group = Literal["camera_constant", "principal_point", "affinity", "radial", "decentring", "time_offset"]

_FOCAL_GUESSES = (1.2, 0.9, 1.6, 0.7, 2.2)
"""Multiples of the image width tried where no focal length is given."""


@component
class ReferenceBarCalibration:
    """Self-calibration from a bar with two targets a known distance apart, moved through the common volume."""

    length_m: float | None = pydantic.Field(default=None, gt=0)
    """Distance of the targets' centres, metres. It alone gives the scale."""

    sigma_length_m: float = pydantic.Field(default=1e-4, gt=0)
    """Standard deviation of the length, metres."""

    focal_px: float | dict[str, float] | None = None
    """Focal length to about 10 %, px: one for all views, or by view; None tries usual lenses."""

    sigma_px: float = pydantic.Field(default=0.1, gt=0)
    """Expected standard deviation of an image coordinate, px."""

    estimated: tuple[Group, ...] = ("camera_constant", "principal_point", "affinity", "radial", "decentring")
    """Parameters to determine beside the exterior orientation; those that cannot be are named and held."""

    target: Literal["disc", "ball"] = "disc"
    """`disc`: flat or retroreflective, evenly bright; `ball`: a bright sphere with shading."""

    smallest_px: float = pydantic.Field(default=2.0, gt=0)
    """Smallest half axis of a target, px."""

    largest_px: float = pydantic.Field(default=25.0, gt=0)
    """Largest half axis of a target, px."""

    contrast: float = pydantic.Field(default=25.0, gt=0)
    """Least difference of a target to what is behind it, grey levels."""

    hold_out_every: int = pydantic.Field(default=5, ge=2)
    """Every so many positions judge a calibration made without them; then all are used."""

    world: WorldFrame = pydantic.Field(default_factory=WorldFrame)
    """The world frame."""

    @pydantic.field_validator("length_m")
    @classmethod
    def _is_in_metres(cls, length_m: float | None) -> float | None:
        if length_m is not None and (fault := bar_fault(length_m)):
            raise ValueError(fault)
        return length_m

    def calibrate(self, views: Views, progress: Progress) -> Calibrated:
        """Measures the bar in the views and adjusts; see `tracker.cameras.calibration.Calibration.calibrate`."""
        self._length()
        images = measure_bar(views, self, progress)
        progress("adjusting", 0, 1)
        result = self.calibrate_images(images)
        first = next(iter(views.frames()))
        progress("adjusting", 1, 1)
        pictures = {name: image for name, image in zip(views.names, first.images, strict=True) if image is not None}
        return replace(result, pictures=pictures)

    def calibrate_images(self, images: BarImages) -> Calibrated:
        """Adjusts measured images of a bar.

        Raises:
            CalibrationError: they are too few or do not fit together.
        """
        adjustment, chosen = self.adjusted(images)
        bars = adjustment.state.objects
        assert isinstance(bars, Bars)
        seen = _determined(adjustment)
        ends = np.where(seen[..., None], bars.ends, np.nan)
        middle = np.nanmedian(ends.reshape(-1, 3), axis=0)
        frames = images.frames[chosen].astype(np.float64)
        _, motion, source = self.world.placed(Rig(adjustment.cameras), (frames, ends), middle)
        adjustment = adjustment.in_world(motion)
        n_bars = int(seen.all(axis=1).sum())
        return Calibrated(
            kind="reference_bar",
            adjustment=adjustment,
            n_objects=n_bars,
            measures=(*self._measures(adjustment), *lag_measures(adjustment)),
            advice=(*advice(adjustment, "bar", n_bars), *lag_advice(adjustment)),
            world=source,
            scale=f"length_m = {self._length():g}",
            points=transformed(motion, ends).reshape(-1, 3),
        )

    def adjusted(self, images: BarImages) -> tuple[Adjustment, Mask]:
        """The bundle adjustment from scratch, and (B,) the positions that two views or more show.

        Raises:
            CalibrationError: the images are too few or do not fit together.
        """
        bar = self._length(), self.sigma_length_m
        shown: Mask = np.asarray(np.isfinite(images.pixels).all(axis=3))
        chosen: Mask = np.asarray((shown.sum(axis=0) >= 2).any(axis=1))
        speeds = images.velocities()[:, chosen]
        pixels = np.where(shown[..., None], images.pixels, np.nan)[:, chosen]
        found = _start(pixels, speeds, bar, [self._nominal(images, factor) for factor in self._factors()], images.names)
        offsets, sigmas = time_offsets(found.state, found.observations, self.sigma_px)
        check_synchronized(images.names, offsets, sigmas)
        views = list(zip(images.names, images.sizes, strict=True))
        late = np.nan_to_num(np.abs(offsets) - NOTICED_SIGMAS * sigmas).max() > NOTICED_FRAMES
        groups = (*self.estimated, "time_offset") if late else self.estimated
        wanted = chosen_unknowns(groups, len(views))
        return self_calibrated(found.state, found.observations, wanted, self.sigma_px, views), chosen

    def _length(self) -> float:
        if self.length_m is None:
            raise CalibrationError(
                "the length of the bar is not given: without it the scale of the rig is unknown; measure the distance "
                "of the targets' centres and set length_m in [calibration]"
            )
        return self.length_m

    def _factors(self) -> tuple[float, ...]:
        return (1.0, 0.93, 1.07) if self.focal_px is not None else _FOCAL_GUESSES

    def _nominal(self, images: BarImages, factor: float) -> Array:
        """(V, 26) cameras with the focal lengths given, or a multiple of the image width."""
        states = []
        for name, size in zip(images.names, images.sizes, strict=True):
            given = self.focal_px.get(name) if isinstance(self.focal_px, dict) else self.focal_px
            if given is None and self.focal_px is not None:
                raise CalibrationError(f'focal_px: none for view "{name}"; give one for every view, or none at all')
            if given is not None and not given > 0:
                raise CalibrationError(f'focal_px = {given:g} for view "{name}", expected a positive number of px')
            if given is not None and (fault := focal_fault(given, name, size)):
                raise CalibrationError(fault)
            states.append(nominal_state(size, factor * (given if given is not None else size[0])))
        return np.stack(states)

    def _measures(self, adjustment: Adjustment) -> tuple[Measure, ...]:
        bars = adjustment.state.objects
        assert isinstance(bars, Bars)
        held_out = self._hold_out(adjustment)
        return (
            Measure(
                "hold-out bar RMS",
                1000 * float(np.sqrt(np.mean(held_out**2))) if len(held_out) else float("nan"),
                "mm",
                f"error of the length of {len(held_out)} bars that took no part in the calibration",
            ),
            Measure(
                "hold-out bar bias",
                1000 * float(np.mean(held_out)) if len(held_out) else float("nan"),
                "mm",
                "their mean error: far from 0 the scale is wrong",
            ),
        )

    def _hold_out(self, adjustment: Adjustment) -> Array:
        """(K,) errors of the length of bars that are measured with a calibration made without them, metres."""
        bars, observations = adjustment.state.objects, adjustment.observations
        assert isinstance(bars, Bars)
        owners = observations.points // 2
        held = owners % self.hold_out_every == self.hold_out_every - 1
        views = list(zip(adjustment.names, adjustment.sizes, strict=True))
        try:
            other = self_calibrated(adjustment.state, observations.chosen(~held), adjustment.free, self.sigma_px, views)
        except CalibrationError:
            return np.zeros(0)
        pixels = np.full((len(views), len(bars.ends) * 2, 2), np.nan)
        judged = observations.chosen(held & adjustment.used)
        lags = other.state.cameras[judged.views, BundleCameraRow.DELAY]
        # where a view that looks late would have seen the target together with the others
        pixels[judged.views, judged.points] = judged.pixels - lags[:, None] * judged.velocities
        points, _ = Rig(other.cameras).triangulate(pixels)
        ends = points.reshape(-1, 2, 3)
        errors = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) - self._length()
        result: Array = errors[np.isfinite(errors)]
        return result


@dataclass(frozen=True)
class _Start:
    """Start values and the observations with the views' labels made equal."""

    state: State
    observations: Observations
    spread: float
    """Median deviation of the bars' length from the known one, as a share of it."""


def _start(
    pixels: Array, speeds: Array, bar: tuple[float, float], nominals: list[Array], names: tuple[str, ...]
) -> _Start:
    """Start values from the first guess of focal lengths that leads to bars of one length, else from the best."""
    found: list[_Start] = []
    fault: CalibrationError | None = None
    for nominal in nominals:
        try:
            state, flipped = start_values(pixels, nominal, bar, names)
        except CalibrationError as error:
            fault = fault or error
            continue
        bars = state.objects
        assert isinstance(bars, Bars)
        spread = float(np.nanmedian(np.abs(bars.lengths / bar[0] - 1)))
        lost = np.nanmedian(bars.ends.reshape(-1, 3), axis=0)
        ends = np.where(np.isfinite(bars.ends), bars.ends, lost)
        turn = flipped[:, None, None, None]
        observations = bar_observations(
            np.where(turn, pixels[:, :, ::-1], pixels), np.where(turn, speeds[:, :, ::-1], speeds)
        )
        found.append(_Start(replace(state, objects=Bars(ends, *bar)), observations, spread))
        if spread < 0.01:
            break
    if not found:
        assert fault is not None
        raise fault
    return min(found, key=lambda start: start.spread)


def _determined(adjustment: Adjustment) -> Mask:
    """(B, 2) ends with two good images or more."""
    counted = adjustment.observations.counted(adjustment.used, len(adjustment.state.objects.points))
    return np.asarray((counted >= 2).reshape(-1, 2))
