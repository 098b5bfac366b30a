"""TRC, the text table of Motion Analysis that OpenSim, Pose2Sim and most marker systems write."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tracker.arrays import Array
from tracker.errors import SequenceError, nearest, shortened
from tracker.markers import METRES_PER_UNIT, Markers, without_gaps
from tracker.source_files import text_of

# Lines of the format: kind, keys, their values, names of the markers, axes; the table begins after them.
_KEYS, _VALUES, _NAMES, _TABLE = 1, 2, 3, 5

_FIRST_CELLS = 2
"""Frame number and time stand before the markers."""

_LARGEST_BYTES = 2**29
"""An hour of 60 markers at 120 Hz has 700 MB; whoever has longer ones splits them."""


def read_trc(path: Path) -> Markers:
    """Reads a TRC file; an empty cell, `NaN` or a position of zeros is a gap.

    Raises:
        SequenceError: the file is damaged, or its unit is unknown.
    """
    lines = text_of(path, SequenceError, "the markers", _LARGEST_BYTES).splitlines()
    if len(lines) <= _TABLE or not lines[0].startswith("PathFileType"):
        raise SequenceError(f"{path}: not a TRC file: expected PathFileType and five lines of header")
    header = dict(zip(lines[_KEYS].split("\t"), lines[_VALUES].split("\t"), strict=False))
    unit = header.get("Units", "").strip().lower()
    if unit not in METRES_PER_UNIT:
        raise SequenceError(f'{path}: Units is "{shortened(unit)}"; {nearest(unit, METRES_PER_UNIT)}')
    names = tuple(cell.strip() for cell in lines[_NAMES].split("\t")[_FIRST_CELLS:] if cell.strip())
    if not names:
        raise SequenceError(f"{path}: no marker is named in line {_NAMES + 1}")
    rows = [(n, line.split("\t")) for n, line in enumerate(lines[_TABLE:], start=_TABLE + 1) if line.strip()]
    if not rows:
        raise SequenceError(f"{path}: the table is empty")
    values = np.array([_numbers(path, n, cells, _FIRST_CELLS + 3 * len(names)) for n, cells in rows])
    _check_times(path, values[:, 1])
    points = values[:, _FIRST_CELLS:].reshape(len(values), len(names), 3)
    return Markers(names, values[:, 1], METRES_PER_UNIT[unit] * without_gaps(points))


def _numbers(path: Path, line: int, cells: list[str], n_wanted: int) -> Array:
    """(n,) of a row; cells that are empty, or were left out at its end, are NaN."""
    full = [cell.strip() for cell in cells]
    if any(full[n_wanted:]):
        raise SequenceError(f"{path}: {len(full)} cells in line {line}, expected at most {n_wanted}")
    full = full[:n_wanted] + [""] * (n_wanted - len(full))
    try:
        return np.array([float(cell) if cell else np.nan for cell in full])
    except ValueError:
        wrong = next(cell for cell in full if cell and not _is_number(cell))
        raise SequenceError(f"{path}: {shortened(wrong)!r} in line {line}, expected a number") from None


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _check_times(path: Path, times_s: Array) -> None:
    wrong = np.flatnonzero(~np.isfinite(times_s) | (np.diff(times_s, prepend=-np.inf) <= 0))
    if len(wrong) or len(times_s) < 2:
        where = f"in row {wrong[0] + 1} of the table" if len(wrong) else "in a table of one row"
        raise SequenceError(f"{path}: Time does not run forwards {where}")
