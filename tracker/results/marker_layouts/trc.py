"""TRC, the text table of Motion Analysis that OpenSim, Pose2Sim and most marker systems write."""

from __future__ import annotations

import codecs
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tracker.foundation.arrays import Array
from tracker.foundation.errors import SequenceError, shortened
from tracker.foundation.source_files import content_of, is_gap, metres_in
from tracker.results.markers import Markers, metres_per_unit, without_gaps

# Lines of the format: kind, keys, their values, names of the markers, axes; the table begins after them.
_KEYS, _VALUES, _NAMES, _AXES, _TABLE = 1, 2, 3, 4, 5

_FIRST_CELLS = 2
"""Columns before the markers: frame number and time."""

_LARGEST_BYTES = 2**29
"""Largest size: an hour of 60 markers at 120 Hz has 700 MB."""

_LINE_END = re.compile(r"\r*\n|\r")
"""Line ends of any system, and doubled ones of a file copied as text; a letter of the path is none."""

_FILE_END = "\x1a\0 \t\r\n"
"""Characters that may follow the last row: DOS ends a text with Ctrl-Z, and fills it up to a block."""

_AXIS = re.compile(r"^([xyz])\d*$", re.IGNORECASE)
"""`X1` and so on, with any number."""

# Rate of the header times a step of Time: told from so much on, refused where Time must count frames or milliseconds.
_RATES_APART, _OTHER_UNIT = 1.01, 20.0


@dataclass(frozen=True)
class _Row:
    """A line of the table."""

    line: int
    """Number of the line, from 1 on."""

    cells: list[str]


def read_trc(path: Path, unit: str | None = None) -> Markers:
    """Reads a TRC file; an empty cell, not a number in any spelling, or a position of zeros is a gap.

    Args:
        path: of the file.
        unit: of its lengths; None for the file's own.

    Raises:
        SequenceError: the file is damaged, or its unit is unknown.
    """
    lines = _LINE_END.split(_text(path).rstrip(_FILE_END))
    if lines[0].lstrip().startswith("PathFileType,"):  # of a spreadsheet that put commas for tabs
        lines = [line.replace(",", "\t") for line in lines]
    if not lines[0].lstrip().startswith("PathFileType") or len(lines) <= _AXES:
        raise SequenceError(f"{path}: not a TRC file: expected PathFileType and five lines of header")
    names, rows = _names(path, lines), _rows(path, lines)
    header = _header(path, lines, len(rows), len(names))
    metres = metres_per_unit(path, "Units in line 3", header.get("Units", ""), unit)
    values = np.array([_numbers(path, row, _FIRST_CELLS + 3 * len(names)) for row in rows])
    _check_times(path, rows, values[:, 1])
    remarks = _remarks(path, header, names, values[:, 1])
    named = [k for k, name in enumerate(names) if name]
    points = values[:, _FIRST_CELLS:].reshape(len(values), len(names), 3)[:, named]
    return Markers(tuple(names[k] for k in named), values[:, 1], metres * without_gaps(points), remarks)


