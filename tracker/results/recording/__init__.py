"""Recording: files of a run, written while it runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

from tracker.bodies.scene import Scene
from tracker.foundation.configuration.components import available
from tracker.foundation.configuration.tables import build, describe
from tracker.foundation.errors import ConfigError, nearest
from tracker.tracking.trajectory import Step

DEFAULTS = ("csv_table", "report", "overlay", "plots", "run_json", "journal")
"""Default recordings of a run, in the order in which they are listed."""


@dataclass(frozen=True)
class RunContext:
    """Facts about a run that recordings need."""

    name: str
    folder: Path
    """Result folder; it exists."""

    scene: Scene
    """The persons (poses do not matter) and the rig of the images as tracked."""

    fps: float
    """Frames per second of the recording, before any stride."""

    interval_s: float
    """Usual time from one frame of the run to the next, seconds, including the stride; each frame has its own time."""

    n_frames: int
    """Number of frames of a complete run."""

    resumed: frozenset[int] = frozenset()
    """Frames taken over from an interrupted run."""

    details: Mapping[str, Any] = field(default_factory=dict)
    """The run's description as saved in run.json: resolved config, versions, input hashes. The warnings about the
    input, `findings`, and the effect of keypoints, `keypoints`, are complete when recorders finish, not before."""

    figures: dict[str, bytes] = field(default_factory=dict)
    """Person -> figure of the parameters, PNG: the report shows the one that `plots` has drawn."""


@runtime_checkable
class Recorder(Protocol):
    """An open recording; the only state of a recording component."""

    def write(self, step: Step) -> None:
        """Adds one frame; frames in the file stay valid if the run is killed."""
        ...

    def finish(self) -> tuple[Path, ...]:
        """Closes the files; called after the last frame, after Ctrl-C and after an error.

        Returns:
            Its files in the result folder, the most important first.
        """
        ...


@runtime_checkable
class Recording(Protocol):
    """A component that writes one kind of result."""

    def begin(self, run: RunContext) -> Recorder:
        """Opens the result files in `run.folder`, replacing those of an interrupted run."""
        ...


def chosen_recordings(entry: Any, where: str, folder: Path) -> tuple[Recording, ...]:
    """The recordings of a configuration.

    A table changes the defaults: `overlay = false` leaves one out, `c3d = true` adds one, and a table of fields adds
    one or changes its settings. A list replaces the defaults: names, or tables with `use` and fields.

    Args:
        entry: the value of `recordings`.
        where: file and section for messages.
        folder: where relative paths start.

    Raises:
        ConfigError: an entry is none of these, no recording has the name, or one is named twice.
    """
    if isinstance(entry, list):
        tables = [{"use": one} if isinstance(one, str) else one for one in entry]
    elif isinstance(entry, dict):
        tables = _changed_defaults(entry, where, folder)
    else:
        raise ConfigError(f"{where}: {entry!r} found, expected a list of names, or a table like {{ overlay = false }}")
    recordings: list[Recording] = []
    for table in tables:
        if not isinstance(table, dict):
            raise ConfigError(f'{where}: {table!r} found, expected a name or a table like {{ use = "overlay" }}')
        recordings.append(build("recording", table, where, folder))
        if any(type(recordings[-1]) is type(other) for other in recordings[:-1]):
            raise ConfigError(f'{where}: "{table["use"]}" is named twice: both would write the same files')
    return tuple(recordings)


def described_recordings(recordings: Sequence[Recording]) -> Any:
    """The value for which `chosen_recordings` makes the same recordings.

    It consists of the changes to the defaults, so that single ones can be overridden; it is a list if their order
    differs.
    """
    listed = [describe(recording) for recording in recordings]
    changes: dict[str, Any] = dict.fromkeys(DEFAULTS, False)
    changes |= {table["use"]: {key: value for key, value in table.items() if key != "use"} for table in listed}
    uses = [use for use, change in changes.items() if change is not False]
    return changes if uses == [table["use"] for table in listed] else listed


def _changed_defaults(changes: dict[str, Any], where: str, folder: Path) -> list[dict[str, Any]]:
    tables: dict[str, dict[str, Any]] = {use: {"use": use} for use in DEFAULTS}
    for use, change in changes.items():
        if ":" not in use and use not in available("recording"):
            raise ConfigError(f'{where}: no recording "{use}"; {nearest(use, available("recording"))}')
        if not isinstance(change, bool | dict):
            raise ConfigError(f"{where}: {use} = {change!r}, expected true, false or a table of its fields")
        fields = change if isinstance(change, dict) else {}
        if "use" in fields:
            raise ConfigError(f'{where} {use}: no `use` expected, the recording is "{use}"')
        tables[use] = {"use": use, **fields}
        if change is False:
            del tables[use]
    return list(tables.values())
