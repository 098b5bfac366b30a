"""Markers and segments for Visual3D, Mokka, MATLAB and others that read C3D; needs the package ezc3d."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

import numpy as np

from tracker.bodies.body import BodyModel
from tracker.foundation.arrays import Array
from tracker.foundation.c3d_format import c3d_library, check_frames
from tracker.foundation.configuration.components import component
from tracker.foundation.files import replacing
from tracker.results.recording import RunContext
from tracker.results.recording._motion import Y_UP, Motion, MotionRecorder, markers_of

# By the format.
_BLOCK_BYTES = 512
_ROTATION_FLOATS = 17
"""Numbers of a ROTATION signal in a frame: a 4x4 matrix column by column, and its reliability."""

_POINT_BYTES = 16
"""Numbers of a point in a frame: x, y, z and residual."""

_LAST_BLOCK = 2**15 - 1
"""Last block in which a ROTATION signal may begin: a parameter of two bytes with a sign."""

_MOST_DESCRIPTIONS = 255
"""Most texts of a list: its number is one byte. ezc3d goes on in LABELS2, but with more descriptions it wrote files
that no program reads."""

_MOST_PARAMETER_BLOCKS = 256
"""Most blocks before the points: their number is one byte."""

log = logging.getLogger("tracker")


@component
class C3d:
    """`NAME.c3d` for each person: points as in TRC, millimetres, and a ROTATION signal `SEGMENT_4X4` of each segment.

    The residual of a point is its standard deviation in space, rounded up to whole mm; -1 in lost frames. The
    reliability of a rotation, its 17th value (C-Motion's convention), is the explained share of the segment's visible
    contour. It is 0 if the segment is hidden, or the pose or the limb in doubt, and -1 if the person is lost. The
    format holds 65535 frames, and rotations only behind points of up to 16 MB, 15 000 to 25 000 frames; in longer runs
    the rotations are left out, and the log says so.
    """

    y_up: bool = False
    """Turn the axes for programs whose y points up: x, z, -y. The file says which axis is up in either case."""

    def begin(self, run: RunContext) -> MotionRecorder:
        """Collects the poses; the files are written at the end.

        Raises:
            ConfigError: ezc3d is not installed, or the run has more frames than the format holds.
        """
        c3d_library()
        check_frames(run.n_frames, 'recording "c3d"')
        return MotionRecorder(run, self._written)

    def _written(self, motion: Motion, folder: Path) -> Path:
        motion = motion.even()
        path = folder / f"{motion.name}.c3d"
        n_frames, n_markers = len(motion.q), len(markers_of(motion.body))
        check_frames(n_frames, path.name)
        file, whole = _content(motion, self.y_up), _block_of_rotations(n_frames, n_markers) <= _LAST_BLOCK
        if whole:
            _add_rotations(file, motion, self.y_up)
        else:
            log.warning("%s: rotations of segments are left out: %d frames are too many for them", path.name, n_frames)
        with replacing(path) as unfinished:
            file.write(str(unfinished))
            if whole:
                _write_reliabilities(unfinished, _reliabilities(motion), n_markers)
        return path


def _content(motion: Motion, y_up: bool) -> Any:
    markers, turn = markers_of(motion.body), Y_UP if y_up else np.eye(3)
    rate, n_frames = 1 / motion.interval_s, len(motion.q)
    file = c3d_library().c3d()
    point = file["parameters"]["POINT"]
    point["RATE"]["value"], point["UNITS"]["value"] = [rate], ["mm"]
    point["LABELS"]["value"] = [marker.name for marker in markers]
    point["DESCRIPTIONS"]["value"] = [marker.segment for marker in markers[:_MOST_DESCRIPTIONS]]
    for axis, word in (("X_SCREEN", "+X"), ("Y_SCREEN", "+Y" if y_up else "+Z")):
        file.add_parameter("POINT", axis, [word])
    file.add_parameter("MANUFACTURER", "COMPANY", ["bodytrack"])
    file["data"]["points"] = np.ones((4, len(markers), n_frames))
    points = np.where(motion.lost[:, None, None], np.nan, motion.points(motion.q, markers))
    file["data"]["points"][:3] = 1000 * (points @ turn.T).transpose(2, 1, 0)
    file["data"]["meta_points"] = {
        "residuals": _residuals(motion).T[None],
        "camera_masks": np.zeros((7, len(markers), n_frames), dtype=np.bool_),
    }
    return file


def _add_rotations(file: Any, motion: Motion, y_up: bool) -> None:
    file["data"]["rotations"] = _rotations(motion, Y_UP if y_up else np.eye(3))
    names, rate = [f"{segment.name}_4X4" for segment in motion.body.segments], 1 / motion.interval_s
    for key, value in (("LABELS", names), ("RATE", [rate]), ("USED", [len(names)]), ("FRAMES", [len(motion.q)])):
        file.add_parameter("ROTATION", key, value)


def _rotations(motion: Motion, turn: Array) -> Array:
    """(4, 4, S, T) placements of the segments, millimetres; NaN where the person is lost."""
    placed = motion.segments(motion.q)
    # Only the world is turned: a segment's own axes stay those of the reference pose.
    placed[..., :3, :3] = turn @ placed[..., :3, :3]
    placed[..., :3, 3] = 1000 * placed[..., :3, 3] @ turn.T
    placed[motion.lost] = np.nan
    rotations: Array = placed.transpose(2, 3, 1, 0)
    return rotations


def _residuals(motion: Motion) -> Array:
    """(T, M) whole mm, 1 to 127; 0 where the standard deviation is unknown, -1 where the person is lost."""
    sigmas_mm = np.ceil(1000 * motion.sigmas(markers_of(motion.body)))
    residuals = np.where(np.isfinite(sigmas_mm), np.clip(sigmas_mm, 1, 127), 0)
    return np.where(motion.lost[:, None], -1, residuals)


def _reliabilities(motion: Motion) -> Array:
    """(T, S) 0 to 1, -1 where the person is lost."""
    columns = [_mean_share(motion.body, motion.shares, segment.name) for segment in motion.body.segments]
    return np.where(motion.lost[:, None], -1.0, np.stack(columns, axis=1))


def _mean_share(body: BodyModel, shares: Array, segment: str) -> Array:
    own = shares[:, [part.segment == segment for part in body.parts]]
    n_visible = np.isfinite(own).sum(axis=1)
    mean: Array = np.nansum(own, axis=1) / np.maximum(n_visible, 1)
    return mean


def _block_of_rotations(n_frames: int, n_markers: int, points_block: int = _MOST_PARAMETER_BLOCKS + 2) -> int:
    """The block, counted from 1, in which ezc3d begins the rotations: the second one after the last full one of points.

    Without the block of the points it is the latest possible one.
    """
    return points_block + n_frames * n_markers * _POINT_BYTES // _BLOCK_BYTES + 1


def _write_reliabilities(path: Path, reliabilities: Array, n_markers: int) -> None:
    """Puts the 17th values into a written file, because ezc3d's Python interface leaves them 0."""
    content = bytearray(path.read_bytes())
    points_block = int.from_bytes(content[16:18], "little")  # the ninth word of the header
    start = _block_of_rotations(len(reliabilities), n_markers, points_block)
    values = np.frombuffer(
        content, dtype="<f4", count=reliabilities.size * _ROTATION_FLOATS, offset=(start - 1) * _BLOCK_BYTES
    )
    values.reshape(*reliabilities.shape, _ROTATION_FLOATS)[..., -1] = reliabilities
    path.write_bytes(content)
