"""Points followed through a sequence: what is known of each in every frame."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from tracker.foundation.arrays import Array, Integers, Mask


class PointStatus(IntEnum):
    """Source of a point's position in a frame."""

    HIDDEN = 0
    """Not seen; searched in every frame."""

    FOLLOWED = 1
    """Matched with its key patch."""

    REKEYED = 2
    """Matched with the frame before, in a view or more: the key patch did not fit any more and was replaced."""

    FOUND_AGAIN = 3
    """Seen for the first time after having been hidden: matched where its neighbours expect it."""

    BORN = 4
    """New in this frame."""


@dataclass(frozen=True)
class PointFrame:
    """N followed points in one frame of V views."""

    index: int
    time_s: float

    ids: Integers
    """(N,) numbers that points keep for life; no two points ever have the same."""

    pixels: Array
    """(V, N, 2) px, NaN where a view does not show the point."""

    sigmas_px: Array
    """(V, N, 2) standard deviations of the pixels against the point of the birth, px."""

    positions: Array
    """(N, 3) in the world, metres; NaN for hidden points, and for all in 2-D mode."""

    covariances: Array
    """(N, 3, 3) m^2, of the matching and of all key patches since the point's birth."""

    drift_px: Array
    """(N,) standard deviation that the replaced key patches add up to, the worst view and axis, px."""

    status: Integers
    """(N,) see `PointStatus`."""

    born: Integers
    """(N,) frame numbers of the points' births."""

    keys: Integers
    """(V, N) frame numbers of the images that the key patches were cut from."""

    @property
    def alive(self) -> Mask:
        """(N,) points that are seen."""
        alive: Mask = self.status != PointStatus.HIDDEN
        return alive


@dataclass(frozen=True)
class PointTrajectories:
    """N points over T frames, in V views."""

    frames: Integers
    """(T,) frame numbers, consecutive."""

    times: Array
    """(T,) seconds."""

    ids: Integers
    """(N,)"""

    born: Integers
    """(N,) frame numbers of the points' births."""

    positions: Array
    """(T, N, D) metres in space, or px in the image of one view; NaN where a point is not seen."""

    covariances: Array
    """(T, N, D, D) of the positions."""

    pixels: Array
    """(T, V, N, 2) px; NaN where a view does not show a point."""

    keys: Integers
    """(T, V, N) frame numbers of the images that the key patches were cut from; -1 where a point is not seen."""

    drift_px: Array
    """(T, N) standard deviation that the replaced key patches add up to, the worst view and axis, px."""

    status: Integers
    """(T, N) see `PointStatus`."""

    @property
    def sigmas(self) -> Array:
        """(T, N, D) standard deviations of the coordinates."""
        deviations: Array = np.sqrt(np.diagonal(self.covariances, axis1=2, axis2=3))
        return deviations

    @property
    def seen(self) -> Mask:
        """(T, N) where a point has a position."""
        seen: Mask = np.isfinite(self.positions[..., 0])
        return seen

    @property
    def flat(self) -> bool:
        """Whether the trajectories lie in the image of one view."""
        return bool(self.positions.shape[2] == 2)
