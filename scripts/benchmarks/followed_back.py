"""Points followed on the moving back: how far they are from where they truly are, and what that is to be."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from rich.table import Table

from benchmarks.moving_back import Back, Change, Start
from tracker.foundation.arrays import Array, Mask
from tracker.points.following.following import Following
from tracker.points.following.sequence import follow
from tracker.points.surfaces.surface import Preparation
from tracker.points.trajectories import PointFrame

# As issue and paper have: points on the shirt, and what counts as another material point.
N_POINTS, WRONG_MM = 1500, 5.0


@dataclass(frozen=True)
class Errors:
    """Of the last frame."""

    distance_mm: Array
    """(N,) NaN for points that are not seen."""

    visible: Mask
    """(N,) points that all views show in all frames."""

    @property
    def median_mm(self) -> float:
        """Of the points that are seen."""
        return float(np.nanmedian(self.distance_mm))

    @property
    def left(self) -> float:
        """Of the visible points, %."""
        return 100 * float(np.isfinite(self.distance_mm[self.visible]).mean())

    @property
    def wrong(self) -> float:
        """Of the points that are seen, %."""
        kept = self.distance_mm[np.isfinite(self.distance_mm)]
        return 100 * float((kept > WRONG_MM).mean())

    def rows(self, table: Table, name: str, judged: bool = True) -> None:
        """Adds them to a table."""
        note = f"{self.visible.sum()} visible points"
        for what, value, unit, aim, more in (
            ("left of those visible throughout", self.left, "%", 95.0, True),
            ("median error", self.median_mm, "mm", 0.20, False),
            (f"more than {WRONG_MM:g} mm off", self.wrong, "%", 0.1, False),
        ):
            add_row(table, f"{name}: {what}", value, unit, aim if judged else None, more, note)


def errors_of(start: Start, last: PointFrame) -> Errors:
    """How far the points are off in a frame."""
    distance = 1000 * np.linalg.norm(last.positions - start.positions[last.index], axis=1)
    visible: Mask = np.asarray(start.visible[: last.index + 1].all(axis=(0, 1)))
    return Errors(distance, visible)


def followed(
    back: Back, start: Start, following: Following, change: Change | None = None
) -> tuple[list[PointFrame], float]:
    """Follows points through the recording.

    Args:
        back: the recording.
        start: the points.
        following: how.
        change: what is done to the images first.

    Returns:
        All frames, and CPU seconds a frame without reading images.
    """
    frames, seconds = [], 0.0
    stream = follow(following, Preparation(), back.rig, back.frames(change), lambda frame: start.new)
    while True:
        begin = time.process_time()
        step = next(stream, None)
        if step is None:
            break
        frames.append(step[0])
        # The first frame begins and the second compiles.
        seconds += time.process_time() - begin if len(frames) > 2 else 0.0
    begin = time.process_time()
    for _ in back.frames(change):
        pass
    reading = time.process_time() - begin
    return frames, seconds / max(len(frames) - 2, 1) - reading / len(frames)


def add_row(
    table: Table, name: str, value: float, unit: str, aim: float | None = None, more: bool = False, note: str = ""
) -> None:
    """A row of a table of four columns: its name, what was measured, what it is to be, and a note.

    Args:
        table: that it is added to.
        name, value, unit: of what was measured.
        aim: None where nothing is asked of it.
        more: whether the aim is the least, else it is the most.
        note: what else there is to say.
    """
    text = f"{value:.3f} {unit}"
    if aim is None:
        table.add_row(name, text, "", note)
        return
    good = value >= aim if more else value <= aim
    table.add_row(name, f"[{'green' if good else 'red'}]{text}[/]", f"{'>=' if more else '<='} {aim:g}", note)
