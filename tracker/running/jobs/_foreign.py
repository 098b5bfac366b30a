"""Files given in place of a job's configuration, told for what they are: videos, results, calibrations, other jobs."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tracker.cameras.rig_layouts import read_rig
from tracker.foundation.configuration.components import available, find
from tracker.foundation.configuration.tables import Table, read_config
from tracker.foundation.errors import CalibrationError, ConfigError
from tracker.images.footage import PICTURES, VIDEOS
from tracker.running.jobs._folder import CONFIG

_DRAFT = "`bodytrack init VIDEOS` writes the configuration of a run"

_PROGRAMS = {
    "Anipose's config.toml": {"project", "nesting"},
    "Pose2Sim's Config.toml": {"project", "triangulation"},
    "Sports2D's Config.toml": {"base", "px_to_meters_conversion"},
}
"""Configurations of other programs, and sections that they have."""

_COMMANDS = {"track": "run", "calibrate": "calibrate"}
"""Jobs whose command is called otherwise; they are looked at first, for others have their sections too."""

_CALIBRATIONS = {"reference_bar": "bar", "chessboard": "chessboard", "scene_points": "points"}


def read_own(use: str, path: Path, overrides: Sequence[str] = ()) -> Table:
    """Reads the configuration of a job, as `tracker.foundation.configuration.tables.read_config` does.

    Args:
        use: the job.
        path: TOML file.
        overrides: `section.key=value`.

    Raises:
        ConfigError: it cannot be read, or is something else: what it is, and what to do with it.
    """
    if told := _by_its_path(path):
        raise ConfigError(f"{path}: {told}")
    try:
        table = read_config(path, overrides)
    except ConfigError:
        if path.is_file() and (told := _calibration(path)):
            raise ConfigError(f"{path}: {told}") from None
        raise
    if set(table) - _sections(use) - {"job"} and (told := _by_its_sections(use, table, path)):
        raise ConfigError(f"{path}: {told}")
    return table


def _by_its_path(path: Path) -> str:
    if path.is_dir() and (path / CONFIG).is_file():
        return f"the folder of a result, expected a configuration; its own is {path / CONFIG}"
    if path.is_dir():
        return f"a folder, expected a configuration: `bodytrack init {path}` writes one for the videos in it"
    if path.is_file() and path.suffix.lower() in VIDEOS | PICTURES:
        kind = "a video" if path.suffix.lower() in VIDEOS else "a picture"
        return f"{kind}, expected a configuration: `bodytrack init {path.parent}` writes one for all views there"
    return ""


def _by_its_sections(use: str, table: Table, path: Path) -> str:
    for program, sections in _PROGRAMS.items():
        if sections <= set(table):
            return f"{program}, expected a configuration of bodytrack: {_DRAFT}"
    others = sorted(set(available("jobs")) - {use}, key=lambda other: (other not in _COMMANDS, other))
    other = next((other for other in others if set(table) <= _sections(other) | {"job"}), None)
    if other is not None:
        return f"the configuration of another command: `bodytrack {_command(other, table)} {path}`"
    if "segments" in table:
        return f'a body model, expected a configuration: name it there, persons = [{{ model = "{path}" }}]; {_DRAFT}'
    return _calibration(path)


def _calibration(path: Path) -> str:
    """What is told of a calibration; nothing of other files."""
    with contextlib.suppress(CalibrationError):
        n_cameras = len(read_rig(path).rig)
        cameras = "a camera" if n_cameras == 1 else f"{n_cameras} cameras"
        return f"a calibration of {cameras}, expected a configuration: `bodytrack init VIDEOS --rig {path}` writes one"
    return ""


def _command(use: str, table: Table) -> str:
    calibration: Any = table.get("calibration")
    kind = calibration.get("use") if isinstance(calibration, dict) else None
    of_kind = f" {_CALIBRATIONS.get(str(kind), 'chessboard')}" if use == "calibrate" else ""
    return _COMMANDS.get(use, use.partition("_")[0]) + of_kind


def _sections(use: str) -> set[str]:
    """The sections and keys of a job, and of those that its command chooses."""
    jobs = [name for name in available("jobs") if name == use or name.startswith(f"{use}_")]
    return {field.name for name in jobs for field in dataclasses.fields(find("jobs", name))}
