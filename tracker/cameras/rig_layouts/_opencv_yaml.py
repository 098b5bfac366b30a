"""OpenCV's YAML: files and matrices, read so that a damaged file is an error and nothing worse."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import yaml

from tracker.cameras.rig_layouts._sources import line_fault, text_of
from tracker.foundation.arrays import Array
from tracker.foundation.errors import CalibrationError, shortened

_MOST_NUMBERS = 64
"""Largest matrix: a camera has none that is larger."""

_KIND = re.compile(r"1?[ucwsifdh]")
"""OpenCV's names of number types: u, c, w, s, i of 8 to 32 bits, f, d, h of 32, 64 and 16."""

_LOADER = yaml.BaseLoader
"""Words stay words: a camera called 01, no or 1e5 keeps its name."""


@dataclass(frozen=True)
class OpenCvFile:
    """An opened file."""

    name: str
    entries: Mapping[str, yaml.Node]

    def has(self, key: str) -> bool:
        """Whether the entry exists."""
        return key in self.entries

    def names(self, key: str) -> list[str]:
        """A list of words; empty where there is none."""
        node = self.entries.get(key)
        entries = node.value if isinstance(node, yaml.SequenceNode) else []
        return [entry.value if isinstance(entry, yaml.ScalarNode) else "" for entry in entries]

    def number(self, key: str) -> float:
        """A number, 0 where there is none."""
        found = _number(self.entries.get(key))
        return found if math.isfinite(found) else 0.0

    def matrix(self, *keys: str) -> Array:
        """The matrix under the first of the keys that the file has.

        Raises:
            CalibrationError: there is none, or it is no matrix of a camera.
        """
        key = next((key for key in keys if self.has(key)), None)
        if key is None:
            raise CalibrationError(f"{self.name}: no matrix {' or '.join(keys)}")
        found = _numbers(self.entries[key], f"{self.name}: {key}")
        if found is None or not np.isfinite(found).all():
            raise CalibrationError(f"{self.name}: {key}: expected a matrix of finite numbers (!!opencv-matrix)")
        return found


def _number(node: yaml.Node | None) -> float:
    """Value of a scalar, NaN if it is not a number."""
    try:
        return float(node.value) if isinstance(node, yaml.ScalarNode) else math.nan
    except ValueError:
        return math.nan


def _numbers(node: yaml.Node, where: str) -> Array | None:
    table = _table(node, where)
    data = table.get("data")
    rows, cols = _number(table.get("rows")), _number(table.get("cols"))
    kind = table.get("dt")
    if not isinstance(kind, yaml.ScalarNode) or _KIND.fullmatch(kind.value) is None:
        return None
    if not (rows >= 1 and cols >= 1 and rows * cols <= _MOST_NUMBERS and isinstance(data, yaml.SequenceNode)):
        return None
    values = np.array([_number(value) for value in data.value])
    if rows != int(rows) or cols != int(cols) or len(values) != rows * cols:
        return None
    return values.reshape(int(rows), int(cols))


def _table(node: yaml.Node | None, where: str) -> dict[str, yaml.Node]:
    """The entries of a mapping, none if it is no mapping.

    Raises:
        CalibrationError: a key is there twice.
    """
    table: dict[str, yaml.Node] = {}
    for key, value in node.value if isinstance(node, yaml.MappingNode) else []:
        word = key.value if isinstance(key, yaml.ScalarNode) else ""
        if word in table:
            raise CalibrationError(f'{where}: two entries are called "{shortened(word)}"')
        table[word] = value
    return table


def opened(path: Path) -> OpenCvFile:
    """Opens a file without OpenCV, whose parser never ends on `{a: 1}:` before a list and dies of 100 000 brackets.

    Raises:
        CalibrationError: it is missing, or not OpenCV's YAML.
    """
    try:
        text = text_of(path)
    except CalibrationError as error:
        raise CalibrationError(f"{path.name}: {error}") from error
    if not text.startswith("%YAML"):
        raise CalibrationError(f"{path.name}: not an OpenCV YAML file, which starts with %YAML:1.0")
    try:
        # %YAML:1.0 is OpenCV's own spelling
        root = yaml.compose(text.partition("\n")[2], Loader=_LOADER)
    except (yaml.YAMLError, ValueError) as error:  # also of characters that do not exist
        mark = getattr(error, "problem_mark", None)
        told = line_fault(text, 0 if mark is None else mark.line + 2)  # the first line is left out, and counted from 1
        raise CalibrationError(f"{path.name}: not an OpenCV YAML file: {told}") from error
    except RecursionError as error:
        raise CalibrationError(f"{path.name}: not an OpenCV YAML file: nested too deeply") from error
    entries = _table(root, path.name)
    if not entries:
        raise CalibrationError(f"{path.name}: not an OpenCV YAML file: no entries in it")
    return OpenCvFile(path.name, entries)


def written(entries: Mapping[str, Array | float | list[str]]) -> bytes:
    """The content of a file with these entries in order."""
    storage = cv2.FileStorage(".yml", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
    for key, value in entries.items():
        if isinstance(value, list):
            storage.startWriteStruct(key, cv2.FileNode_SEQ)
            for word in value:
                storage.write("", word)
            storage.endWriteStruct()
        else:
            storage.write(key, np.array(value) if isinstance(value, np.ndarray) else value)
    _, _, content = storage.releaseAndGetString().partition("\n")
    # OpenCV 5 heads its files %YAML 1.2, which older programs need not know.
    return f"%YAML:1.0\n{content}".encode()
