"""A finished run, looked at."""

from __future__ import annotations

from typing import Any

from tracker.foundation.errors import TrackerError
from tracker.results.result import Result
from tracker.running.viewing.images import images_of
from tracker.running.viewing.viewer import Viewer


def view_result(result: Result, server: Any) -> tuple[Viewer, str]:
    """Shows a result, with its images where the recording is still there.

    Returns:
        The viewer, and why there are no images; empty if there are.
    """
    viewer = Viewer(server, result.scene, result.interval_s, len(result.replays))
    viewer.show_result(result.replays)
    try:
        viewer.pictures.read(images_of(result))
    except TrackerError as error:
        return viewer, str(error)
    return viewer, ""
