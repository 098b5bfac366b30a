"""Initialization: poses of all persons without a prediction."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Protocol, runtime_checkable

from tracker.bodies.contours import Contours
from tracker.bodies.scene import Scene
from tracker.cameras.frame import Frame
from tracker.evidence import GUESSED, Evidence
from tracker.evidence.measures.outlines import Comparison
from tracker.evidence.measures.part_colours import colours_when_asked
from tracker.foundation.progress import Progress, Tally, silent
from tracker.images.plate import Plate
from tracker.images.sight import Sight
from tracker.synthesis import Synthesis
from tracker.tracking.estimation import Estimation
from tracker.tracking.objective import Objective
from tracker.tracking.start import Start

Backdrops = Callable[[], tuple[Plate | None, ...]]
"""Makes a plate for each view from its most frequent colours; None where it cannot."""


def no_backdrops() -> tuple[Plate | None, ...]:
    """For images without a recording."""
    return ()


@dataclass(frozen=True)
class Stages:
    """The stages of a search for a start pose, and the clean plates."""

    synthesis: Synthesis
    evidence: Evidence
    estimation: Estimation
    plates: tuple[Plate | None, ...]
    backdrops: Backdrops = no_backdrops
    """Plates from the most frequent colours of each view, unknown in many places; made on demand."""

    progress: Progress = silent
    """Gets the progress of the search."""

    tally: Tally = field(default_factory=lambda: Tally(silent, "pose"))
    """Counts the pieces of work of the search."""

    held: tuple[int, ...] = ()
    """Persons who are not sought: their poses in the scene hold."""

    seen_before: bool = False
    """Whether the poses of the others are their last known ones; otherwise they do not matter."""

    def counting(self, piece: str, total: int = 0) -> Stages:
        """The same with a new count of pieces of work."""
        return replace(self, tally=Tally(self.progress, piece, total))

    def objective(self, frame: Frame, scene: Scene, person: int, expected: Contours | None = None) -> Objective:
        """The objective of a person's pose in a frame, observed everywhere or near expected contours."""
        sight = Sight(frame, self.plates)
        observed = self.evidence.observe(sight, expected, GUESSED)
        asked = Comparison(scene, person, self.synthesis, observed)
        return Objective(asked, self.evidence, colours=colours_when_asked(sight))


@runtime_checkable
class Initialization(Protocol):
    """A component that finds start poses."""

    def check(self, scene: Scene, plates: tuple[Plate | None, ...]) -> str:
        """Refuses, before the first frame, what cannot work with any images.

        Args:
            scene: the persons' bodies and the rig.
            plates: a clean plate for each view that has one.

        Returns:
            One line about the choice of the start.

        Raises:
            ConfigError: something that it needs is missing, misnamed or impossible.
            ModelError: a body that it cannot place.
        """
        ...

    def start(self, frame: Frame, scene: Scene, stages: Stages) -> Start:
        """Poses of all persons in one frame.

        Args:
            frame: the images to start in.
            scene: the persons' bodies and the rig; the stages say which of the poses matter.
            stages: tools of the search.

        Raises:
            InitializationError: this frame shows no pose, with the reason; the next one may.
        """
        ...
