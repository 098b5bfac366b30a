"""C3D, the binary format of biomechanics: points, and segments of programs that write only rotations."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np

from tracker.foundation.arrays import Array
from tracker.foundation.errors import SequenceError, shortened
from tracker.foundation.source_files import metres_in
from tracker.results.marker_layouts._c3d_file import (
    C3dFile,
    first_frame,
    is_c3d,
    n_segments_of,
    open_c3d,
    origins_of,
    points_of,
)
from tracker.results.markers import Markers, metres_per_unit, without_gaps

__all__ = ["is_c3d", "read_c3d"]

_RATES_APART = 0.01
"""Largest share by which POINT:RATE and the header's rate may differ without a remark."""


def read_c3d(path: Path, unit: str | None = None) -> Markers:
    """Reads a C3D file; a negative residual, NaN or a position of zeros is a gap. Time begins with its first frame.

    The origins of segments that the group ROTATION holds come behind the points, by their own names (`pelvis_4X4`).

    Args:
        path: of the file.
        unit: of its lengths; None for the file's own.

    Raises:
        SequenceError: the file is damaged, has neither points with names nor segments, or its unit is unknown.
    """
    file = open_c3d(path)
    rate_hz, remarks = _rate(file)
    n_points, n_segments = file.count("POINT:USED", file.n_points), n_segments_of(file)
    if not n_points and not n_segments:
        held = ": analog signals alone" if file.count("ANALOG:USED", file.n_analog) else ""
        raise SequenceError(f"{path}: POINT:USED is 0: no markers in it{held}")
    labels = file.texts("POINT:LABELS")
    if not n_points or (n_segments and not any(labels)):
        if n_points:
            remarks += (f"{path.name}: {n_points} points have no names (POINT:LABELS), and are left out",)
        names, points, own_rate_hz = _segments(file, n_segments, 0, rate_hz, unit)
        return _markers(file, names, points, rate_hz or own_rate_hz, own_rate_hz, remarks)
    names, points, said = _points(file, n_points, labels, rate_hz, unit)
    remarks += said
    if n_segments:
        try:
            segments, origins, own_rate_hz = _segments(file, n_segments, len(points), rate_hz, unit)
        except SequenceError as error:
            return _markers(file, names, points, rate_hz, rate_hz, (*remarks, f"segments are left out: {error}"))
        origins = origins[:: max(round(own_rate_hz / rate_hz), 1)]
        if len(origins) == len(points):
            names, points = names + segments, np.concatenate([points, origins], axis=1)
        else:
            remarks += (f"{path.name}: segments are left out: they have {len(origins)} frames of {len(points)}",)
    return _markers(file, names, points, rate_hz, rate_hz, remarks)


def _markers(
    file: C3dFile, names: list[str], points: Array, base_hz: float, rate_hz: float, remarks: tuple[str, ...]
) -> Markers:
    """The markers; frames are numbered at the base rate, that of the points."""
    if len(points) < 2 or not 0 < rate_hz < np.inf:
        raise SequenceError(
            f"{file.path}: {len(points)} frames at {rate_hz:g} Hz by POINT:FRAMES and POINT:RATE, cannot be"
        )
    times_s = first_frame(file) / base_hz + np.arange(len(points)) / rate_hz
    return Markers(tuple(names), times_s, without_gaps(points), remarks)


def _rate(file: C3dFile) -> tuple[float, tuple[str, ...]]:
    """Frame rate, and a remark if the file has two; 0 if it has none."""
    told, header = file.value("POINT:RATE", 0.0), file.rate_hz
    if not 0 < told < np.inf:
        return (header if 0 < header < np.inf else 0.0), ()
    if header > 0 and abs(header / told - 1) > _RATES_APART:
        return told, (
            f"POINT:RATE of {file.path.name} is {told:g} Hz, its header says {header:g} Hz: POINT:RATE counts",
        )
    return told, ()


def _points(
    file: C3dFile, n_points: int, labels: tuple[str, ...], rate_hz: float, unit: str | None
) -> tuple[list[str], Array, tuple[str, ...]]:
    """Names, points (T, M, 3) in metres, and remarks; points without a name or a unit of length are left out."""
    if not any(labels):
        raise SequenceError(f"{file.path}: POINT:LABELS is missing: {n_points} points in it have no names")
    if not rate_hz:
        raise SequenceError(f"{file.path}: POINT:RATE is missing, and 0 in the header: how many frames a second?")
    places, remarks = points_of(file, n_points, rate_hz)
    names = [*labels, *[""] * n_points][:n_points]
    metres, others = _metres(file, n_points, unit)
    unnamed = names.count("")
    if unnamed:
        remarks += (f"{file.path.name}: {unnamed} of {n_points} points have no name, and are left out",)
    if others:
        told = ", ".join(f"{number} in {shortened(other)!r}" for other, number in others.items())
        remarks += (f"{file.path.name}: points that are no lengths are left out: {told}",)
    kept = [k for k, name in enumerate(names) if name and np.isfinite(metres[k])]
    return [names[k] for k in kept], places[:, kept] * metres[kept, None], remarks


def _metres(file: C3dFile, n_points: int, unit: str | None) -> tuple[Array, Counter[str]]:
    """Metres (M,) in the unit of each point, NaN if it is not of length, and the number of points of each other unit.

    Raises:
        SequenceError: none is a unit of length, or there are several, and not one for each point.
    """
    units = file.texts("POINT:UNITS")
    known = [found for found in units if found]
    if len(set(known)) <= 1 or not any(metres_in(found) for found in known):
        return np.full(n_points, metres_per_unit(file.path, "POINT:UNITS", next(iter(known), ""), unit)), Counter()
    if len(units) < n_points:
        raise SequenceError(f"{file.path}: POINT:UNITS has {len(units)} units for {n_points} points: whose are they?")
    metres = np.array([metres_in(found) or np.nan for found in units[:n_points]])
    others = Counter(found for found in units[:n_points] if metres_in(found) is None)
    return metres, others


def _segments(
    file: C3dFile, n_segments: int, n_frames: int, rate_hz: float, unit: str | None
) -> tuple[list[str], Array, float]:
    """Names, origins (T, S, 3) in metres, and frames a second of segments."""
    labels = file.texts("ROTATION:LABELS")
    if len(labels) < n_segments or not all(labels[:n_segments]):
        raise SequenceError(f"{file.path}: ROTATION:LABELS is missing: {n_segments} segments in it have no names")
    origins, own_rate_hz = origins_of(file, n_segments, n_frames, rate_hz)
    known = (found for found in file.texts("POINT:UNITS") if found)
    metres = metres_per_unit(file.path, "POINT:UNITS", next((u for u in known if metres_in(u)), ""), unit)
    return list(labels[:n_segments]), metres * origins, own_rate_hz
