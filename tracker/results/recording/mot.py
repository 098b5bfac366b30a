"""The pose parameters as coordinates of the OpenSim model that `osim` writes."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tracker.foundation.configuration.components import component
from tracker.foundation.files import write_whole
from tracker.results.recording import RunContext
from tracker.results.recording._motion import Motion, MotionRecorder, exported_name


@component
class Mot:
    """`NAME.mot` for each person: every pose parameter in degrees or metres, with its name in the model.

    It moves the model of `NAME.osim`, whose coordinates are these parameters. Lost frames are interpolated.
    """

    def begin(self, run: RunContext) -> MotionRecorder:
        """Collects the poses; the files are written at the end."""
        return MotionRecorder(run, _written, "mot")


def _written(motion: Motion, folder: Path) -> Path:
    path = folder / f"{motion.name}.mot"
    motion.told_filled(path)
    q = np.where(motion.body.rotates, np.degrees(np.unwrap(motion.filled, axis=0)), motion.filled)
    header = [
        motion.name,
        "version=1",
        f"nRows={len(q)}",
        f"nColumns={1 + motion.body.dof}",
        "inDegrees=yes",
        "endheader",
    ]
    lines = [*header, "\t".join(("time", *map(exported_name, motion.body.names)))]
    for time_s, row in zip(motion.times_s, q, strict=True):
        lines.append(f"{time_s:.8f}\t" + "\t".join(f"{value:.8f}" for value in row))
    write_whole(path, "\n".join(lines) + "\n")
    return path
