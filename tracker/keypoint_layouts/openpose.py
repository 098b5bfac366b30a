"""Folders of JSON files, one a frame, as OpenPose and Pose2Sim write them."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tracker.arrays import Array
from tracker.errors import SequenceError
from tracker.keypoints import LAYOUTS, Detections
from tracker.source_files import json_of

_NUMBER = re.compile(r"\d+")


@dataclass(frozen=True)
class OpenPoseFolder:
    """The files of one view by their number."""

    files: dict[int, Path]
    names: tuple[str, ...]
    named: bool = True
    """See `KeypointSource.named`."""

    @staticmethod
    def of(folder: Path, names: tuple[str, ...] = ()) -> OpenPoseFolder:
        """The files of a folder; the last number in a file's name is that of its frame.

        Raises:
            SequenceError: there are none, or two of one number.
        """
        files: dict[int, Path] = {}
        for path in sorted(folder.glob("*.json")):
            numbers = _NUMBER.findall(path.stem)
            if not numbers:
                raise SequenceError(f"{path}: no number in the file's name, expected e.g. {folder.name}_000000.json")
            if int(numbers[-1]) in files:
                raise SequenceError(f"{path}: {files[int(numbers[-1])].name} has the same number in its name")
            files[int(numbers[-1])] = path
        if not files:
            raise SequenceError(f"{folder}: no .json file in it, expected one a frame, as OpenPose and Pose2Sim write")
        return OpenPoseFolder(files, names or _layout(files))

    def at(self, number: int) -> Detections:
        """What was found in an image of that number; nobody where there is no file.

        Raises:
            SequenceError: the file is not one of OpenPose's.
        """
        if number not in self.files:
            return Detections.none(self.names)
        people = _people(self.files[number])
        wanted = len(self.names)
        for person in people:
            if len(person) != wanted:
                raise SequenceError(f"{self.files[number]}: {len(person)} keypoints, the names given are {wanted}")
        return Detections(self.names, np.array(people).reshape(-1, wanted, 3))


def _layout(files: dict[int, Path]) -> tuple[str, ...]:
    """Names of the keypoints, by the number of them in the first file that shows somebody."""
    for path in files.values():
        for person in _people(path):
            fitting = [names for names in LAYOUTS.values() if len(names) == len(person)]
            if not fitting:
                known = ", ".join(f"{len(names)} ({layout})" for layout, names in LAYOUTS.items())
                raise SequenceError(f"{path}: {len(person)} keypoints, expected {known}, or give their names")
            return fitting[0]
    return LAYOUTS["coco_17"]


def _people(path: Path) -> list[Array]:
    """(K, 3) keypoints of everybody in a file; NaN where the confidence is 0."""
    try:
        content = json_of(path, SequenceError)
        return [_keypoints(person["pose_keypoints_2d"], path) for person in content["people"]]
    except (KeyError, TypeError) as error:
        raise SequenceError(
            f'{path}: not as OpenPose writes it, expected {{"people": [{{"pose_keypoints_2d": [x, y, c, ...]}}]}}'
        ) from error


def _keypoints(values: Any, path: Path) -> Array:
    try:
        flat = np.array(values, dtype=np.float64)
    except (ValueError, TypeError, OverflowError) as error:
        raise SequenceError(f"{path}: pose_keypoints_2d has an entry that is no number") from error
    if flat.ndim != 1 or len(flat) % 3 or not np.isfinite(flat).all():
        raise SequenceError(f"{path}: pose_keypoints_2d has {flat.size} numbers, expected finite x, y, confidence each")
    found = flat.reshape(-1, 3)
    found[found[:, 2] <= 0] = np.nan
    return found
