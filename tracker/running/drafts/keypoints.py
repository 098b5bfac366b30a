"""The 2-D keypoints that lie near a recording: a folder of a detector's files for each view."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from tracker.foundation.errors import SequenceError
from tracker.images.footage import KEYPOINT_WORDS, Footage, listed, says, with_view

_WORDS = (*KEYPOINT_WORDS, "pose")
"""Pose2Sim's folder is called `pose`."""

_MOST_FILES = 400
"""Of a folder that are looked at: a folder of keypoints has one a view."""


def found_keypoints(folder: Path, footage: Sequence[Footage]) -> list[Path]:
    """Patterns with `{view}` of folders that each view has, near the recording; the most telling names first.

    Args:
        folder: of the recording.
        footage: its views.
    """
    views = [one.view for one in footage]
    places = _places(folder) if views else ()
    found = dict.fromkeys(pattern for place in places for pattern in _patterns(place, views))
    return [pattern for pattern in found if all(map(_has_files, _of_views(pattern, views)))]


def _places(folder: Path) -> Iterator[Path]:
    """Folders whose names say that keypoints are in them, beside the videos and above them."""
    for place in (folder, folder.resolve().parent):
        yield from (path for path in _some(place) if path.is_dir() and says(path.name, _WORDS))


def _patterns(place: Path, views: Sequence[str]) -> Iterator[Path]:
    for inner in _some(place):
        if inner.is_dir():
            yield from (place / text for text in with_view(inner.name, views[0]))


def _of_views(pattern: Path, views: Sequence[str]) -> list[Path]:
    return [pattern.with_name(pattern.name.replace("{view}", view)) for view in views]


def _has_files(folder: Path) -> bool:
    return folder.is_dir() and any(path.suffix == ".json" for path in _some(folder))


def _some(folder: Path) -> list[Path]:
    try:
        return sorted(listed(folder))[:_MOST_FILES]
    except SequenceError:
        return []
