"""What a following leaves of its trajectories: tables, clouds, and files for programs that read markers."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

import numpy as np

from tracker.foundation.arrays import Array, Integers
from tracker.foundation.files import replacing, write_whole
from tracker.points.following.filters import Cuts
from tracker.points.following.key_points import KEY_POINTS_HEADER, Surroundings, followed_key_points, key_points_csv
from tracker.points.following.record import REACH_FRAMES, Motion, Rows, Window, between, motion_of, windows
from tracker.points.following.report import Gathering, Overview
from tracker.points.following.tables import Names, csv_header, csv_lines, marker_labels, ply_bytes, trc_text, write_c3d

Around = Callable[[Integers, Array], Surroundings]
"""The points around the key points, of the ids (N,) and positions (N, 3) m in the first frame."""


@dataclass(frozen=True)
class TrajectoryFiles:
    """Which files are written."""

    views: tuple[str, ...]
    """Names of the views that were followed in; one alone for 2-D mode, which has a table and nothing else."""

    names: Names
    """Of points that have one."""

    around: Around | None
    """None where there are no key points."""

    cloud_frames: int
    """Frames from one PLY cloud to the next; 0 for none."""

    most_markers: int
    """Points in TRC and C3D."""

    c3d: bool
    """Whether to write C3D beside TRC."""

    def write(self, folder: Path, record: tuple[Rows, Integers, Array], cuts: Cuts) -> Overview:
        """Goes through the record once.

        Args:
            folder: where the files go.
            record: sightings, all frame numbers (T,), and their times (T,) s.
            cuts: of its trajectories.

        Returns:
            What pictures show of them.
        """
        flat, times = len(self.views) == 1, record[2]
        markers = cuts.longest(np.array(list(self.names), dtype=np.int64), 0 if flat else self.most_markers)
        gathering = Gathering(len(times), markers)
        with contextlib.ExitStack() as files:
            table = _opened(files, folder / "trajectories.csv", csv_header(self.views))
            places = _opened(files, folder / "key_points.csv", KEY_POINTS_HEADER) if self.around else None
            first = between(record[0], int(record[1][0]), int(record[1][0]) + 1)
            # before the cuts, as when the following began: what these leave may be too few
            around = self.around(first["id"].astype(np.int64), first["position"]) if self.around else None
            for window in windows(*record, 2 * REACH_FRAMES, cuts.relabelled):
                own, motion = window.trajectories, motion_of(window.trajectories)
                gathering.add(window, motion)
                table.writelines(csv_lines(own, motion, self.names, window.inner))
                self._write_clouds(folder, window, motion)
                if places is not None and around is not None:
                    found = followed_key_points(own, around)
                    places.writelines(key_points_csv(found, own.frames, own.times, window.inner))
        if not flat:
            shown = gathering.as_markers(marker_labels(markers, self.names), times)
            write_whole(folder / "trajectories.trc", trc_text(shown, "trajectories.trc"))
            if self.c3d:
                write_c3d(folder / "trajectories.c3d", shown)
        return gathering.overview()

    def _write_clouds(self, folder: Path, window: Window, motion: Motion) -> None:
        own = window.trajectories
        for t in range(*window.inner.indices(len(own.frames))):
            if not own.flat and self.cloud_frames and own.frames[t] % self.cloud_frames == 0:
                write_whole(folder / f"points_{own.frames[t]:06d}.ply", ply_bytes(own, motion, t))


def _opened(files: contextlib.ExitStack, path: Path, header: str) -> TextIO:
    """A table that is there as a whole when the stack is left."""
    file = files.enter_context(files.enter_context(replacing(path)).open("w", encoding="utf-8"))
    file.write(header)
    return file
