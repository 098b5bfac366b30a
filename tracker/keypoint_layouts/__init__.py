"""Files of keypoints as detectors write them; one reader for whoever needs them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Protocol

from tracker.errors import SequenceError
from tracker.keypoint_layouts.openpose import OpenPoseFolder
from tracker.keypoint_layouts.tables import read_table
from tracker.keypoints import Detections


class KeypointSource(Protocol):
    """The keypoints of one view."""

    @property
    def names(self) -> tuple[str, ...]:
        """Of the keypoints."""
        ...

    @property
    def named(self) -> bool:
        """Whether what was found is told by the names of the images, not counted from the first image on."""
        ...

    def at(self, number: int) -> Detections:
        """What was found in an image, by the number in its name or its position; nobody where nothing is told."""
        ...


def open_keypoints(path: Path, names: tuple[str, ...] = ()) -> KeypointSource:
    """The keypoints of one view.

    Args:
        path: a folder of JSON files as OpenPose and Pose2Sim write them, or a CSV table of DeepLabCut or SLEAP.
        names: of the keypoints in JSON files; empty to tell the layout by their number.

    Raises:
        SequenceError: the file is missing or of no known kind.
    """
    if path.suffix.lower() == ".csv":
        return _Table(*read_table(path))
    if path.is_dir():
        return OpenPoseFolder.of(path, names)
    kind = "is neither a folder nor a .csv table" if path.exists() else "does not exist"
    raise SequenceError(
        f"{path}: {kind}; expected a folder of OpenPose's JSON files, or a CSV table of DeepLabCut or SLEAP"
    )


class _Table:
    """A table read as a whole."""

    def __init__(self, frames: Mapping[int, Detections], named: bool) -> None:
        self._frames, self.named = frames, named
        self.names = next(iter(frames.values())).names

    def at(self, number: int) -> Detections:
        return self._frames.get(number) or Detections.none(self.names)
