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
from tracker.foundation.progress import Progress, Tally, silent
from tracker.images.plate import Plate
from tracker.images.sight import Sight
from tracker.synthesis import Synthesis
from tracker.tracking.estimation import Estimation
from tracker.tracking.objective import Objective
from tracker.tracking.start import Start

Backdrops = Callable[[], tuple[Plate | None, ...]]
"""Makes a plate for each view of what it shows most of the time; None where there is no telling."""


def no_backdrops() -> tuple[Plate | None, ...]:
    """For images that are no recording."""
    return ()


@dataclass(frozen=True)
class Stages:
    """The stages a search for a start pose may use, and the clean plates."""

    synthesis: Synthesis
    evidence: Evidence
    estimation: Estimation
    plates: tuple[Plate | None, ...]
    backdrops: Backdrops = no_backdrops
    """What each view shows most of the time, as plates of which much may be unknown; made when asked for."""

    progress: Progress = silent
    """Told what the search is doing."""

    tally: Tally = field(default_factory=lambda: Tally(silent, "pose"))
    """Counts what the search is trying."""

    held: tuple[int, ...] = ()
    """Persons who are not looked for: their poses in the scene hold."""

    seen_before: bool = False
    """Whether the poses of the others are where they were seen last; else they do not matter."""

    def counting(self, piece: str, total: int = 0) -> Stages:
        """The same with a new tally of pieces of work, of which so many are known."""
        return replace(self, tally=Tally(self.progress, piece, total))

    def objective(self, frame: Frame, scene: Scene, person: int, expected: Contours | None = None) -> Objective:
        """The objective of a person's pose in a frame, looked at everywhere or near expected contours."""
        observed = self.evidence.observe(Sight(frame, self.plates), expected, GUESSED)
        return Objective(Comparison(scene, person, self.synthesis, observed), self.evidence)


@runtime_checkable
class Initialization(Protocol):
    """A component that finds start poses."""

    def check(self, scene: Scene, plates: tuple[Plate | None, ...]) -> str:
        """Refuses, before the first frame, what cannot work whatever the frames show.

        Args:
            scene: the persons' bodies and the rig.
            plates: a clean plate for each view that has one.

        Returns:
            In one line what the start goes by.

        Raises:
            ConfigError: something that it needs is missing, misnamed or impossible.
            ModelError: a body that it cannot place.
        """
        ...

    def start(self, frame: Frame, scene: Scene, stages: Stages) -> Start:
        """Poses of all persons in one frame.

        Args:
            frame: the images to start in.
            scene: the persons' bodies and the rig; which of the poses matter, the stages tell.
            stages: what the search may use.

        Raises:
            InitializationError: no pose could be found in this frame, with the reason; the next one may show more.
        """
        ...
