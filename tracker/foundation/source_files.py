"""Text files of users, as TOML, JSON, XML and CSV: a damaged one gives an error of one sentence, in bounded time."""

from __future__ import annotations

import csv
import io
import json
import math
import re
import tomllib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from tracker.foundation.errors import TrackerError, nearest, shortened

METRES_PER_UNIT = {"m": 1.0, "dm": 0.1, "cm": 0.01, "mm": 0.001, "in": 0.0254, "ft": 0.3048}
"""Separators of cells by their signs."""

_WORDS = {
    "m": ("meter", "meters", "metre", "metres"),
    "dm": ("decimeter", "decimeters", "decimetre", "decimetres"),
    "cm": ("centimeter", "centimeters", "centimetre", "centimetres"),
    "mm": ("millimeter", "millimeters", "millimetre", "millimetres"),
    "in": ("inch", "inches"),
    "ft": ("foot", "feet"),
}
_SIGN_OF = {word: sign for sign, words in _WORDS.items() for word in (sign, *words)}


def unit_sign(unit: str) -> str | None:
    """The sign of a unit of length in any usual spelling (`mm`, `[mm]`, `Millimetres`); None for other words."""
    return _SIGN_OF.get(unit.strip(" \t\0[]().").lower())


def metres_in(unit: str) -> float | None:
    """Metres in a unit of length in any usual spelling; None for other words."""
    sign = unit_sign(unit)
    return None if sign is None else METRES_PER_UNIT[sign]


_LARGEST_BYTES = 2**24
"""Largest TOML file, bytes: the longest one that a person writes, a body model with a mesh, has less."""

_SEPARATORS = {";": "semicolons", "\t": "tabs"}

_LONGEST_LINE = 10_000
"""Longest line of a TOML file: the time of Python's parser for a dotted key grows with the square of its length."""

Fault = type[TrackerError]
"""Error to raise."""


def text_of(path: Path, fault: Fault, what: str = "the file", largest_bytes: int | None = None) -> str:
    """The content of a text file in UTF-8, with or without a mark at its beginning.

    Args:
        path: the file.
        fault: class of the error.
        what: name of the content, for messages.
        largest_bytes: a larger one is refused; None for any.

    Raises:
        TrackerError: of the given class: it cannot be read, is not text, or larger than such a file can be.
    """
    content = content_of(path, fault, what, largest_bytes)
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise fault(f"{path}: not a text file in UTF-8: {error.reason} at byte {error.start}") from error


def content_of(path: Path, fault: Fault, what: str = "the file", largest_bytes: int | None = None) -> bytes:
    """The bytes of a file; arguments and errors are those of `text_of`.

    Raises:
        TrackerError: of the given class: it cannot be read, or is larger than such a file can be.
    """
    try:
        with path.open("rb") as file:
            content = file.read(-1 if largest_bytes is None else largest_bytes + 1)
    except (OSError, ValueError) as error:  # a path with NUL is a ValueError
        raise fault(f"{path}: cannot read {what}: {getattr(error, 'strerror', None) or error}") from error
    if largest_bytes is not None and len(content) > largest_bytes:
        raise fault(f"{path}: larger than {largest_bytes / 2**20:.0f} MiB, expected much less")
    return content


def toml_of(path: Path, fault: Fault, what: str = "the file") -> dict[str, Any]:
    """The content of a TOML file.

    Raises:
        TrackerError: of the given class: it cannot be read, or has another format.
    """
    text = text_of(path, fault, what, _LARGEST_BYTES)
    for n, line in enumerate(text.splitlines(), start=1):
        if len(line) > _LONGEST_LINE:
            raise fault(f"{path}: not a TOML file: {len(line)} characters in line {n}")
    try:
        return tomllib.loads(text)
    except RecursionError as error:
        raise fault(f"{path}: not a TOML file: nested too deeply") from error
    except ValueError as error:  # also of numbers too long to convert
        raise fault(f"{path}: not a TOML file: {one_line(error)}") from error


def json_of(path: Path, fault: Fault) -> Any:
    """The content of a JSON file.

    Raises:
        TrackerError: of the given class: it cannot be read, or has another format.
    """
    try:
        return json.loads(text_of(path, fault), object_pairs_hook=each_once(fault, f"{path}: "))
    except RecursionError as error:
        raise fault(f"{path}: not a JSON file: nested too deeply") from error
    except ValueError as error:
        raise fault(f"{path}: not a JSON file: {one_line(error)}") from error


