"""The unit of length of a marker file: what the marker set says, or else what the file says, and whether it can be."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tracker.foundation.errors import SequenceError, nearest, shortened
from tracker.foundation.lengths import METRES_PER_UNIT, metres_in
from tracker.results.markers import Markers


def metres_per_unit(path: Path, entry: str, found: str, told: str | None) -> float:
    """Metres in the unit of a file.

    Args:
        path: of the file, for messages.
        entry: of the file that names the unit, for messages.
        found: what stands there; empty where nothing does.
        told: what the marker set says, which counts.

    Raises:
        SequenceError: nobody says it, or it is no unit of length.
    """
    if not found and told is None:
        raise SequenceError(f'{path}: {entry} is missing: say it in the marker set, for instance unit = "mm"')
    metres = metres_in(told or found)
    if metres is None:
        raise SequenceError(f'{path}: {entry} is "{shortened(found)}"; {nearest(found, METRES_PER_UNIT)}')
    return metres


def check_size(path: Path, recording: Markers) -> None:
    """Refuses markers that no unit of the file's can be right for: angles would agree in any unit.

    Raises:
        SequenceError: they lie nearer together than those of a hand, or farther apart than in any laboratory.
    """
    places = recording.points[np.isfinite(recording.points[..., 0]).sum(axis=1) > 1]
    if not len(places):
        return
    spans_m = np.linalg.norm(np.nanmax(places, axis=1) - np.nanmin(places, axis=1), axis=1)
    span_m = float(np.median(spans_m))
    if not _SMALLEST_M < span_m < _LARGEST_M:
        raise SequenceError(
            f"{path}: its markers lie {span_m:.3g} m apart, expected {_SMALLEST_M:g} to {_LARGEST_M:g}: its unit is "
            'another one, say it in the marker set, for instance unit = "m"'
        )


_SMALLEST_M, _LARGEST_M = 0.03, 100.0
"""A person of 1.8 m in the next smaller unit, centimetres, is 0.018 m; the largest halls have 60 m."""
