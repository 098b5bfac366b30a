"""Recording: what a run leaves on disk, written while it runs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

from tracker.scene import Scene
from tracker.trajectory import Step


@dataclass(frozen=True)
class RunContext:
    """What a recording needs to know of the run it records."""

    name: str
    folder: Path
    """Result folder; it exists."""

    scene: Scene
    """The persons (poses do not matter) and the rig of the images as tracked."""

    fps: float
    n_frames: int
    """Frames the run will have if nothing stops it."""

    resumed: frozenset[int] = frozenset()
    """Frames taken over from an interrupted run."""

    details: Mapping[str, Any] = field(default_factory=dict)
    """The run's description as saved in run.json: resolved config, versions, input hashes."""


@runtime_checkable
class Recorder(Protocol):
    """An open recording; the only state of a recording component."""

    def write(self, step: Step) -> None:
        """Adds one frame; what was written stays valid if the run is killed."""
        ...

    def finish(self) -> None:
        """Closes the files; called after the last frame, after Ctrl-C and after an error."""
        ...


@runtime_checkable
class Recording(Protocol):
    """A component that writes one kind of result."""

    def begin(self, run: RunContext) -> Recorder:
        """Opens the result files in `run.folder`, replacing those of an interrupted run."""
        ...
