"""Trajectories as marker files for programs of biomechanics: TRC and C3D."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tracker.foundation.arrays import Array, Integers
from tracker.foundation.c3d_format import c3d_library, check_frames
from tracker.foundation.files import replacing
from tracker.points.following.tables import Names


@dataclass(frozen=True)
class Markers:
    """M points in T frames, as programs of biomechanics want them."""

    labels: tuple[str, ...]

    times: Array
    """(T,) seconds."""

    positions: Array
    """(T, M, 3) metres; NaN where a point is not seen."""

    sigmas_m: Array
    """(T, M) standard deviations in space."""

    @property
    def rate_hz(self) -> float:
        """Frames a second."""
        steps = np.diff(self.times)
        return float(1 / np.median(steps)) if len(steps) else 1.0


def marker_labels(ids: Integers, names: Names) -> tuple[str, ...]:
    """(M,) the names of points, or their ids."""
    return tuple(names.get(int(number), f"p{number}") for number in ids)


def trc_text(markers: Markers, file_name: str) -> str:
    """Trajectories in space as TRC, metres; NaN where a point is not seen."""
    rate, n_frames, n_points = f"{markers.rate_hz:.6g}", str(len(markers.times)), len(markers.labels)
    lines = [
        f"PathFileType\t4\t(X/Y/Z)\t{file_name}",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames",
        "\t".join([rate, rate, n_frames, str(n_points), "m", rate, "1", n_frames]),
        "Frame#\tTime\t" + "\t\t\t".join(markers.labels) + "\t\t",
        "\t\t" + "\t".join(f"{axis}{k}" for k in range(1, n_points + 1) for axis in "XYZ"),
        "",
    ]
    for k, (time_s, places) in enumerate(zip(markers.times, markers.positions, strict=True), start=1):
        cells = ("NaN" if value != value else f"{value:.6f}" for value in places.ravel().tolist())
        lines.append(f"{k}\t{time_s:.6f}\t" + "\t".join(cells))
    return "\n".join(lines) + "\n"


def write_c3d(path: Path, markers: Markers) -> None:
    """Trajectories in space as C3D, millimetres.

    The residual of a point is its standard deviation in space, rounded up to whole mm, at most 127; -1 where the point
    is not seen. Frames count from 1; the time of the first one is not part of the format.

    Raises:
        ConfigError: ezc3d is not installed, or there are more frames than the format holds.
    """
    check_frames(len(markers.times), C3D_ASKED)
    file = c3d_library(C3D_ASKED).c3d()
    point, seen = file["parameters"]["POINT"], np.isfinite(markers.positions[..., 0])
    point["RATE"]["value"], point["UNITS"]["value"] = [markers.rate_hz], ["mm"]
    point["LABELS"]["value"] = list(markers.labels)
    file.add_parameter("MANUFACTURER", "COMPANY", ["bodytrack"])
    n_frames, n_points = seen.shape
    file["data"]["points"] = np.ones((4, n_points, n_frames))
    file["data"]["points"][:3] = 1000 * markers.positions.transpose(2, 1, 0)
    residuals = np.where(seen, np.clip(np.ceil(1000 * np.nan_to_num(markers.sigmas_m)), 1, 127), -1)
    file["data"]["meta_points"] = {
        "residuals": residuals.T[None],
        "camera_masks": np.zeros((7, n_points, n_frames), dtype=np.bool_),
    }
    with replacing(path) as unfinished:
        file.write(str(unfinished))


C3D_ASKED = "c3d = true"
"""How a configuration asks for the file, for messages."""
