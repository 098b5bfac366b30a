"""Compares views by the tracked persons: the delay of each view, and the turn of its camera.

A camera that runs 10 ms late, or was touched after calibration, does not show: poses are a compromise between the
views, and look like poses. A moving body shows both. In a late view contours lie behind those of the model by the
movement meanwhile; in a turned view they lie beside them for any movement.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tracker.cameras.rig import Rig
from tracker.foundation.arrays import Array
from tracker.results.alignment._equations import without_common_motion
from tracker.results.alignment.moments import MOST_MOMENTS

__all__ = ["DelayChange", "ViewAlignment", "beside_most"]

_LATE_FRAMES = 0.2
"""Least delay against the mean of the views that counts, frames. Among 90 results of recordings in step one had 0.14,
of a person who moved slowly, the others 0.1 at most. Four recordings with views 13, -8 and 19 ms late, of 40, had 0.23
to 0.33, and were tracked 4 to 15 mm worse. All had `MOST_MOMENTS` or more: misfits of a body scatter less over many. In
ten moments of a dry run, with a scaled body, views in step seemed 0.2 frames late, twelve deviations."""

_LATE_M = 0.004
"""Least mean movement of the joints during a delay that counts, metres. A recording in step in which only forearms turn
seemed to have a view 0.19 frames late, 2 mm; the four late recordings had 9 to 25 mm."""

_TURNED_PX = 1.5
"""Least turn that counts, px at the middle of an image that shows a person some 300 px high. Of the same 90 none had
more than 0.8 except the real man, whose calibration was estimated twice: 1.6 to 3.0. Tracked with the turned rig, he
leaves over 4.3 px of contour instead of 4.6. Cameras turned by 0.2 degrees had 1.2 to 2.6."""

_CHANGED_FRAMES = 0.5
"""Least change of a view's delay during a recording that counts, frames."""

_SURE = 5.0
"""Standard deviations from which on all these count."""

_TO_BRING = "bring the poses to one moment with `bodytrack result align RESULT`"
_BROUGHT = "poses are those of the first view's moment; better synchronize the cameras"


@dataclass(frozen=True)
class DelayChange:
    """Changed delays: a view dropped or repeated frames, or its clock runs at another rate."""

    between: tuple[int, int]
    """Numbers of the frames before and after the change."""

    before_s: Array
    """(V,) delay of each view against the first one before the change, seconds."""

    after_s: Array
    """(V,) the same after it."""

    sigmas_s: Array
    """(V,) standard deviations of `steps_s`."""

    @property
    def steps_s(self) -> Array:
        """(V,) change of each view's delay, seconds."""
        return self.after_s - self.before_s

    def likely(self, interval_s: float) -> bool:
        """Whether a view's delay changes significantly, and by more than frames scatter."""
        return bool((np.abs(self.steps_s) > np.maximum(_CHANGED_FRAMES * interval_s, _SURE * self.sigmas_s)).any())

    def told(self, names: tuple[str, ...], brought: bool = False) -> str:
        """The finding, in one line; see `ViewAlignment.findings`."""
        last, first = self.between
        v = int(np.argmax(np.abs(self.steps_s)))
        step_ms = 1000 * float(self.steps_s[v])
        return (
            f"{names[v]} runs {abs(step_ms):.0f} ms {'later' if step_ms > 0 else 'earlier'} from some frame between "
            f"{last} and {first} on than before: it dropped or repeated frames, or its clock runs at another rate; "
            f"{_BROUGHT if brought else 'repair its images, or ' + _TO_BRING}"
        )


def beside_most(delays: Array) -> Array:
    """Delays (..., V) without the part that most views have in common; with two views, without the first one's."""
    if delays.shape[-1] == 2:
        return delays - delays[..., :1]
    return delays - np.median(delays, axis=-1, keepdims=True)


