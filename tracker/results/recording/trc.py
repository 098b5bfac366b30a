"""Joint centres and surface markers for OpenSim, Pose2Sim and others that read TRC."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tracker.foundation.configuration.components import component
from tracker.foundation.files import write_whole
from tracker.results.recording import RunContext
from tracker.results.recording._motion import Y_UP, Motion, MotionRecorder, exported_name, markers_of, trc_text


@component
class Trc:
    """`NAME.trc` for each person: landmarks and three surface points a segment, metres; NaN in lost frames.

    OpenSim's inverse kinematics stops at a frame without any marker: give it the time ranges in between.
    """

    y_up: bool = False
    """Turn the axes for programs whose y points up, like OpenSim: x, z, -y."""

    def begin(self, run: RunContext) -> MotionRecorder:
        """Collects the poses; the files are written at the end."""
        return MotionRecorder(run, self._written)

    def _written(self, motion: Motion, folder: Path) -> Path:
        path = folder / f"{motion.name}.trc"
        write_whole(path, _content(path.name, motion, self.y_up))
        return path


def _content(name: str, motion: Motion, y_up: bool) -> bytes:
    markers = markers_of(motion.body)
    points = np.where(motion.lost[:, None, None], np.nan, motion.points(motion.q, markers))
    if y_up:
        points = points @ Y_UP.T
    names = [exported_name(marker.name) for marker in markers]
    return trc_text(name, names, motion.times_s, motion.interval_s, points)
