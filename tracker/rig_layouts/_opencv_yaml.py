"""OpenCV's YAML: files and matrices, read so that a damaged file is an error and nothing worse."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from tracker.arrays import Array
from tracker.errors import CalibrationError
from tracker.rig_layouts._sources import text_of

_DEEPEST = 64
"""OpenCV's parser calls itself for every bracket and dies of 200 000."""

_MOST_NUMBERS = 64
"""Of a matrix: OpenCV allocates what `rows` and `cols` say before it looks for the numbers."""


@dataclass(frozen=True)
class OpenCvFile:
    """An opened file."""

    name: str
    storage: cv2.FileStorage

    def names(self, key: str) -> list[str]:
        """A list of words; whole numbers, for which YAML takes names without quotes, as words."""
        node = self.storage.getNode(key)
        entries = [node.at(k) for k in range(node.size())] if node.isSeq() else []
        return [entry.string() or (str(int(entry.real())) if entry.isInt() else "") for entry in entries]

    def number(self, key: str) -> float:
        """A number, 0 where there is none."""
        node = self.storage.getNode(key)
        return float(node.real()) if node.isReal() or node.isInt() else 0.0

    def has(self, key: str) -> bool:
        """Whether there is such an entry."""
        return not self.storage.getNode(key).empty()

    def matrix(self, *keys: str) -> Array:
        """The matrix under the first of the keys that the file has.

        Raises:
            CalibrationError: there is none, or it is no matrix of a camera.
        """
        for key in keys:
            node = self.storage.getNode(key)
            if node.empty():
                continue
            found = _numbers(node)
            if found is None or not np.isfinite(found).all():
                raise CalibrationError(f"{self.name}: {key}: expected a matrix of finite numbers (!!opencv-matrix)")
            return found
        raise CalibrationError(f"{self.name}: no matrix {' or '.join(keys)}")


def _numbers(node: cv2.FileNode) -> Array | None:
    if not node.isMap() or not {"rows", "cols", "dt", "data"} <= set(node.keys()):
        return None
    rows, cols = node.getNode("rows").real(), node.getNode("cols").real()
    if not (1 <= rows <= _MOST_NUMBERS and 1 <= cols <= _MOST_NUMBERS and rows * cols <= _MOST_NUMBERS):
        return None
    try:
        return np.asarray(node.mat(), dtype=np.float64)
    except (cv2.error, TypeError, ValueError):
        return None


def opened(path: Path) -> OpenCvFile:
    """Opens a file.

    Raises:
        CalibrationError: it is missing, or not OpenCV's YAML.
    """
    try:
        text = text_of(path)
    except CalibrationError as error:
        raise CalibrationError(f"{path.name}: {error}") from error
    if not text.startswith("%YAML") or _depth(text) > _DEEPEST:
        raise CalibrationError(f"{path.name}: not an OpenCV YAML file, which starts with %YAML:1.0")
    try:
        storage = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
    except (cv2.error, SystemError) as error:
        raise CalibrationError(f"{path.name}: not an OpenCV YAML file: {_reason(error)}") from error
    if not storage.isOpened() or not storage.root().isMap():
        raise CalibrationError(f"{path.name}: not an OpenCV YAML file: no entries in it")
    return OpenCvFile(path.name, storage)


def _depth(text: str) -> int:
    """Deepest nesting of brackets, or of the dashes of lists within one line."""
    code = np.frombuffer(text.encode(), dtype=np.uint8)
    opening, closing = np.isin(code, list(b"[{")), np.isin(code, list(b"]}"))
    brackets = int(np.cumsum(opening.astype(np.int64) - closing).max(initial=0))
    return max(brackets, *(len(dashes) // 2 for dashes in _DASHES.findall(text)), 0)


_DASHES = re.compile(r"(?:-[ \t]+){2,}")
"""Lists in lists."""


def _reason(error: BaseException) -> str:
    told = str(error.__cause__ or error)
    return told.rpartition("error: ")[2].replace("\n", " ").strip()


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
