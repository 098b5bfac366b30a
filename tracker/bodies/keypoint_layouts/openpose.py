"""Folders of JSON files, one a frame, as OpenPose, Pose2Sim, AlphaPose and MMPose write them."""

from __future__ import annotations

from pathlib import Path

from tracker.bodies.keypoint_layouts._numbers import last_number
from tracker.bodies.keypoint_layouts._persons import persons_of
from tracker.foundation.arrays import Array
from tracker.foundation.errors import SequenceError
from tracker.foundation.source_files import json_of, text_of


def json_files(folder: Path) -> list[Path]:
    """The JSON files of a folder in their order, without those that a system keeps beside them."""
    return [path for path in sorted(folder.glob("*.json")) if not path.name.startswith(".")]


def files_of(folder: Path) -> dict[int, Path]:
    """The files of a folder; the last number in a file's name is that of its frame.

    Raises:
        SequenceError: there are none, or two of one number.
    """
    files: dict[int, Path] = {}
    for path in json_files(folder):
        number = last_number(path.stem)
        if number is None:
            raise SequenceError(f"{path}: no number in the file's name, expected e.g. {folder.name}_000000.json")
        if number in files:
            raise SequenceError(f"{path}: {files[number].name} has the same number in its name")
        files[number] = path
    if not files:
        others = sorted({path.suffix for path in folder.iterdir() if path.suffix and not path.name.startswith(".")})
        instead = f" (but {', '.join(others[:4])})" if others else ""
        raise SequenceError(
            f"{folder}: no .json file in it{instead}, expected one a frame, as OpenPose and Pose2Sim write"
        )
    return files


def persons_in(path: Path) -> list[Array]:
    """(K, 3) keypoints of everybody in a file; nobody in an empty one.

    Raises:
        SequenceError: the file is not one of a detector's.
    """
    return persons_of(json_of(path, SequenceError), path) if text_of(path, SequenceError).strip() else []
