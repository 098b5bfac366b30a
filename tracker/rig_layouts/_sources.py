"""Files as text and tables, bounded in size, every fault one sentence."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any

from tracker.errors import CalibrationError

_LARGEST_BYTES = 2**20
"""A camera takes 0.3 to 1 kB in every layout: a thousand cameras fit."""

_LONGEST_LINE = 10_000
"""Of a TOML file: the time that Python's parser takes for a dotted key grows with the square of its length."""


def text_of(path: Path, errors: str = "strict") -> str:
    """The content of a text file in UTF-8.

    Args:
        path: the file.
        errors: as of `bytes.decode`.

    Raises:
        CalibrationError: it cannot be read, is no text, or is larger than any calibration.
    """
    try:
        with path.open("rb") as file:
            content = file.read(_LARGEST_BYTES + 1)
        if len(content) > _LARGEST_BYTES:
            raise CalibrationError("larger than 1 MiB, expected a calibration: some hundred bytes a camera")
        return content.decode("utf-8-sig", errors)
    except OSError as error:
        raise CalibrationError(f"cannot read the calibration: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise CalibrationError("cannot read the calibration: not a text file") from error


def toml_table(path: Path) -> dict[str, Any]:
    """The content of a TOML file; entries that are the word "null", as rtoml writes None, are as if not there.

    But for a name: a camera may be called so.
    """
    text = text_of(path)
    longest = max((len(line) for line in text.splitlines()), default=0)
    if longest > _LONGEST_LINE:
        raise CalibrationError(f"not a TOML file of cameras: a line of {longest} characters in it")
    try:
        return _without_null(tomllib.loads(text))
    except RecursionError as error:
        raise CalibrationError("not a TOML file: nested too deeply") from error
    except ValueError as error:  # also of numbers too long to convert
        raise CalibrationError(f"not a TOML file: {_one_line(error)}") from error


def json_table(path: Path) -> dict[str, Any]:
    """The content of a JSON file."""
    try:
        content = json.loads(text_of(path))
    except RecursionError as error:
        raise CalibrationError("not a JSON file: nested too deeply") from error
    except ValueError as error:
        raise CalibrationError(f"not a JSON file: {_one_line(error)}") from error
    if not isinstance(content, dict):
        raise CalibrationError("expected a table of cameras")
    return content


def _one_line(error: ValueError) -> str:
    return str(error).replace("\n", " ")


def _without_null(table: dict[str, Any]) -> dict[str, Any]:
    return {
        key: _without_null(value) if isinstance(value, dict) else value
        for key, value in table.items()
        if value != "null" or key == "name"
    }
