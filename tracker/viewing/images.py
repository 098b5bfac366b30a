"""The images that a finished run was made from."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from pathlib import Path

from tracker.frame import Frame
from tracker.jobs import load_job
from tracker.reading import Sequence
from tracker.result import Result
from tracker.smoothed import FOLDER as SMOOTHED

IN_STEP = "in_step"
"""In a result folder: its poses at one moment, see `tracker.aligned`."""


def images_of(result: Result) -> Iterator[Frame]:
    """The frames of the recording that the result was made from; plates are not needed, and not made.

    Raises:
        TrackerError: the recording is not there any more.
    """
    reading = load_job("track", config_of(result.folder)).reading
    sequence: Sequence = dataclasses.replace(reading, background="none", masks=None, align_background=False).open()
    return sequence.frames()


def config_of(folder: Path) -> Path:
    """The configuration beside a result; one that was changed afterwards lies in the folder of the raw one."""
    while folder.name in (SMOOTHED, IN_STEP):
        folder = folder.parent
    return folder / "config.toml"
