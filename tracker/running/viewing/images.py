"""The images that a finished run was made from."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator
from collections.abc import Sequence as SequenceOf
from copy import deepcopy
from pathlib import Path
from typing import Any

from tracker.cameras.frame import Frame
from tracker.foundation.configuration.tables import override_table
from tracker.foundation.errors import ConfigError
from tracker.images.reading import Sequence
from tracker.results.result import Result
from tracker.results.smoothed_result import FOLDER as SMOOTHED
from tracker.running.jobs import CONFIG, job_from, load_job

IN_STEP = "in_step"
"""In a result folder: its poses at one moment, see `tracker.running.aligned_result`."""


def images_of(result: Result) -> Iterator[Frame]:
    """The frames of the recording that the result was made from, as bright and smooth as they were tracked.

    Plates are not needed, and not made.

    Raises:
        TrackerError: the recording is not there any more.
    """
    return without_plates(reading_of(result, chosen_images(result))).frames()


def without_plates(reading: Any) -> Sequence:
    """A recording whose plates are not needed, and not made.

    Raises:
        TrackerError: the recording is not there.
    """
    # still pictures are never looked through for plates, nor do they have masks
    none = {"background": "none", "masks": None, "occluders": None, "align_background": False}
    opened: Sequence = dataclasses.replace(
        reading, **(none if hasattr(reading, "masks") else {"background": None})
    ).open()
    return opened


def single_frame(reading: Any, number: int) -> tuple[Sequence, Frame]:
    """The opened recording, and one frame of it.

    Raises:
        ConfigError: the recording has no such frame.
        TrackerError: the recording is not there.
    """
    ends = {"start": number, "stop": number + 1}
    opened = without_plates(dataclasses.replace(reading, **{k: v for k, v in ends.items() if hasattr(reading, k)}))
    frame = next(opened.frames(), None)
    if frame is None or frame.index != number:
        raise ConfigError(f"frame {number}: the recording has none; it begins at {0 if frame is None else frame.index}")
    return opened, frame.unpacked()


def chosen_images(result: Result) -> list[str]:
    """What the run has chosen for its images by itself, as overrides of its configuration, which leaves it open."""
    chosen: Any = result.details.get("images", {})
    if not isinstance(chosen, dict):
        raise ConfigError(f"{result.folder / 'run.json'}: damaged: images = {chosen!r}, expected their settings")
    return [f"reading.{name}={_as_toml(value)}" for name, value in chosen.items()]


def _as_toml(value: Any) -> str:
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{json.dumps(key)} = {json.dumps(one)}" for key, one in value.items()) + " }"
    return json.dumps(value)


def reading_of(result: Result, overrides: SequenceOf[str] = ()) -> Any:
    """How the recording is read that the result was made from; see `job_of`."""
    return job_of(result, overrides).reading


def job_of(result: Result, overrides: SequenceOf[str] = ()) -> Any:
    """The job that the result was made by.

    Raises:
        ConfigError: its configuration is damaged, or not there.
    """
    path, told = _config_of(result.folder), result.details.get("config")
    if path.is_file() or not isinstance(told, dict):
        return load_job("track", path, overrides)
    table = deepcopy(told)  # of poses changed after the run and written elsewhere
    override_table(table, overrides)
    return job_from("track", table, "run.json", result.folder, result.name)


def _config_of(folder: Path) -> Path:
    """The configuration beside a result; that of poses changed afterwards may lie in the folder of the raw ones."""
    folder = folder.resolve()
    while folder.name in (SMOOTHED, IN_STEP) and not (folder / CONFIG).is_file():
        folder = folder.parent
    return folder / CONFIG
