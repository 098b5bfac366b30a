"""Files as text and tables, bounded in size, every fault one sentence; what a file is written in, its content tells."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from tracker.foundation.errors import CalibrationError, shortened
from tracker.foundation.source_files import each_once

_LARGEST_BYTES = 2**20
"""A camera takes 0.3 to 1 kB in every layout: a thousand cameras fit."""

_LARGEST_FILE = 2**25
"""Of a file that also has the points which its cameras were calibrated by, bytes."""

_LONGEST_LINE = 10_000
"""Of a TOML file: the time that Python's parser takes for a dotted key grows with the square of its length."""

_POINTS = re.compile(r"^(\s*[\w-]+\s*=\s*)\[[\[\]\d\s.,eE+\-naif]*\]\s*$")
"""A line of TOML that has a list of numbers alone: as long as that no camera has one."""

_TOML = re.compile(r"^[ \t]*(?:matrix|size|distortions|translation)[ \t]*=", re.MULTILINE)
"""Entries of a camera in TOML, where the file's name does not say that it is TOML."""

_ROOT = re.compile(r"<([A-Za-z_][\w.:-]*)")
_COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)
_PLACE = re.compile(r"\(at line (\d+), column \d+\)")


def text_of(path: Path, errors: str = "strict") -> str:
    """The content of a text file in UTF-8; long lists of points in TOML are empty in it.

    Args:
        path: the file.
        errors: as of `bytes.decode`.

    Raises:
        CalibrationError: it cannot be read, is empty or no text, or is larger than any calibration.
    """
    try:
        with path.open("rb") as file:
            content = file.read(_LARGEST_FILE + 1)
        text = content.decode("utf-8-sig", errors)
    except OSError as error:
        raise CalibrationError(f"cannot read the calibration: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise CalibrationError("cannot read the calibration: not a text file") from error
    if len(content) > _LONGEST_LINE:
        text = "\n".join(_POINTS.sub(r"\1[]", line) if len(line) > _LONGEST_LINE else line for line in text.split("\n"))
    if len(text) > _LARGEST_BYTES:
        raise CalibrationError("larger than 1 MiB, expected a calibration: some hundred bytes a camera")
    return text


def lenient_text(path: Path) -> str:
    """What of a file is text, for a look at what it is; empty where there is none."""
    try:
        return text_of(path, "replace") if path.is_file() else ""
    except CalibrationError:
        return ""


def written_in(path: Path) -> str:
    """What a file is written in: `toml`, `json`, `xml`, `yaml` (OpenCV's), or nothing of these.

    The content tells; its name does where the content is damaged or no text.
    """
    if not path.is_file():
        return ""
    text = lenient_text(path).lstrip()
    for kind, begin in (("xml", "<"), ("yaml", "%YAML"), ("json", "{")):
        if text.startswith(begin):
            return kind
    if _TOML.search(text):
        return "toml"
    return {".toml": "toml", ".json": "json"}.get(path.suffix.lower(), "")


def xml_tag(path: Path) -> str:
    """The name of the outermost element of an XML file; empty of other files."""
    if written_in(path) != "xml":
        return ""
    found = _ROOT.search(_COMMENT.sub("", lenient_text(path)))
    return found[1] if found else ""


def xml_root(path: Path) -> ElementTree.Element:
    """The outermost element of an XML file; one with a document type, which could name other files, is refused."""
    text = text_of(path, "replace")
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise CalibrationError("a document type in it, which a calibration does not need")
    try:
        return ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise CalibrationError(f"not XML: {line_fault(text, error.position[0])}") from error
    except ValueError as error:
        raise CalibrationError("not XML: it says that it is written in another alphabet than it is") from error


def toml_table(path: Path) -> dict[str, Any]:
    """The content of a TOML file; entries that are the word "null", as rtoml writes None, are as if not there.

    Except a name: a camera may be called so.
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
        place = _PLACE.search(str(error))
        raise CalibrationError(f"not a TOML file: {line_fault(text, int(place[1]) if place else 0)}") from error


def json_content(path: Path) -> Any:
    """The content of a JSON file, whatever it is."""
    text = text_of(path)
    try:
        return json.loads(text, object_pairs_hook=each_once(CalibrationError))
    except RecursionError as error:
        raise CalibrationError("not a JSON file: nested too deeply") from error
    except ValueError as error:
        raise CalibrationError(f"not a JSON file: {line_fault(text, getattr(error, 'lineno', 0))}") from error


def json_table(path: Path) -> dict[str, Any]:
    """The content of a JSON file that is a table."""
    content = json_content(path)
    if not isinstance(content, dict):
        raise CalibrationError("expected a table of cameras")
    return content


def line_fault(text: str, number: int) -> str:
    """Where a file cannot be read: a line by its number, from 1; 0 where none is known."""
    lines = text.splitlines()
    if not 1 <= number <= len(lines):
        return "it ends too early" if number > len(lines) else "a number or a sign in it cannot be read"
    return f"line {number} cannot be read: {shortened(lines[number - 1].strip())!r}"


def _without_null(table: dict[str, Any]) -> dict[str, Any]:
    return {
        key: _without_null(value) if isinstance(value, dict) else value
        for key, value in table.items()
        if value != "null" or key == "name"
    }