def xml_of(path: Path, fault: Fault, what: str = "the file") -> ElementTree.Element:
    """The outermost element of an XML file.

    Raises:
        TrackerError: of the given class: it cannot be read, is not XML, or has a document type, which could name other
            files.
    """
    content = content_of(path, fault, what, _LARGEST_XML_BYTES)
    if b"<!DOCTYPE" in content or b"<!ENTITY" in content:
        raise fault(f"{path}: a document type in it, which {what} does not need: remove it")
    try:
        return ElementTree.fromstring(content)
    except (ElementTree.ParseError, LookupError, ValueError) as error:  # also of an alphabet that nobody knows
        raise fault(f"{path}: not an XML file: {one_line(error)}") from error


_LARGEST_XML_BYTES = 2**26
"""Largest number of elements of an XML file: OpenSim's models with muscles have a few million."""


def each_once(fault: Fault, where: str = "") -> Callable[[list[tuple[str, Any]]], dict[str, Any]]:
    """Makes tables of JSON without repeated names: Python's reader would silently take the last entry of a name.

    Args:
        fault: class of the error for a repeated entry.
        where: begin of its message.
    """

    def made(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        table = dict(pairs)
        if len(table) < len(pairs):
            names = [name for name, _ in pairs]
            twice = next(name for name in names if names.count(name) > 1)
            raise fault(f'{where}two entries are called "{shortened(twice)}", expected different names')
        return table

    return made


def cells_of(path: Path, fault: Fault) -> list[list[str]]:
    """The rows of a CSV file that are not empty.

    Raises:
        TrackerError: of the given class: it cannot be read, or has another format.
    """
    try:
        return [row for row in csv.reader(io.StringIO(text_of(path, fault), newline="")) if row]
    except csv.Error as error:
        raise fault(f"{path}: not a CSV table: {one_line(error)}") from error


def rows_of(path: Path, fault: Fault) -> list[dict[str, str]]:
    """The rows of a CSV file by the names of its columns.

    Raises:
        TrackerError: of the given class: it cannot be read, has no rows, or a row of another length.
    """
    head, *rows = cells_of(path, fault) or [[]]
    if not rows:
        raise fault(f"{path}: the table is empty")
    check_commas(head, path, fault)
    twice = next((name for k, name in enumerate(head) if name in head[:k]), None)
    if twice is not None:
        raise fault(f'{path}: two columns are called "{shortened(twice)}"')
    for n, row in enumerate(rows, start=1):
        if len(row) != len(head):
            raise fault(f"{path}: {len(row)} cells in row {n}, expected {len(head)}, one a column")
    return [dict(zip(head, row, strict=True)) for row in rows]


def check_commas(head: Sequence[str], path: Path, fault: Fault) -> None:
    """Refuses a first row of a CSV file with other separators than commas.

    Raises:
        TrackerError: of the given class.
    """
    if len(head) == 1 and (other := next((sign for sign in ";\t" if sign in head[0]), None)):
        raise fault(f"{path}: cells are separated by {_SEPARATORS[other]}, expected commas")


def is_gap(cell: str) -> bool:
    """Whether a cell stands for a missing number, in the spelling of any compiler, language or spreadsheet."""
    return not cell or _GAP.fullmatch(cell) is not None


_GAP = re.compile(
    r"[-+]? *(nan[qs]?(\(\w*\))?|1[.,]#\w*|inf(inity)?)|#(n/?a|nv|null!|num!|value!|div/0!)|n/?a|<na>"
    r"|null|none|nil|missing|\?|\*+|-+",
    re.IGNORECASE,
)
"""Microsoft's C writes `-1.#IND00`, `1.#QNAN0`, `-nan(ind)`, Fortran stars, R `NA`, Excel `#N/A`, people the rest."""


def number_in(row: Mapping[str, str], column: str, path: Path, fault: Fault) -> float:
    """A finite number of a row.

    Raises:
        TrackerError: of the given class: the column is missing, or the value is not a finite number.
    """
    if column not in row:
        raise fault(f'{path}: no column "{column}"; {nearest(column, row)}')
    try:
        value = float(row[column])
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise fault(f'{path}: "{column}" is {shortened(row[column])!r}, expected a finite number')
    return value


def frame_in(row: Mapping[str, str], path: Path, fault: Fault) -> int:
    """The number of a row's frame, in the column `frame`.

    Raises:
        TrackerError: of the given class: the column is missing, or the value is not a whole number.
    """
    value = number_in(row, "frame", path, fault)
    if value != int(value) or abs(value) > _MOST_FRAMES:
        raise fault(f'{path}: "frame" is {shortened(row["frame"])!r}, expected a whole number')
    return int(value)


_MOST_FRAMES = 10**9
"""A year at 30 frames a second."""


def one_line(error: BaseException) -> str:
    """Text of an error, on one line and of bounded length."""
    return str(error).replace("\n", " ")[:200]
