"""What pictures and marker files show of all trajectories, gathered window by window."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from tracker.foundation.arrays import Array, Integers
from tracker.points.following.marker_files import Markers
from tracker.points.following.motion import Motion
from tracker.points.following.windows import Window
from tracker.points.trajectories import PointStatus

# More lines are a carpet; of long recordings fewer are drawn, for the time that it takes.
_MOST_LINES, _MOST_STEPS = 3000, 400_000


@dataclass(frozen=True)
class Overview:
    """Of T frames."""

    n_with_status: Integers
    """(T, 5) points with each status; the first column, hidden ones, is empty."""

    steps: Array
    """(S, 2, D) both ends of the steps to be drawn."""

    speeds: Array
    """(S,) at their ends, units of the positions a second."""


@dataclass
class Gathering:
    """An overview that is being gathered."""

    n_frames: int
    markers: Integers
    """(M,) ids of the points for marker files."""

    n_with_status: list[Integers] = field(default_factory=list)
    steps: list[Array] = field(default_factory=list)
    speeds: list[Array] = field(default_factory=list)
    positions: list[Array] = field(default_factory=list)
    sigmas: list[Array] = field(default_factory=list)

    def add(self, window: Window, motion: Motion) -> None:
        """The next window."""
        own, inner = window.trajectories, window.inner
        status = np.where(own.seen, own.status, 0)[inner]
        self.n_with_status.append(np.stack([(status == kind).sum(axis=1) for kind in range(len(PointStatus))], axis=1))
        self.n_with_status[-1][:, int(PointStatus.HIDDEN)] = 0
        self._add_steps(window, motion)
        if not own.flat:
            columns = np.searchsorted(own.ids, self.markers)
            known = np.isin(self.markers, own.ids)
            places, sigmas = own.positions[inner], np.sqrt((own.sigmas[inner] ** 2).sum(axis=2))
            shape = (len(places), len(self.markers))
            self.positions.append(np.full((*shape, 3), np.nan))
            self.sigmas.append(np.full(shape, np.nan))
            self.positions[-1][:, known] = places[:, columns[known]]
            self.sigmas[-1][:, known] = sigmas[:, columns[known]]

    def _add_steps(self, window: Window, motion: Motion) -> None:
        own, inner = window.trajectories, window.inner
        share = min(_MOST_LINES, _MOST_STEPS // self.n_frames) / max(len(own.ids), 1)
        # a fixed shuffle of the ids: the same trajectories in all windows
        chosen = np.flatnonzero((own.ids * 2654435761) % 2**32 < share * 2**32)
        ends = np.arange(max(inner.start, 1), inner.stop)
        steps = np.stack([own.positions[ends - 1][:, chosen], own.positions[ends][:, chosen]], axis=2)
        known = np.isfinite(steps).all(axis=(2, 3))
        self.steps.append(steps[known])
        self.speeds.append(np.nan_to_num(np.linalg.norm(motion.velocities[ends][:, chosen], axis=2)[known]))

    def overview(self) -> Overview:
        """Of all windows."""
        n_with_status = np.concatenate(self.n_with_status)
        return Overview(n_with_status, np.concatenate(self.steps), np.concatenate(self.speeds))

    def as_markers(self, labels: tuple[str, ...], times: Array) -> Markers:
        """Of all windows."""
        return Markers(labels, times, np.concatenate(self.positions), np.concatenate(self.sigmas))
