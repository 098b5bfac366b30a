"""A recording of a marker system: trajectories of markers, in its own world and by its own clock."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tracker.foundation.arrays import Array, Mask, frozen, shape_fault
from tracker.foundation.errors import SequenceError, nearest, shortened
from tracker.foundation.source_files import METRES_PER_UNIT, metres_in


@dataclass(frozen=True)
class Markers:
    """Trajectories of the markers.

    Raises:
        SequenceError: the arrays do not fit one another, or time does not run forwards.
    """

    names: tuple[str, ...]
    """Names of the M markers in the file."""

    times_s: Array
    """(T,) seconds of the marker system's clock, increasing."""

    points: Array
    """(T, M, 3) metres in the marker system's world, NaN where a marker was not seen."""

    remarks: tuple[str, ...] = ()
    """Remarks about entries of the file that are not read, or contradict each other."""

    def __post_init__(self) -> None:
        fault = shape_fault(self.points, len(self.times_s), len(self.names), 3)
        if fault:
            raise SequenceError(f"markers: {fault}")
        if len(self.times_s) < 2 or not (np.diff(self.times_s) > 0).all():
            raise SequenceError("markers: expected two frames or more, each later than the one before")
        object.__setattr__(self, "times_s", frozen(self.times_s))
        object.__setattr__(self, "points", frozen(self.points))

    @property
    def rate_hz(self) -> float:
        """Usual frame rate."""
        return 1.0 / float(np.median(np.diff(self.times_s)))

    @property
    def gaps(self) -> float:
        """Share of the positions that are missing."""
        return float(np.isnan(self.points[..., 0]).mean())


def without_gaps(points: Array) -> Array:
    """Points (..., 3) of a file with NaN where a position is incomplete, endless, or exactly the origin.

    Marker systems without a sign for gaps write zeros; no person wears a marker at the origin to the last digit.
    """
    missing: Mask = ~(np.abs(points) < _ENDLESS).all(axis=-1) | (points == 0).all(axis=-1)
    kept: Array = np.where(missing[..., None], np.nan, points)
    return kept


_ENDLESS = 1e20
"""In any unit: NDI's systems (Optotrak, Polaris) write -3.697314e28 for a hidden marker."""


def metres_per_unit(path: Path, entry: str, found: str, told: str | None) -> float:
    """Metres in the unit of a file.

    Args:
        path: of the file, for messages.
        entry: of the file that names the unit, for messages.
        found: its value; empty if it is missing.
        told: unit in the marker set, which takes precedence.

    Raises:
        SequenceError: neither names a unit, or it is not a unit of length.
    """
    if not found and told is None:
        raise SequenceError(f'{path}: {entry} is missing: set it in the marker set, for instance unit = "mm"')
    metres = metres_in(told or found)
    if metres is None:
        raise SequenceError(f'{path}: {entry} is "{shortened(found)}"; {nearest(found, METRES_PER_UNIT)}')
    return metres


def check_size(path: Path, recording: Markers) -> None:
    """Refuses markers whose unit cannot be right: angles would agree in any unit.

    Raises:
        SequenceError: they are closer together than those of a hand, or farther apart than any laboratory is long.
    """
    places = recording.points[np.isfinite(recording.points[..., 0]).sum(axis=1) > 1]
    if not len(places):
        return
    spans_m = np.linalg.norm(np.nanmax(places, axis=1) - np.nanmin(places, axis=1), axis=1)
    span_m = float(np.median(spans_m))
    if not _SMALLEST_M < span_m < _LARGEST_M:
        raise SequenceError(
            f"{path}: its markers lie {span_m:.3g} m apart, expected {_SMALLEST_M:g} to {_LARGEST_M:g}: the unit is "
            'wrong, set it in the marker set, for instance unit = "m"'
        )


_SMALLEST_M, _LARGEST_M = 0.03, 100.0
"""Limits of the extent: a person of 1.8 m in the next smaller unit, centimetres, is 0.018 m; the largest halls have 60
m."""
