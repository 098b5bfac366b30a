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

    def at(self, frame: int) -> Detections:
        """What was found in a frame, counted as the files count; nobody where they tell nothing."""
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
        return _Table(read_table(path))
    if path.is_dir():
        return OpenPoseFolder.of(path, names)
    kind = "is neither a folder nor a .csv table" if path.exists() else "does not exist"
    raise SequenceError(
        f"{path}: {kind}; expected a folder of OpenPose's JSON files, or a CSV table of DeepLabCut or SLEAP"
    )


class _Table:
    """A table read as a whole."""

    def __init__(self, frames: Mapping[int, Detections]) -> None:
        self._frames = frames
        self.names = next(iter(frames.values())).names

    def at(self, frame: int) -> Detections:
        return self._frames.get(frame) or Detections.none(self.names)
