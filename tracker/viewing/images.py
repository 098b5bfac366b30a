"""The images that a finished run was made from."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tracker.errors import ConfigError
from tracker.frame import Frame
from tracker.jobs import load_job
from tracker.reading import Sequence
from tracker.result import Result
from tracker.smoothed import FOLDER as SMOOTHED

IN_STEP = "in_step"
"""In a result folder: its poses at one moment, see `tracker.aligned`."""


def images_of(result: Result) -> Iterator[Frame]:
    """The frames of the recording that the result was made from, as bright and smooth as they were tracked.

    Plates are not needed, and not made.

    Raises:
        TrackerError: the recording is not there any more.
    """
    reading = load_job("track", config_of(result.folder), _chosen(result)).reading
    # still pictures are never looked through for plates, nor do they have masks
    none = {"background": "none", "masks": None, "occluders": None, "align_background": False}
    sequence: Sequence = dataclasses.replace(
        reading, **(none if hasattr(reading, "masks") else {"background": None})
    ).open()
    return sequence.frames()


def _chosen(result: Result) -> list[str]:
    """What the run has chosen for its images by itself, as overrides of its configuration, which leaves it open."""
    chosen: Any = result.details.get("images", {})
    if not isinstance(chosen, dict):
        raise ConfigError(f"{result.folder / 'run.json'}: damaged: images = {chosen!r}, expected their settings")
    return [f"reading.{name}={value}" for name, value in chosen.items()]


def config_of(folder: Path) -> Path:
    """The configuration beside a result; one that was changed afterwards lies in the folder of the raw one."""
    while folder.name in (SMOOTHED, IN_STEP):
        folder = folder.parent
    return folder / "config.toml"