@dataclass(frozen=True)
class ViewAlignment:
    """Delays of the views, and turns of their cameras against the rig."""

    rig: Rig
    """The rig of the tracking."""

    interval_s: float
    """Time from one frame to the next, seconds."""

    delays_s: Array
    """(V,) delay of each view's frame against the first view's, seconds."""

    delay_sigmas_s: Array
    """(V,) their standard deviations; 0 of the first view."""

    turns: Array
    """(V, 3) rotation vector, in camera coordinates, from the rig's camera to the one that the persons show, rad."""

    turn_sigmas: Array
    """(V, 3) their standard deviations."""

    n_moments: int
    """Number of frames and persons used."""

    middle: Array
    """(3,) position of the persons, metres."""

    speed_m_per_s: float
    """Mean speed of the joints there, see `tracker.results.alignment.moments.speed`."""

    change: DelayChange | None = None
    """Change of delays during the recording, if there is one; `delays_s` is then a compromise."""

    @cached_property
    def late_frames(self) -> Array:
        """(V,) delays against the mean of the views, frames."""
        late: Array = (self.delays_s - self.delays_s.mean()) / self.interval_s
        return late

    @property
    def out_of_step(self) -> bool:
        """Whether views are late, significantly and by an amount that matters."""
        sigmas, most = float(self.delay_sigmas_s.max()) / self.interval_s, float(np.abs(self.late_frames).max())
        matters = most * self.interval_s * self.speed_m_per_s > _LATE_M
        least = _LATE_FRAMES * max(1.0, float(np.sqrt(MOST_MOMENTS / max(self.n_moments, 1))))
        return matters and most > max(least, _SURE * sigmas)

    @property
    def late(self) -> bool:
        """Whether poses are not of one moment: views are out of step, throughout or from some frame on."""
        return self.out_of_step or self.change is not None

    def delays_at(self, frame: int) -> Array:
        """(V,) delays of the views in a frame with a number, seconds."""
        if self.change is None:
            return self.delays_s
        return self.change.before_s if frame <= self.change.between[0] else self.change.after_s

    @cached_property
    def turned_px(self) -> Array:
        """(V,) how far turns move the middle of each image, px; without what moving the persons would do as well."""
        moved = np.linalg.norm(without_common_motion(self.rig, self.turns, self.middle), axis=1)
        shown: Array = moved * [camera.matrix[0, 0] for camera in self.rig.cameras]
        return shown

    @property
    def turned(self) -> tuple[str, ...]:
        """Views whose cameras are turned, beyond doubt and by what matters."""
        sigmas = self.turn_sigmas.max(axis=1) * [camera.matrix[0, 0] for camera in self.rig.cameras]
        least = np.maximum(_TURNED_PX, _SURE * sigmas)
        return tuple(name for name, px, low in zip(self.rig.names, self.turned_px, least, strict=True) if px > low)

    def findings(self, brought: bool = False) -> tuple[str, ...]:
        """What can hardly be right, in one line each, and what to do; none where all is as it should be.

        Args:
            brought: the run has brought its poses to the moment of the first view.
        """
        told = []
        if self.change is not None:
            told.append(self.change.told(self.rig.names, brought))
        elif self.out_of_step:
            first, *others = self.rig.names
            late = ", ".join(f"{n} {1000 * s:+.0f} ms" for n, s in zip(others, self.delays_s[1:], strict=True))
            told.append(
                f"views are out of step with {first} by parts of a frame: {late}; "
                f"{_BROUGHT if brought else 'synchronize the cameras, or ' + _TO_BRING}"
            )
        if self.turned:
            degrees = np.degrees(np.linalg.norm(self.turns, axis=1))
            beside = ", ".join(
                f"{name} {degrees[v]:.2f} degrees ({self.turned_px[v]:.1f} px)"
                for v, name in enumerate(self.rig.names)
                if name in self.turned
            )
            told.append(
                f"cameras are turned against the calibration: {beside}; calibrate again, or track with the rig that "
                "`bodytrack result align RESULT --rig turned.toml` writes"
            )
        return tuple(told)
