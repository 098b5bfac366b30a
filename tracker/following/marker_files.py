"""Trajectories as marker files for programs of biomechanics: TRC and C3D."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tracker.files import replacing
from tracker.following.tables import Names
from tracker.point_trajectories import PointTrajectories
from tracker.recording.c3d import c3d_library


def chosen_markers(trajectories: PointTrajectories, names: Names, most: int) -> PointTrajectories:
    """Named points, then those seen in most frames, no more than so many; in the order of their ids."""
    named = np.isin(trajectories.ids, list(names))
    order = np.lexsort((trajectories.ids, -trajectories.seen.sum(axis=0), ~named))
    return trajectories.select(np.sort(order[:most]))


def trc_text(trajectories: PointTrajectories, names: Names, file_name: str) -> str:
    """Trajectories in space as TRC, metres; NaN where a point is not seen."""
    labels, rate = _labels(trajectories, names), f"{_rate_hz(trajectories):.6g}"
    n_frames = str(len(trajectories.times))
    lines = [
        f"PathFileType\t4\t(X/Y/Z)\t{file_name}",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames",
        "\t".join([rate, rate, n_frames, str(len(labels)), "m", rate, "1", n_frames]),
        "Frame#\tTime\t" + "\t\t\t".join(labels) + "\t\t",
        "\t\t" + "\t".join(f"{axis}{k}" for k in range(1, len(labels) + 1) for axis in "XYZ"),
        "",
    ]
    for k, (time_s, places) in enumerate(zip(trajectories.times, trajectories.positions, strict=True), start=1):
        cells = ("NaN" if value != value else f"{value:.6f}" for value in places.ravel().tolist())
        lines.append(f"{k}\t{time_s:.6f}\t" + "\t".join(cells))
    return "\n".join(lines) + "\n"


def write_c3d(path: Path, trajectories: PointTrajectories, names: Names) -> None:
    """Trajectories in space as C3D, millimetres.

    The residual of a point is its standard deviation in space, rounded up to whole mm, at most 127; -1 where the point
    is not seen. Frames count from 1; the time of the first one is not part of the format.

    Raises:
        ConfigError: ezc3d is not installed.
    """
    file = c3d_library(C3D_ASKED).c3d()
    point, seen = file["parameters"]["POINT"], trajectories.seen
    point["RATE"]["value"], point["UNITS"]["value"] = [_rate_hz(trajectories)], ["mm"]
    point["LABELS"]["value"] = _labels(trajectories, names)
    file.add_parameter("MANUFACTURER", "COMPANY", ["bodytrack"])
    n_frames, n_points = seen.shape
    file["data"]["points"] = np.ones((4, n_points, n_frames))
    file["data"]["points"][:3] = 1000 * trajectories.positions.transpose(2, 1, 0)
    deviations_mm = 1000 * np.sqrt((trajectories.sigmas**2).sum(axis=2))
    residuals = np.where(seen, np.clip(np.ceil(np.nan_to_num(deviations_mm)), 1, 127), -1)
    file["data"]["meta_points"] = {
        "residuals": residuals.T[None],
        "camera_masks": np.zeros((7, n_points, n_frames), dtype=np.bool_),
    }
    with replacing(path) as unfinished:
        file.write(str(unfinished))


C3D_ASKED = "c3d = true"
"""How a configuration asks for the file, for messages."""


def _labels(trajectories: PointTrajectories, names: Names) -> list[str]:
    return [names.get(int(number), f"p{number}") for number in trajectories.ids]


def _rate_hz(trajectories: PointTrajectories) -> float:
    steps = np.diff(trajectories.times)
    return float(1 / np.median(steps)) if len(steps) else 1.0
