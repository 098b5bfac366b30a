"""Trajectories of points as files: CSV for everything, PLY clouds of single frames."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from tracker.foundation.arrays import Array
from tracker.foundation.files import csv_lines as rows_as_csv
from tracker.points.following.motion import Motion
from tracker.points.trajectories import PointStatus, PointTrajectories

Names = Mapping[int, str]
"""Names of points that have one, by id."""


def csv_header(views: tuple[str, ...]) -> str:
    """Names of the columns, with units; `views` are those that points are followed in."""
    flat = len(views) == 1
    unit, axes = ("px", "xy") if flat else ("m", "xyz")
    columns = ["frame", "time_s", "point", "status", "born", "key", "drift_px"]
    kinds = [("", unit), ("sigma_", unit), ("v", f"{unit}_s"), ("sigma_v", f"{unit}_s")]
    kinds += [("a", f"{unit}_s2"), ("sigma_a", f"{unit}_s2")]
    columns += [f"{prefix}{axis}_{suffix}" for prefix, suffix in kinds for axis in axes]
    columns += [] if flat else [f"cov_{pair}_m2" for pair in ("xy", "xz", "yz")]
    columns += [] if flat else [f"{view}_{axis}_px" for view in views for axis in "xy"]
    return ",".join(map(quoted, columns)) + "\n"


def quoted(text: str) -> str:
    """A text as a cell of a CSV table: in quotes where it has a comma, a quote or an end of line in it."""
    return rows_as_csv([[text]]).removesuffix("\r\n")


def csv_lines(trajectories: PointTrajectories, motion: Motion, names: Names, inner: slice) -> Iterator[str]:
    """A row for each point and frame that shows it, of some of the frames; see `csv_header`.

    `key` is the frame of the newest key patch that the point is known by in any view, `drift_px` the standard deviation
    that new keys have added up to since its birth.
    """
    axes = "xy" if trajectories.flat else "xyz"
    values = [trajectories.positions, trajectories.sigmas, motion.velocities, motion.velocity_sigmas]
    values += [motion.accelerations, motion.acceleration_sigmas]
    digits = ["%.6f"] * (2 * len(axes)) + ["%.5g"] * (4 * len(axes))
    n_frames, n_points = trajectories.status.shape
    if not trajectories.flat:
        values += [trajectories.covariances[:, :, (0, 0, 1), (1, 2, 2)]]
        values += [trajectories.pixels.swapaxes(1, 2).reshape(n_frames, n_points, 2 * trajectories.pixels.shape[1])]
        digits += ["%.4g"] * 3 + ["%.3f"] * (2 * trajectories.pixels.shape[1])
    labels = [quoted(names.get(int(number), str(number))) for number in trajectories.ids]
    words = {int(status): status.name.lower() for status in PointStatus}
    row, keys = ",".join(digits), trajectories.keys.max(axis=1)
    for t in range(*inner.indices(n_frames)):
        table = np.concatenate([kind[t] for kind in values], axis=1)
        lead = f"{trajectories.frames[t]},{trajectories.times[t]:.6f}"
        for n in np.flatnonzero(trajectories.seen[t]):
            origin = f"{trajectories.born[n]},{keys[t, n]},{trajectories.drift_px[t, n]:.4f}"
            numbers = (row % tuple(table[n])).replace("nan", "")
            yield f"{lead},{labels[n]},{words[int(trajectories.status[t, n])]},{origin},{numbers}\n"


def ply_bytes(trajectories: PointTrajectories, motion: Motion, t: int) -> bytes:
    """The points that a frame shows, with velocities and sigmas, as binary PLY in metres."""
    seen = np.flatnonzero(trajectories.seen[t])
    names = "x", "y", "z", "vx", "vy", "vz", "sigma"
    vertices = np.zeros(len(seen), dtype=[*((name, "<f4") for name in names), ("point", "<i4")])
    sigma: Array = np.sqrt((trajectories.sigmas[t, seen] ** 2).sum(axis=1))
    table = np.concatenate(
        [trajectories.positions[t, seen], np.nan_to_num(motion.velocities[t, seen]), sigma[:, None]], axis=1
    )
    for k, name in enumerate(names):
        vertices[name] = table[:, k]
    vertices["point"] = trajectories.ids[seen]
    header = ["ply", "format binary_little_endian 1.0", "comment metres; v: m/s, 0 where unknown; sigma: point error"]
    header += [f"element vertex {len(seen)}", *(f"property float {name}" for name in names), "property int point"]
    return ("\n".join([*header, "end_header"]) + "\n").encode("ascii") + vertices.tobytes()