def _text(path: Path) -> str:
    """Text of a file in UTF-8, in UTF-16 with its mark, or else in an 8-bit code, as in paths and names."""
    content = content_of(path, SequenceError, "the markers", _LARGEST_BYTES)
    wide = content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    try:
        return content.decode("utf-16" if wide else "utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("latin-1")


def _cells(line: str) -> list[str]:
    return [cell.strip(' "') for cell in (line.split("\t") if "\t" in line else line.split())]


def _header(path: Path, lines: list[str], n_rows: int, n_markers: int) -> dict[str, str]:
    """Key -> value of the header; cells may be padded with further tabs, as in an example of OpenSim's."""
    places, cells = _cells(lines[_KEYS]), _cells(lines[_VALUES])
    keys, values = ([cell for cell in found if cell] for found in (places, cells))
    if len(keys) == len(values):
        return dict(zip(keys, values, strict=True))
    in_place = dict(zip(places, cells, strict=False))
    if len(cells) >= len(places) == len(keys) and not any(cells[len(keys) :]) and metres_in(in_place.get("Units", "")):
        return in_place
    missing = _missing(keys, values, n_rows, n_markers) if len(values) == len(keys) - 1 else []
    raise SequenceError(
        f"{path}: line {_VALUES + 1} has {len(values)} values for the {len(keys)} names in line {_KEYS + 1}"
        + (f": {_one_of(missing)} is missing" if missing else "")
    )


def _missing(keys: list[str], values: list[str], n_rows: int, n_markers: int) -> list[str]:
    """Keys without which the values fit the others: a unit of length, and the numbers of rows and markers."""
    fitting = []
    for key in keys:
        header = dict(zip((other for other in keys if other != key), values, strict=True))
        fits = _counts(header, "NumFrames", n_rows) and _counts(header, "NumMarkers", n_markers)
        if fits and ("Units" not in header or metres_in(header["Units"])):
            fitting.append(key)
    return fitting


def _one_of(keys: list[str]) -> str:
    return keys[0] if len(keys) == 1 else f"one of {', '.join(keys)}"


def _counts(header: dict[str, str], key: str, count: int) -> bool:
    """Whether an entry, if present, is a number of things that exist."""
    try:
        return float(header.get(key, count)) == count
    except ValueError:
        return False


def _names(path: Path, lines: list[str]) -> list[str]:
    """Names of the markers, in the order of the columns; empty for a column without a name."""
    cells = _cells(lines[_NAMES])
    head = [k for k, cell in enumerate(cells) if cell][:_FIRST_CELLS]
    if [cells[k].lower().strip("#") for k in head] != ["frame", "time"]:
        told = shortened(lines[_NAMES].strip())
        raise SequenceError(f'{path}: line {_NAMES + 1} is "{told}", expected Frame#, Time and names of markers')
    axes = [_AXIS.sub(r"\1", cell).upper() for cell in _cells(lines[_AXES]) if cell]
    if not axes or axes != ["X", "Y", "Z"] * (len(axes) // 3):
        told = shortened(lines[_AXES].strip())
        raise SequenceError(f'{path}: line {_AXES + 1} is "{told}", expected X1, Y1, Z1 and so on of every marker')
    n_markers, below = len(axes) // 3, cells[head[1] + 1 :]
    placed = {k: cell for k, cell in enumerate(below) if cell}
    if not placed:
        raise SequenceError(f"{path}: no marker is named in line {_NAMES + 1}")
    if all(k % 3 == 0 and k < 3 * n_markers for k in placed):
        return [placed.get(3 * k, "") for k in range(n_markers)]
    if len(placed) != n_markers:  # names in the right number have their order, whatever tabs are between
        raise SequenceError(
            f"{path}: line {_NAMES + 1} names {len(placed)} markers, line {_AXES + 1} has the axes of {n_markers}"
        )
    return list(placed.values())


def _rows(path: Path, lines: list[str]) -> list[_Row]:
    """The table; commas are decimal if there is no point at all."""
    below = [(n, line) for n, line in enumerate(lines[_TABLE:], start=_TABLE + 1) if line.strip()]
    if not below:
        raise SequenceError(f"{path}: the table is empty")
    if not any("." in line for _, line in below):
        below = [(n, line.replace(",", ".")) for n, line in below]
    return [_Row(n, _cells(line)) for n, line in below]


def _numbers(path: Path, row: _Row, n_wanted: int) -> Array:
    """(n,) of a row; empty cells, or cells missing at its end, are NaN."""
    if any(row.cells[n_wanted:]):
        raise SequenceError(f"{path}: {len(row.cells)} cells in line {row.line}, expected at most {n_wanted}")
    cells = row.cells[:n_wanted] + [""] * (n_wanted - len(row.cells))
    try:
        return np.array([float(cell) if cell else np.nan for cell in cells])
    except ValueError:
        return np.array([_number(path, row.line, cell) for cell in cells])


def _number(path: Path, line: int, cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        if is_gap(cell):
            return np.nan
        raise SequenceError(f"{path}: {shortened(cell)!r} in line {line}, expected a number") from None


def _check_times(path: Path, rows: list[_Row], times_s: Array) -> None:
    wrong = np.flatnonzero(~np.isfinite(times_s) | (np.diff(times_s, prepend=-np.inf) <= 0))
    if len(wrong) or len(times_s) < 2:
        where = f"in line {rows[wrong[0]].line}" if len(wrong) else "in a table of one row"
        raise SequenceError(f"{path}: Time does not run forwards {where}")


def _remarks(path: Path, header: dict[str, str], names: list[str], times_s: Array) -> tuple[str, ...]:
    """Remarks: differences between header and table, and columns that are not read.

    Raises:
        SequenceError: Time is not in seconds.
    """
    said = []
    for key, count in (("NumFrames", len(times_s)), ("NumMarkers", len(names))):
        if not _counts(header, key, count):
            said.append(f"{key} of {path.name} is {shortened(header[key])}, its table has {count}")
    if unnamed := names.count(""):
        said.append(f"{path.name}: {unnamed} of {len(names)} markers have no name, and are left out")
    rate = header.get("DataRate", "").replace(",", ".")
    steps_s = (
        np.median(np.diff(times_s)),
        (times_s[-1] - times_s[0]) / (len(times_s) - 1),
    )  # some are rounded, some gaps
    apart = [float(rate) * step_s for step_s in steps_s] if re.fullmatch(r"\d*[1-9]\d*\.?\d*", rate) else [1.0]
    if not 1 / _OTHER_UNIT < apart[0] < _OTHER_UNIT:
        raise SequenceError(f"{path}: DataRate is {rate} Hz, and Time steps by {steps_s[0]:.6g}: expected seconds")
    if not any(1 / _RATES_APART < one < _RATES_APART for one in apart):
        said.append(
            f"DataRate of {path.name} is {rate} Hz, by its column Time it has {1 / steps_s[1]:.6g} Hz: Time counts"
        )
    return tuple(said)
