"""A finished run, looked at."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tracker.errors import TrackerError
from tracker.frame import Frame
from tracker.jobs import load_job
from tracker.reading import Sequence
from tracker.result import Result
from tracker.smoothed import FOLDER as SMOOTHED
from tracker.viewing.viewer import Viewer


def view_result(result: Result, server: Any) -> tuple[Viewer, str]:
    """Shows a result, with its images where the recording is still there.

    Returns:
        The viewer, and why there are no images; empty if there are.
    """
    viewer = Viewer(server, result.scene, result.interval_s, len(result.replays))
    viewer.show_result(result.replays)
    try:
        viewer.pictures.read(_images(result))
    except TrackerError as error:
        return viewer, str(error)
    return viewer, ""


def _images(result: Result) -> Iterator[Frame]:
    """The frames of the recording that the result was made from; plates are not needed, and not made."""
    reading = load_job("track", config_of(result.folder)).reading
    sequence: Sequence = dataclasses.replace(reading, background=None, masks=None, align_background=False).open()
    return sequence.frames()


def config_of(folder: Path) -> Path:
    """The configuration beside a result; a smoothed one lies in the folder of the raw one."""
    return (folder.parent if folder.name == SMOOTHED else folder) / "config.toml"
