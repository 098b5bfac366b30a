"""Trajectories of points as files: CSV, PLY, TRC and C3D; and read from tables again."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tracker.foundation.arrays import Array, Integers, Mask, frozen
from tracker.foundation.c3d_format import c3d_library, check_frames
from tracker.foundation.errors import SequenceError, nearest
from tracker.foundation.files import csv_lines as rows_as_csv
from tracker.foundation.files import replacing
from tracker.foundation.source_files import cells_of, check_commas, one_line
from tracker.points.following.record import Motion
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


# Trajectories read from the tables that a following writes, or that another program has written like them.

TABLE = "trajectories.csv"
"""The table in a result folder of `bodytrack follow`."""

_LEAST_SIGMA_PX, _LEAST_SIGMA_M = 0.05, 0.0001
"""A point is no better known than this: in 2-D mode the sigma at its birth is 0, for there it is what it is."""

_FARTHEST_FRAME = 10**9
"""A year at 30 frames a second."""

_MOST_CELLS, _FULLEST = 10**7, 0.1
"""Frames times points beyond which a table is refused of whose frames fewer than this share are there at all: what is
numbered so is no frame, but a time."""

Words = NDArray[np.str_]


@dataclass(frozen=True)
class PointTable:
    """N points over T frames, as far as a table tells."""

    frames: Integers
    """(T,) frame numbers, consecutive."""

    times: Array
    """(T,) seconds."""

    ids: Integers
    """(N,) the numbers of the points; places in the alphabet where they have names."""

    positions: Array
    """(T, N, D) metres in space, or px in the image of one view; NaN where a point is not seen."""

    covariances: Array
    """(T, N, D, D) of the positions."""

    @property
    def seen(self) -> Mask:
        """(T, N) where a point has a position."""
        seen: Mask = np.isfinite(self.positions[..., 0])
        return seen

    @property
    def flat(self) -> bool:
        """Whether the points lie in the image of one view."""
        return bool(self.positions.shape[2] == 2)


def read_trajectories(path: Path) -> PointTable:
    """Reads `trajectories.csv`: `frame, time_s, point`, then place and sigmas in m, or in px of one view.

    Args:
        path: the table, or the result folder that it lies in.

    Raises:
        SequenceError: there is none, or not what it should be.
    """
    table = path / TABLE if path.is_dir() else path
    if not table.is_file():
        beside = [one.name for one in table.parent.glob("*.csv")] if table.parent.is_dir() else []
        raise SequenceError(f"{table}: no such table of followed points; {nearest(table.name, beside)}")
    head, *rows = cells_of(table, SequenceError) or [[]]
    if not rows:
        raise SequenceError(f"{table}: the table is empty")
    check_commas(head, table, SequenceError)
    for n, row in enumerate(rows, start=1):
        if len(row) != len(head):
            raise SequenceError(f"{table}: {len(row)} cells in row {n}, expected {len(head)}, one a column")
    return _arranged(head, rows, table)


def _arranged(head: list[str], rows: list[list[str]], path: Path) -> PointTable:
    """Arrays (T, N, ...) of rows in any order; frames between the first and the last are all there."""
    unit, axes, least = ("px", "xy", _LEAST_SIGMA_PX) if "x_px" in head else ("m", "xyz", _LEAST_SIGMA_M)
    n_axes = len(axes)
    numbers = _numbers(head, rows, ("frame", "time_s"), path)
    places = _numbers(head, rows, [f"{axis}_{unit}" for axis in axes], path)
    sigmas = _numbers(head, rows, [f"sigma_{axis}_{unit}" for axis in axes], path)
    if (sigmas < 0).any():
        bad = int(np.flatnonzero((sigmas < 0).any(axis=1))[0]) + 1
        raise SequenceError(f"{path}: row {bad} has a negative sigma, expected standard deviations in {unit}")
    spread = np.maximum(sigmas, least)[:, :, None] ** 2 * np.eye(n_axes)
    if {"cov_xy_m2", "cov_xz_m2", "cov_yz_m2"} <= set(head):
        i, j = np.triu_indices(n_axes, 1)
        spread[:, i, j] = spread[:, j, i] = _numbers(head, rows, ("cov_xy_m2", "cov_xz_m2", "cov_yz_m2"), path)
    labels: Words = np.array([row[_column(head, "point", path)] for row in rows])
    # 19 digits are more than a number holds, and there are digits that are none: ²
    numbered = bool((np.char.isdecimal(labels) & (np.char.str_len(labels) < 19)).all())
    names, n = np.unique(labels.astype(np.int64) if numbered else labels, return_inverse=True)
    whole = _whole(numbers[:, 0], path)
    known, first = np.unique(whole, return_index=True)
    n_frames = int(known[-1] - known[0]) + 1
    if n_frames * len(names) > _MOST_CELLS and len(known) < _FULLEST * n_frames:
        raise SequenceError(
            f'{path}: "frame" is {known[0]} to {known[-1]} in a table of {len(known)} frames, expected their numbers '
            "in the recording"
        )
    pairs, n_rows = np.unique(np.stack([whole, n]), axis=1, return_counts=True)
    if n_rows.max() > 1:
        frame, point = pairs[:, n_rows.argmax()]
        raise SequenceError(f"{path}: point {names[point]} is there twice in frame {frame}, expected once")
    frames = np.arange(known[0], known[-1] + 1)
    positions = np.full((len(frames), len(names), n_axes), np.nan)
    covariances = np.full((len(frames), len(names), n_axes, n_axes), np.nan)
    positions[whole - frames[0], n], covariances[whole - frames[0], n] = places, spread
    ids = names.astype(np.int64) if numbered else np.arange(len(names), dtype=np.int64)
    times = np.interp(frames, known, numbers[first, 1])
    return PointTable(frames, frozen(times), ids, frozen(positions), frozen(covariances))


def _whole(values: Array, path: Path) -> Integers:
    """The numbers of frames."""
    bad = (values != np.floor(values)) | (np.abs(values) > _FARTHEST_FRAME)
    if bad.any():
        raise SequenceError(f'{path}: "frame" is {values[bad][0]:.15g}, expected a whole number')
    return values.astype(np.int64)


def _column(head: list[str], name: str, path: Path) -> int:
    if name not in head:
        raise SequenceError(f'{path}: no column "{name}"; {nearest(name, head)}')
    if head.count(name) > 1:
        raise SequenceError(f'{path}: {head.count(name)} columns are called "{name}", expected one')
    return head.index(name)


def _numbers(head: list[str], rows: list[list[str]], names: list[str] | tuple[str, ...], path: Path) -> Array:
    """(rows, names) finite numbers."""
    columns = [_column(head, name, path) for name in names]
    try:
        values = np.array([[float(row[k]) for k in columns] for row in rows])
    except ValueError as error:
        raise SequenceError(f"{path}: {one_line(error)}") from error
    bad = ~np.isfinite(values).all(axis=1)
    if bad.any():
        n = int(np.flatnonzero(bad)[0]) + 1
        raise SequenceError(f"{path}: row {n} has a value that is not finite; leave rows of hidden points out")
    return values


# Trajectories as marker files for programs of biomechanics: TRC and C3D.


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
"""Setting of a configuration that asks for the file, for messages."""
